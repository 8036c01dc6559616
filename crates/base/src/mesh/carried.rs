//! Zones carried along by the material into a later image.

use super::element::{ElementGeometry, corners_of, local_coordinates};
use super::pixel_set::PixelSet;
use super::pixels::{Owner, around};
use super::q4::{Mesh, turn};
use super::{Mask, MeshError, Roi, Zone, ZoneElements};
use crate::plane::bounds;
use crate::units::Px;
use std::sync::Arc;

/// Zones of a mesh in a later image, and where their nodes and elements come from.
#[derive(Debug, Clone, PartialEq)]
pub struct CarriedZones {
    /// Each with elements and a mask of its own; in the order and under the names of the mesh's zones.
    pub zones: Vec<Zone>,
    /// Number in the mesh of each carried node.
    pub nodes: Vec<usize>,
    /// Number in the mesh of each carried element.
    pub elements: Vec<usize>,
}

impl Mesh<Px> {
    /// The zones of this mesh in an image of `width` x `height` px, in which its nodes stand at `moved`: elements where
    /// `kept` holds, of any convex shape, and the nodes that they use.
    ///
    /// A pixel of that image is counted when the material in it was counted before: when the material point that the
    /// map of its element brings to the pixel's centre lies in a pixel of `counted`, the sets of the zones of this mesh
    /// that are summed over. Polygons, masks and guards so move with the material. Elements all of whose pixels were
    /// counted count all. A pixel that two zones claim, since they are measured apart from each other, goes to the
    /// first.
    ///
    /// # Errors
    /// [`MeshError::BadElement`] for an element that is folded at `moved`, with its number in this mesh's zone;
    /// [`MeshError::NoElements`] for a zone of which none is kept.
    ///
    /// # Panics
    /// When a list does not have one entry per node, element or zone of the mesh.
    pub fn carried(
        &self,
        counted: &[PixelSet],
        moved: &[[f64; 2]],
        kept: &[bool],
        [width, height]: [usize; 2],
    ) -> Result<CarriedZones, MeshError> {
        assert_eq!((moved.len(), kept.len()), (self.n_nodes(), self.n_elements()), "one entry per node and element");
        assert_eq!(counted.len(), self.zones().len(), "one set per zone");
        let mut carried = CarriedZones { zones: Vec::new(), nodes: Vec::new(), elements: Vec::new() };
        let mut taken = vec![false; width * height];
        for (zone, name) in self.zones().iter().enumerate() {
            let first_node = carried.nodes.len();
            let elements: Vec<usize> = self.zone_elements(zone).filter(|&element| kept[element]).collect();
            if elements.is_empty() {
                return Err(MeshError::NoElements(name.clone()));
            }
            let mut number = vec![None; self.zone_nodes(zone).len()];
            let offset = self.zone_nodes(zone).start;
            for &node in elements.iter().flat_map(|&element| &self.elements()[element]) {
                number[node as usize - offset] = Some(0);
            }
            for (node, number) in number.iter_mut().enumerate().filter(|(_, number)| number.is_some()) {
                *number = Some((carried.nodes.len() - first_node) as u32);
                carried.nodes.push(offset + node);
            }
            let mut bits = vec![false; width * height];
            for &element in &elements {
                let nodes = self.elements()[element];
                let corners = nodes.map(|node| moved[node as usize]);
                if !is_convex(nodes, corners) {
                    let mean = |k: usize| corners.iter().map(|p| 0.25 * p[k]).sum::<f64>();
                    let element = element - self.zone_elements(zone).start;
                    return Err(MeshError::BadElement { zone: name.clone(), element, x: mean(0), y: mean(1) });
                }
                let material = self.material_of(element, &counted[zone]);
                let owner = Owner::new(nodes, corners);
                let [x0, y0, x1, y1] = around(&corners, width, height);
                for (x, y) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))) {
                    let p = [x as f64, y as f64];
                    if !taken[y * width + x] && owner.pixel(p) && material.counts(corners, p) {
                        bits[y * width + x] = true;
                    }
                }
            }
            taken.iter_mut().zip(&bits).for_each(|(taken, bit)| *taken |= bit);
            let own = |node: u32| number[node as usize - offset].unwrap_or_default();
            let part = ZoneElements {
                name: name.clone(),
                nodes: carried.nodes[first_node..].iter().map(|&node| moved[node]).collect(),
                elements: elements.iter().map(|&element| self.elements()[element].map(own)).collect(),
            };
            let mask = Mask::new(width, height, bits).map(Arc::new);
            let roi = Some(bounds_within(&part.nodes, [width, height]));
            let elements_of_zone = Some(Arc::new(part));
            carried.zones.push(Zone { name: name.clone(), roi, elements: elements_of_zone, mask, ..Zone::default() });
            carried.elements.extend(elements);
        }
        Ok(carried)
    }

    fn material_of<'a>(&self, element: usize, counted: &'a PixelSet) -> Material<'a> {
        let corners = self.corners(element);
        let owner = Owner::new(self.elements()[element], corners);
        let nearest = |p: [f64; 2]| p.map(|v| v.round().max(0.0) as usize);
        let reach = |k: usize| corners.iter().map(|p| p[k]).fold(0.0, f64::max).ceil() as usize + 1;
        let [x0, y0, x1, y1] = around(&corners, reach(0), reach(1));
        let mut pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| [x as f64, y as f64]));
        let whole = pixels.all(|p| !owner.pixel(p) || counted.contains(nearest(p)[0], nearest(p)[1]));
        if whole { Material::Whole } else { Material::Part { corners, counted } }
    }
}

/// The material of an element that is counted.
enum Material<'a> {
    Whole,
    /// What lay in a pixel of the set, when the corners stood there.
    Part {
        corners: [[f64; 2]; 4],
        counted: &'a PixelSet,
    },
}

impl Material<'_> {
    /// Whether the material is counted that is at `p` when the corners of its element are at `corners`.
    fn counts(&self, corners: [[f64; 2]; 4], p: [f64; 2]) -> bool {
        let Self::Part { corners: before, counted } = self else { return true };
        let Some([xi, eta]) = local_coordinates(corners, p) else { return false };
        let was = ElementGeometry::new(*before).place([xi.clamp(0.0, 1.0), eta.clamp(0.0, 1.0)]);
        let [x, y] = was.map(f64::round);
        x >= 0.0 && y >= 0.0 && counted.contains(x as usize, y as usize)
    }
}

/// The rectangle of whole pixels around `nodes`, as far as it lies in an image of that size.
fn bounds_within(nodes: &[[f64; 2]], size: [usize; 2]) -> Roi {
    let [low, high] = bounds(nodes);
    let [width, height] = size.map(|n| n as f64);
    let (x0, y0) = (low[0].floor().clamp(0.0, width - 1.0), low[1].floor().clamp(0.0, height - 1.0));
    let [x1, y1] = high.map(|v| v.ceil() + 1.0);
    Roi { x0, y0, x1: x1.clamp(x0 + 1.0, width), y1: y1.clamp(y0 + 1.0, height) }
}

/// Whether the corners, in the sense they have in a mesh, go around a convex shape.
fn is_convex(nodes: [u32; 4], corners: [[f64; 2]; 4]) -> bool {
    let sides = corners_of(&nodes).len();
    (0..sides).all(|k| turn(&corners[..sides], k) > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Guard, PixelMesh};

    const SIZE: [usize; 2] = [96, 80];

    fn laid(guard: f64) -> PixelMesh {
        let zone = Zone::rectangle("all", Roi { x0: 10.0, y0: 12.0, x1: 58.0, y1: 60.0 });
        PixelMesh::on_zones(&[Zone { guard: Guard::All(guard), ..zone }], 16, 0.5, SIZE).unwrap()
    }

    fn moved(mesh: &Mesh<Px>, by: impl Fn([f64; 2]) -> [f64; 2]) -> Vec<[f64; 2]> {
        mesh.nodes().iter().map(|&x| by(x)).collect()
    }

    fn pixels_of(zones: &[Zone]) -> Vec<usize> {
        counts(&PixelMesh::on_zones(zones, 16, 0.5, SIZE).unwrap())
    }

    /// Pixels of each element.
    fn counts(laid: &PixelMesh) -> Vec<usize> {
        let count = |element| {
            let mut n = 0;
            laid.pixels.for_each(element, |_, _, _, _| n += 1);
            n
        };
        laid.pixels.elements().iter().map(count).collect()
    }

    #[test]
    fn a_zone_carried_by_whole_pixels_keeps_every_pixel_of_every_element() {
        for guard in [0.0, 3.0] {
            let laid = laid(guard);
            let to = moved(&laid.mesh, |[x, y]| [x + 7.0, y - 3.0]);
            let carried = laid.mesh.carried(&laid.zone_pixels, &to, &[true; 9], SIZE).unwrap();
            assert_eq!(pixels_of(&carried.zones), counts(&laid), "guard {guard}");
            assert_eq!((carried.nodes.len(), carried.elements.len()), (16, 9));
        }
    }

    #[test]
    fn a_turned_and_stretched_guard_keeps_its_share_of_the_area() {
        let laid = laid(3.0);
        let (sin, cos) = 0.6f64.sin_cos();
        let turn = |[x, y]: [f64; 2]| {
            let (a, b) = (1.2 * (x - 34.0), 0.9 * (y - 36.0));
            [44.0 + cos * a - sin * b, 40.0 + sin * a + cos * b]
        };
        let carried = laid.mesh.carried(&laid.zone_pixels, &moved(&laid.mesh, turn), &[true; 9], SIZE).unwrap();
        let n: usize = pixels_of(&carried.zones).iter().sum();
        // 42 of 48 px are left in each direction; pixels along a border of 4 x 42 px are drawn by lot.
        let want = 42.0 * 42.0 * 1.2 * 0.9;
        assert!((n as f64 - want).abs() < 2.0 * 168f64.sqrt(), "{n} pixels, {want} expected");
    }

    #[test]
    fn elements_left_out_take_their_nodes_with_them() {
        let laid = laid(0.0);
        let to = moved(&laid.mesh, |x| x);
        let kept: Vec<bool> = (0..9).map(|k| k % 3 < 2).collect();
        let carried = laid.mesh.carried(&laid.zone_pixels, &to, &kept, SIZE).unwrap();
        assert_eq!(carried.elements, [0, 1, 3, 4, 6, 7]);
        assert_eq!(carried.nodes, [0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14]);
        let none = laid.mesh.carried(&laid.zone_pixels, &to, &[false; 9], SIZE);
        assert_eq!(none, Err(MeshError::NoElements("all".into())));
    }

    #[test]
    fn a_folded_element_is_named() {
        let laid = laid(0.0);
        let mut to = moved(&laid.mesh, |x| x);
        to[5] = [50.0, 50.0]; // beyond the opposite corner of element 4
        let refused = laid.mesh.carried(&laid.zone_pixels, &to, &[true; 9], SIZE);
        assert!(matches!(refused, Err(MeshError::BadElement { element: 0 | 1 | 3 | 4, .. })), "{refused:?}");
        // Mirrored as a whole: every element keeps its shape, but not its sense.
        let mirrored = moved(&laid.mesh, |[x, y]| [70.0 - x, y]);
        let refused = laid.mesh.carried(&laid.zone_pixels, &mirrored, &[true; 9], SIZE);
        assert!(matches!(refused, Err(MeshError::BadElement { element: 0, .. })), "{refused:?}");
    }

    #[test]
    fn zones_that_run_into_each_other_share_no_pixel() {
        let zones = [
            Zone::rectangle("upper", Roi { x0: 10.0, y0: 10.0, x1: 58.0, y1: 26.0 }),
            Zone::rectangle("lower", Roi { x0: 10.0, y0: 28.0, x1: 58.0, y1: 44.0 }),
        ];
        let laid = PixelMesh::on_zones(&zones, 16, 0.5, SIZE).unwrap();
        let to: Vec<[f64; 2]> = moved(&laid.mesh, |[x, y]| [x, if y > 27.0 { y - 4.0 } else { y }]);
        let carried = laid.mesh.carried(&laid.zone_pixels, &to, &[true; 6], SIZE).unwrap();
        assert_eq!(pixels_of(&carried.zones), [256, 256, 256, 224, 224, 224]);
    }
}
