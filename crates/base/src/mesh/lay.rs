//! Meshes laid on the zones of an image, with the pixels of their elements.

use super::crack::cut;
use super::grid::Grid;
use super::pixel_set::PixelSet;
use super::pixels::{self, PixelMap};
use super::q4::{Mesh, Part, checked};
use super::zone_pixels::{ZonePixels, zone_pixels};
use super::{MeshError, Roi, Zone, ZoneElements};
use crate::units::Px;
use std::sync::Arc;

/// An element of which less than this share of its pixels lies inside its zone is left out of the mesh.
pub const ELEMENT_SHARE: f64 = 0.5;

/// A mesh with the pixels that its elements are measured with.
#[derive(Debug, Clone)]
pub struct PixelMesh {
    /// The mesh.
    pub mesh: Arc<Mesh<Px>>,
    /// The pixels of each zone that are summed over.
    pub zone_pixels: Vec<PixelSet>,
    /// The pixels of each element.
    pub pixels: Arc<PixelMap>,
    /// The paths along which each zone is cut.
    pub cracks: Vec<Vec<Vec<[f64; 2]>>>,
}

impl PixelMesh {
    /// Lays elements of `size` px on `zones` of an image of `width` x `height` px.
    ///
    /// A rectangle holds as many whole elements as fit. Other regions are covered: an element keeps those of
    /// its pixels that lie inside, and is left out when they are less than `share` of all its pixels (the
    /// guard does not count there). A zone with elements of its own keeps them all.
    ///
    /// # Errors
    /// An element size outside 4..=128, a share outside 0..=1, a region that is none, lies outside the
    /// image, holds no element or overlaps another, wrong elements, and two zones of one name.
    pub fn on_zones(zones: &[Zone], size: usize, share: f64, image: [usize; 2]) -> Result<Self, MeshError> {
        if !(4..=128).contains(&size) {
            return Err(MeshError::ElementSize { size });
        }
        if !(share > 0.0 && share <= 1.0) {
            return Err(MeshError::ElementShare(share));
        }
        if zones.is_empty() {
            return Err(MeshError::NoZone);
        }
        let mut parts: Vec<Part> = Vec::with_capacity(zones.len());
        let mut zone_sets = Vec::with_capacity(zones.len());
        for (at, zone) in zones.iter().enumerate() {
            if zones[..at].iter().any(|other| other.name == zone.name) {
                return Err(MeshError::SameName(zone.name.clone()));
            }
            zone.cracks.iter().try_for_each(|crack| crack.check(&zone.name))?;
            let (part, pixels) = match &zone.elements {
                Some(elements) => own_elements(zone, elements, image)?,
                None => lattice(zone, size, share, image)?,
            };
            if pixels.guarded.bounds().is_none() {
                return Err(MeshError::Guard { zone: zone.name.clone(), guard: zone.guard.largest() });
            }
            let rectangles = |k: usize| zones[k].is_rectangle() && zone.is_rectangle();
            if let Some(other) = (0..at).find(|&k| rectangles(k) && overlap(&parts[k], &part)) {
                let (first, second) = (zones[other].name.clone(), zone.name.clone());
                return Err(MeshError::Overlap(first, second));
            }
            parts.push(part);
            zone_sets.push(pixels.guarded);
        }
        let mesh = Mesh::of_parts(parts);
        for crack in zones.iter().filter(|zone| zone.elements.is_none()).flat_map(|zone| &zone.cracks) {
            if mesh.cut_faces(&crack.path).points.is_empty() {
                let ([x0, y0], [x1, y1]) = (crack.path[0], crack.path[crack.path.len() - 1]);
                return Err(MeshError::CrackCutsNothing { x0, y0, x1, y1, size });
            }
        }
        let pixels = PixelMap::new(&mesh, &zone_sets, image);
        // Rectangles have been compared by their grids, elements in the guard of another zone included.
        if zones.len() > 1
            && !zones.iter().all(|zone| zone.is_rectangle() && zone.cracks.is_empty())
            && let Some([first, second]) = pixels::shared(&mesh, &pixels, image)
        {
            let name = |zone: usize| zones[zone].name.clone();
            return Err(MeshError::Overlap(name(first), name(second)));
        }
        let cracks = zones.iter().map(|zone| zone.cracks.iter().map(|crack| crack.path.clone()).collect()).collect();
        Ok(Self { mesh: Arc::new(mesh), zone_pixels: zone_sets, pixels: Arc::new(pixels), cracks })
    }

    /// The mesh on the image of half the size; `None` when nothing of a zone would be left. Each zone keeps
    /// its extent, with elements at least `size` px of that image where it is that large. Zones that are no
    /// whole grid get the elements of a grid that hold enough pixels.
    pub fn halved(&self, size: usize, image: [usize; 2]) -> Option<Self> {
        // The share of pixels that an element of a coarse level must hold: it only prepares the next one.
        const COARSE_SHARE: f64 = 0.25;
        let coarser = |x: f64| 0.5 * (x - 0.5);
        let mut parts = Vec::with_capacity(self.mesh.zones().len());
        let mut zone_pixels = Vec::with_capacity(self.mesh.zones().len());
        let coarse_path = |path: &Vec<[f64; 2]>| path.iter().map(|p| p.map(coarser)).collect();
        let cracks: Vec<Vec<Vec<[f64; 2]>>> =
            self.cracks.iter().map(|of_zone| of_zone.iter().map(coarse_path).collect()).collect();
        for (zone, name) in self.mesh.zones().iter().enumerate() {
            let Roi { x0, y0, x1, y1 } = self.mesh.bounds(zone);
            let (width, height) = (0.5 * (x1 - x0), 0.5 * (y1 - y0));
            let count = |length: f64| ((length / size as f64).floor() as usize).max(1);
            let (nx, ny) = (count(width), count(height));
            let (hx, hy) = (width / nx as f64, height / ny as f64);
            let grid = Grid { x0: coarser(x0), y0: coarser(y0), hx, hy, nx, ny, first_node: 0, first_element: 0 };
            let halved = self.zone_pixels[zone].halved();
            let part = if self.mesh.whole_grid(zone).is_some() {
                Part::whole(name.clone(), grid)
            } else {
                let cells: Vec<bool> = pixels::cells(&grid, image)
                    .map(|cell| halved.count(cell.bounds) as f64 >= COARSE_SHARE * hx * hy)
                    .collect();
                if !cells.contains(&true) {
                    return None;
                }
                Part::of_cells(name.clone(), grid, &cells)
            };
            halved.bounds()?;
            // A crack that is too short for these elements is left to finer ones.
            let part = cut(&part, &cracks[zone]).unwrap_or(part);
            parts.push(part);
            zone_pixels.push(halved);
        }
        let mesh = Mesh::of_parts(parts);
        let pixels = PixelMap::new(&mesh, &zone_pixels, image);
        Some(Self { mesh: Arc::new(mesh), zone_pixels, pixels: Arc::new(pixels), cracks })
    }
}

/// What a length may lack of a whole number of elements, px: numbers that were computed are not exact.
const ROUND_OFF_PX: f64 = 1e-6;

fn lattice(zone: &Zone, size: usize, share: f64, image: [usize; 2]) -> Result<(Part, ZonePixels), MeshError> {
    let pixels = zone_pixels(zone, image, None)?;
    let roi = zone.bounds(image[0], image[1])?;
    let h = size as f64;
    let name = zone.name.clone();
    if zone.is_rectangle() {
        let (width, height) = (roi.x1 - roi.x0, roi.y1 - roi.y0);
        let [nx, ny] = [width, height].map(|length| ((length + ROUND_OFF_PX) / h).floor() as usize);
        if nx == 0 || ny == 0 {
            return Err(MeshError::TooSmall { zone: name, width, height, size });
        }
        let grid = Grid { x0: roi.x0, y0: roi.y0, hx: h, hy: h, nx, ny, first_node: 0, first_element: 0 };
        return Ok((cracked(zone, Part::whole(name, grid)), pixels));
    }
    let [left, top, right, bottom] = pixels.all.bounds().ok_or_else(|| MeshError::Empty(name.clone()))?;
    let (x0, y0) = if zone.roi.is_some() { (roi.x0, roi.y0) } else { (left as f64, top as f64) };
    // Elements that cover the region, the last ones beyond its edge as far as they keep their share.
    let count = |from: f64, to: usize| (((to as f64 - from) / h).ceil() as usize).max(1);
    let (nx, ny) = (count(x0, right), count(y0, bottom));
    let grid = Grid { x0, y0, hx: h, hy: h, nx, ny, first_node: 0, first_element: 0 };
    let enough = share * h * h;
    let kept: Vec<bool> =
        pixels::cells(&grid, image).map(|cell| pixels.all.count(cell.bounds) as f64 >= enough).collect();
    if !kept.contains(&true) {
        return Err(MeshError::NoElement(name, size, 100.0 * share));
    }
    Ok((cracked(zone, Part::of_cells(name, grid, &kept)), pixels))
}

/// The part cut along the cracks of its zone. One that does not meet it leaves it as it is.
fn cracked(zone: &Zone, part: Part) -> Part {
    if zone.cracks.is_empty() {
        return part;
    }
    let paths: Vec<_> = zone.cracks.iter().map(|crack| crack.path.clone()).collect();
    cut(&part, &paths).unwrap_or(part)
}

fn own_elements(zone: &Zone, own: &ZoneElements, image: [usize; 2]) -> Result<(Part, ZonePixels), MeshError> {
    let elements = checked(&zone.name, own)?;
    let (width, height) = (image[0] as f64, image[1] as f64);
    let outside = |p: &[f64; 2]| p[0] < -0.5 || p[1] < -0.5 || p[0] > width || p[1] > height;
    if let Some(node) = own.nodes.iter().position(outside) {
        let [x, y] = own.nodes[node];
        return Err(MeshError::BadNode { zone: zone.name.clone(), node, x, y });
    }
    let covered = pixels::covered(&own.nodes, &elements, image);
    let pixels = zone_pixels(zone, image, Some(covered))?;
    Ok((Part { name: zone.name.clone(), nodes: own.nodes.clone(), elements, grid: None }, pixels))
}

fn overlap(a: &Part, b: &Part) -> bool {
    let bounds = |part: &Part| part.grid.as_ref().map(|(grid, _)| grid.bounds());
    let meet = |low: f64, high: f64| low + ROUND_OFF_PX < high;
    bounds(a)
        .zip(bounds(b))
        .is_some_and(|(a, b)| meet(a.x0, b.x1) && meet(b.x0, a.x1) && meet(a.y0, b.y1) && meet(b.y0, a.y1))
}

impl Mesh<Px> {
    /// The mesh of square elements of `size` px on `zones` of an image of `width` x `height` px: on a
    /// rectangle the first node at (x0, y0), nodes every `size`, as many whole elements as fit before (x1, y1).
    /// See [`PixelMesh::on_zones`], which also gives the pixels.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::mesh::{Mesh, Roi, Zone};
    /// let roi = Roi { x0: 8.0, y0: 8.0, x1: 59.0, y1: 40.0 };
    /// let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 64, 64).unwrap();
    /// assert_eq!((mesh.n_elements(), mesh.n_nodes()), (6, 12)); // 3 x 2 elements
    /// assert_eq!(mesh.nodes()[11], [56.0, 40.0]);
    /// ```
    ///
    /// # Errors
    /// Those of [`PixelMesh::on_zones`].
    pub fn on_zones(zones: &[Zone], size: usize, width: usize, height: usize) -> Result<Self, MeshError> {
        let laid = PixelMesh::on_zones(zones, size, ELEMENT_SHARE, [width, height])?;
        Ok(Arc::unwrap_or_clone(laid.mesh))
    }
}
