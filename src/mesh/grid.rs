//! Regular Q4 grids on rectangular zones.

use crate::units::{Length, Px};
use std::marker::PhantomData;
use thiserror::Error;

/// A rectangle of the reference image, in pixels; coordinates may be fractional.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roi {
    /// Left edge.
    pub x0: f64,
    /// Upper edge.
    pub y0: f64,
    /// Right edge, not included.
    pub x1: f64,
    /// Lower edge, not included.
    pub y1: f64,
}

/// A named region of interest. Zones share no node.
#[derive(Debug, Clone, PartialEq)]
pub struct Zone {
    /// Name, unique among the zones.
    pub name: String,
    /// Its rectangle.
    pub roi: Roi,
}

/// Why a mesh cannot be laid on the given zones.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The element size is outside 4..=128 px.
    #[error("the element size is {size} px; choose 4 to 128 px (16 is a good start)")]
    ElementSize {
        /// What was asked for, px.
        size: usize,
    },
    /// The rectangle is not one (swapped corners, NaN).
    #[error("zone '{zone}': ({x0}, {y0}) to ({x1}, {y1}) px is no rectangle; give x0 < x1 and y0 < y1")]
    NotARectangle {
        /// Zone's name.
        zone: String,
        /// Left edge, px.
        x0: f64,
        /// Upper edge, px.
        y0: f64,
        /// Right edge, px.
        x1: f64,
        /// Lower edge, px.
        y1: f64,
    },
    /// The zone reaches beyond the image.
    #[error("zone '{zone}': ({x0}, {y0}) to ({x1}, {y1}) px reaches outside the image of {width} x {height} px")]
    OutsideImage {
        /// Zone's name.
        zone: String,
        /// Left edge, px.
        x0: f64,
        /// Upper edge, px.
        y0: f64,
        /// Right edge, px.
        x1: f64,
        /// Lower edge, px.
        y1: f64,
        /// Image columns.
        width: usize,
        /// Image rows.
        height: usize,
    },
    /// Not one whole element fits.
    #[error(
        "zone '{zone}' is {width} x {height} px: no element of {size} px fits; enlarge the zone or choose smaller elements"
    )]
    TooSmall {
        /// Zone's name.
        zone: String,
        /// Zone's width, px.
        width: f64,
        /// Zone's height, px.
        height: f64,
        /// Element size, px.
        size: usize,
    },
    /// Two zones measure the same pixels.
    #[error("zones '{first}' and '{second}' overlap; a pixel belongs to one zone only")]
    Overlap {
        /// One zone's name.
        first: String,
        /// The other's.
        second: String,
    },
    /// Two zones have one name.
    #[error("two zones are named '{name}'; names must differ")]
    SameName {
        /// The name.
        name: String,
    },
    /// No zone was given.
    #[error("there is no zone to measure")]
    NoZone,
}

/// The regular grid of one zone: `nx` by `ny` elements of `hx` by `hy`.
///
/// Node (i, j) of the zone stands at `(x0 + i hx, y0 + j hy)` and has the number
/// `first_node + j (nx + 1) + i`; element (i, j) has the number `first_element + j nx + i`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// x of the first node.
    pub x0: f64,
    /// y of the first node.
    pub y0: f64,
    /// Element width.
    pub hx: f64,
    /// Element height.
    pub hy: f64,
    /// Elements along x.
    pub nx: usize,
    /// Elements along y.
    pub ny: usize,
    /// Number of the zone's first node in the mesh.
    pub first_node: usize,
    /// Number of the zone's first element in the mesh.
    pub first_element: usize,
}

impl Grid {
    /// Number of nodes.
    pub fn n_nodes(&self) -> usize {
        (self.nx + 1) * (self.ny + 1)
    }

    /// Number of elements.
    pub fn n_elements(&self) -> usize {
        self.nx * self.ny
    }

    /// Number, in the mesh, of the node in column `i` and row `j` of the grid.
    pub fn node(&self, i: usize, j: usize) -> usize {
        self.first_node + j * (self.nx + 1) + i
    }

    /// The element that holds `(x, y)` and the local coordinates (0..1) there. Points outside get the
    /// nearest element and local coordinates beyond 0..1, so that the field is extrapolated linearly.
    pub fn locate(&self, x: f64, y: f64) -> (usize, f64, f64) {
        let (s, t) = ((x - self.x0) / self.hx, (y - self.y0) / self.hy);
        let i = (s.floor().max(0.0) as usize).min(self.nx - 1);
        let j = (t.floor().max(0.0) as usize).min(self.ny - 1);
        (self.first_element + j * self.nx + i, s - i as f64, t - j as f64)
    }
}

/// Bilinear shape functions at the local coordinates (0..1), in the order of an element's nodes:
/// (0,0), (1,0), (1,1), (0,1).
pub fn shape_functions(xi: f64, eta: f64) -> [f64; 4] {
    [(1.0 - xi) * (1.0 - eta), xi * (1.0 - eta), xi * eta, (1.0 - xi) * eta]
}

/// A Q4 mesh: one regular grid per zone, no node shared between zones.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh<U: Length> {
    zones: Vec<String>,
    grids: Vec<Grid>,
    nodes: Vec<[f64; 2]>,
    elements: Vec<[u32; 4]>,
    node_zone: Vec<u32>,
    element_zone: Vec<u32>,
    unit: PhantomData<U>,
}

impl Mesh<Px> {
    /// The mesh of square elements of `size` px on `zones` of an image of `width` x `height` px: first
    /// node at (x0, y0), nodes every `size`, as many whole elements as fit before (x1, y1).
    ///
    /// ```
    /// use quadrille::mesh::{Mesh, Roi, Zone};
    /// let roi = Roi { x0: 8.0, y0: 8.0, x1: 59.0, y1: 40.0 };
    /// let mesh = Mesh::on_zones(&[Zone { name: "all".into(), roi }], 16, 64, 64).unwrap();
    /// assert_eq!((mesh.n_elements(), mesh.n_nodes()), (6, 12)); // 3 x 2 elements
    /// assert_eq!(mesh.nodes()[11], [56.0, 40.0]);
    /// ```
    ///
    /// # Errors
    /// An element size outside 4..=128, a zone that is no rectangle, lies outside the image, is smaller
    /// than an element or overlaps another, and two zones of one name.
    pub fn on_zones(zones: &[Zone], size: usize, width: usize, height: usize) -> Result<Self, MeshError> {
        if !(4..=128).contains(&size) {
            return Err(MeshError::ElementSize { size });
        }
        if zones.is_empty() {
            return Err(MeshError::NoZone);
        }
        let mut grids = Vec::with_capacity(zones.len());
        for (at, zone) in zones.iter().enumerate() {
            if zones[..at].iter().any(|other| other.name == zone.name) {
                return Err(MeshError::SameName { name: zone.name.clone() });
            }
            let grid = whole_elements(zone, size, width, height)?;
            if let Some(other) = (0..at).find(|&k| overlap(&grids[k], &grid)) {
                let (first, second) = (zones[other].name.clone(), zone.name.clone());
                return Err(MeshError::Overlap { first, second });
            }
            grids.push(grid);
        }
        Ok(Self::from_grids(zones.iter().map(|z| z.name.clone()).collect(), grids))
    }
}

/// The grid of whole elements on one zone (numbers not yet given).
fn whole_elements(zone: &Zone, size: usize, width: usize, height: usize) -> Result<Grid, MeshError> {
    let Roi { x0, y0, x1, y1 } = zone.roi;
    let name = || zone.name.clone();
    let finite = [x0, y0, x1, y1].iter().all(|v| v.is_finite());
    if !finite || x0 >= x1 || y0 >= y1 {
        return Err(MeshError::NotARectangle { zone: name(), x0, y0, x1, y1 });
    }
    // The image's pixels cover -0.5..width-0.5; a zone may end at `width`, since its right edge is open.
    if x0 < -0.5 || y0 < -0.5 || x1 > width as f64 || y1 > height as f64 {
        return Err(MeshError::OutsideImage { zone: name(), x0, y0, x1, y1, width, height });
    }
    let h = size as f64;
    let (nx, ny) = (((x1 - x0) / h).floor() as usize, ((y1 - y0) / h).floor() as usize);
    if nx == 0 || ny == 0 {
        return Err(MeshError::TooSmall { zone: name(), width: x1 - x0, height: y1 - y0, size });
    }
    Ok(Grid { x0, y0, hx: h, hy: h, nx, ny, first_node: 0, first_element: 0 })
}

fn overlap(a: &Grid, b: &Grid) -> bool {
    let ends = |g: &Grid| (g.x0 + g.nx as f64 * g.hx, g.y0 + g.ny as f64 * g.hy);
    let ((ax1, ay1), (bx1, by1)) = (ends(a), ends(b));
    a.x0 < bx1 && b.x0 < ax1 && a.y0 < by1 && b.y0 < ay1
}

impl<U: Length> Mesh<U> {
    /// The mesh of one grid per zone; node and element numbers are given here.
    ///
    /// # Panics
    /// When names and grids differ in number.
    pub fn from_grids(zones: Vec<String>, mut grids: Vec<Grid>) -> Self {
        assert_eq!(zones.len(), grids.len(), "one name per grid");
        let (mut nodes, mut elements) = (Vec::new(), Vec::new());
        let (mut node_zone, mut element_zone) = (Vec::new(), Vec::new());
        for (zone, grid) in grids.iter_mut().enumerate() {
            grid.first_node = nodes.len();
            grid.first_element = elements.len();
            for j in 0..=grid.ny {
                for i in 0..=grid.nx {
                    nodes.push([grid.x0 + i as f64 * grid.hx, grid.y0 + j as f64 * grid.hy]);
                }
            }
            for j in 0..grid.ny {
                for i in 0..grid.nx {
                    let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                    elements.push(corners.map(|(i, j)| grid.node(i, j) as u32));
                }
            }
            node_zone.resize(nodes.len(), zone as u32);
            element_zone.resize(elements.len(), zone as u32);
        }
        Self { zones, grids, nodes, elements, node_zone, element_zone, unit: PhantomData }
    }

    /// Zone names, in the order of their numbers.
    pub fn zones(&self) -> &[String] {
        &self.zones
    }

    /// One grid per zone.
    pub fn grids(&self) -> &[Grid] {
        &self.grids
    }

    /// Node positions, in `U`.
    pub fn nodes(&self) -> &[[f64; 2]] {
        &self.nodes
    }

    /// The four nodes of each element, in the order (0,0), (1,0), (1,1), (0,1) of the local coordinates.
    pub fn elements(&self) -> &[[u32; 4]] {
        &self.elements
    }

    /// Zone number of each node.
    pub fn node_zone(&self) -> &[u32] {
        &self.node_zone
    }

    /// Zone number of each element.
    pub fn element_zone(&self) -> &[u32] {
        &self.element_zone
    }

    /// Number of nodes.
    pub fn n_nodes(&self) -> usize {
        self.nodes.len()
    }

    /// Number of elements.
    pub fn n_elements(&self) -> usize {
        self.elements.len()
    }

    /// Numbers of the nodes of one zone.
    pub fn zone_nodes(&self, zone: usize) -> std::ops::Range<usize> {
        let grid = &self.grids[zone];
        grid.first_node..grid.first_node + grid.n_nodes()
    }

    /// Numbers of the elements of one zone.
    pub fn zone_elements(&self, zone: usize) -> std::ops::Range<usize> {
        let grid = &self.grids[zone];
        grid.first_element..grid.first_element + grid.n_elements()
    }
}
