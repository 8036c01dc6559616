//! Q4 meshes of one or more zones.

use super::element::{ElementGeometry, corners_of, local_coordinates, shape_functions};
use super::grid::Grid;
use super::{MeshError, Roi, ZoneElements};
use crate::plane::bounds;
use crate::units::{Length, Mm, PixelSize, Px, Vector};
use std::collections::HashMap;
use std::marker::PhantomData;
use std::ops::Range;

/// How the elements of a zone are arranged.
#[derive(Debug, Clone, PartialEq)]
enum ZoneLayout {
    /// A whole grid.
    Whole(Grid),
    /// Some elements of a grid: their number within the zone by column and row, [`NONE`] where there is none.
    Part { grid: Grid, element_at: Vec<u32> },
    /// No grid.
    Free(Bins),
}

const NONE: u32 = u32::MAX;

/// Which elements of a zone without grid lie where: lists by square of a coarse raster.
#[derive(Debug, Clone, PartialEq)]
struct Bins {
    origin: [f64; 2],
    size: f64,
    columns: usize,
    lists: Vec<Vec<u32>>,
}

impl Bins {
    fn new(nodes: &[[f64; 2]], elements: &[[u32; 4]]) -> Self {
        let [low, high] = bounds(nodes);
        let area = (high[0] - low[0]) * (high[1] - low[1]);
        let size = (area / elements.len().max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
        // Elements as small as numbers get have no quotient that counts; clamped before it is one.
        let count = |k: usize| ((high[k] - low[k]) / size).clamp(0.0, 32767.0) as usize + 1;
        let (columns, rows) = (count(0), count(1));
        let mut bins = Self { origin: low, size, columns, lists: vec![Vec::new(); columns * rows] };
        for (element, corners) in elements.iter().enumerate() {
            let [from, to] = bounds(corners.iter().map(|&node| &nodes[node as usize])).map(|at| bins.square(at));
            for row in from[1]..=to[1] {
                for column in from[0]..=to[0] {
                    bins.lists[row * columns + column].push(element as u32);
                }
            }
        }
        bins
    }

    fn square(&self, p: [f64; 2]) -> [usize; 2] {
        let rows = self.lists.len() / self.columns;
        let at = |k: usize, n: usize| (((p[k] - self.origin[k]) / self.size).max(0.0) as usize).min(n - 1);
        [at(0, self.columns), at(1, rows)]
    }
}

/// A Q4 mesh: in pixels with y down, or in millimetres on the specimen with y up ([`Mesh::to_mm`]); no node is shared
/// between zones. A triangle is an element whose last two nodes are the same.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh<U: Length> {
    zones: Vec<String>,
    layouts: Vec<ZoneLayout>,
    nodes: Vec<[f64; 2]>,
    elements: Vec<[u32; 4]>,
    node_zone: Vec<u32>,
    element_zone: Vec<u32>,
    /// Where each zone's nodes and elements begin; one more entry closes the last.
    first_node: Vec<usize>,
    first_element: Vec<usize>,
    /// Square root of the mean area of the elements.
    element_size: f64,
    unit: PhantomData<U>,
}

/// Nodes and elements of one zone, numbered from 0, before they get their place in the mesh.
#[derive(Debug)]
pub(super) struct Part {
    pub name: String,
    pub nodes: Vec<[f64; 2]>,
    pub elements: Vec<[u32; 4]>,
    /// The grid they lie on, with the element at each of its cells.
    pub grid: Option<(Grid, Vec<u32>)>,
}

impl Part {
    pub fn whole(name: String, grid: Grid) -> Self {
        Self::of_cells(name, grid, &vec![true; grid.n_elements()])
    }

    /// The elements of a grid where `kept` holds.
    pub fn of_cells(name: String, grid: Grid, kept: &[bool]) -> Self {
        let columns = grid.nx + 1;
        let mut node_at = vec![NONE; grid.n_nodes()];
        let corners = |cell: usize| {
            let (i, j) = (cell % grid.nx, cell / grid.nx);
            [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| j * columns + i)
        };
        for cell in (0..kept.len()).filter(|&cell| kept[cell]) {
            for at in corners(cell) {
                node_at[at] = 0;
            }
        }
        // Nodes row by row, as in a whole grid.
        let mut nodes = Vec::new();
        for at in 0..node_at.len() {
            if node_at[at] != NONE {
                node_at[at] = nodes.len() as u32;
                nodes.push(grid.position(at % columns, at / columns));
            }
        }
        let mut elements = Vec::new();
        let mut element_at = vec![NONE; kept.len()];
        for cell in (0..kept.len()).filter(|&cell| kept[cell]) {
            element_at[cell] = elements.len() as u32;
            elements.push(corners(cell).map(|at| node_at[at]));
        }
        Self { name, nodes, elements, grid: Some((grid, element_at)) }
    }
}

/// Twice the area of the corner after point `k` of a polygon: all positive in a convex one that goes from x to y.
pub(super) fn turn(p: &[[f64; 2]], k: usize) -> f64 {
    let (a, b, c) = (p[k], p[(k + 1) % p.len()], p[(k + 2) % p.len()]);
    (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
}

/// The corners of an element gone around the other way; of a triangle the last one twice.
fn reversed([a, b, c, d]: [u32; 4]) -> [u32; 4] {
    if c == d { [a, c, b, b] } else { [a, d, c, b] }
}

/// The elements, each turned so that its corners go from x to y; refused when they are none.
pub(super) fn checked(zone: &str, own: &ZoneElements) -> Result<Vec<[u32; 4]>, MeshError> {
    let name = || zone.to_owned();
    if own.elements.is_empty() {
        return Err(MeshError::NoElements(name()));
    }
    let n_nodes = own.nodes.len();
    let mut used = vec![false; n_nodes];
    let mut elements = Vec::with_capacity(own.elements.len());
    for (element, corners) in own.elements.iter().enumerate() {
        if let Some(&node) = corners.iter().find(|&&node| node as usize >= n_nodes) {
            return Err(MeshError::MissingNode { zone: name(), element, node, n_nodes });
        }
        let at = |corners: [u32; 4]| corners.map(|node| own.nodes[node as usize]);
        let sides = corners_of(corners).len();
        let convex = |p: [[f64; 2]; 4]| (0..sides).all(|k| turn(&p[..sides], k) > 0.0);
        let right = [*corners, reversed(*corners)].into_iter().find(|&corners| convex(at(corners)));
        let Some(right) = right else {
            let mean = |k: usize| at(*corners)[..sides].iter().map(|p| p[k]).sum::<f64>() / sides as f64;
            return Err(MeshError::BadElement { zone: name(), element, x: mean(0), y: mean(1) });
        };
        right.iter().for_each(|&node| used[node as usize] = true);
        elements.push(right);
    }
    let bad = |node: usize| !used[node] || !own.nodes[node].iter().all(|v| v.is_finite());
    if let Some(node) = (0..n_nodes).find(|&node| bad(node)) {
        let [x, y] = own.nodes[node];
        return Err(MeshError::BadNode { zone: name(), node, x, y });
    }
    Ok(elements)
}

impl Mesh<Px> {
    /// The same mesh on the specimen, in mm with y **up**; nodes, elements and zones keep their numbers, and corners go
    /// around each element the other way, so that they still lead from x to y: counter-clockwise. No zone has a grid.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::{mesh::{Mesh, Roi, Zone}, units::PixelSize};
    /// let roi = Roi { x0: 8.0, y0: 8.0, x1: 40.0, y1: 40.0 };
    /// let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 64, 64).unwrap();
    /// let on_specimen = mesh.to_mm(PixelSize::new(0.5).unwrap());
    /// assert_eq!((on_specimen.nodes()[0], on_specimen.nodes()[3]), ([4.0, -4.0], [4.0, -12.0]));
    /// assert_eq!((mesh.elements()[0], on_specimen.elements()[0]), ([0, 1, 4, 3], [0, 3, 4, 1]));
    /// ```
    pub fn to_mm(&self, scale: PixelSize) -> Mesh<Mm> {
        let on_specimen = |&at: &[f64; 2]| scale.to_mm(Vector::new(at)).components();
        let part = |zone: usize| {
            let first = self.first_node[zone] as u32;
            let elements = &self.elements[self.zone_elements(zone)];
            Part {
                name: self.zones[zone].clone(),
                nodes: self.nodes[self.zone_nodes(zone)].iter().map(on_specimen).collect(),
                elements: elements.iter().map(|corners| reversed(corners.map(|node| node - first))).collect(),
                grid: None,
            }
        };
        Mesh::of_parts((0..self.zones.len()).map(part).collect())
    }
}

impl<U: Length> Mesh<U> {
    /// The same mesh with its nodes at `places`; nodes, elements and zones keep their numbers. No zone has a grid.
    ///
    /// # Errors
    /// [`MeshError::BadElement`] where an element folds, with its number in its zone.
    ///
    /// # Panics
    /// When there is not one place for each node.
    pub fn with_nodes(&self, places: &[[f64; 2]]) -> Result<Self, MeshError> {
        assert_eq!(places.len(), self.n_nodes(), "one place per node");
        let part = |zone: usize| {
            let first = self.first_node[zone] as u32;
            let elements = &self.elements[self.zone_elements(zone)];
            ZoneElements {
                name: self.zones[zone].clone(),
                nodes: places[self.zone_nodes(zone)].to_vec(),
                elements: elements.iter().map(|corners| corners.map(|node| node - first)).collect(),
            }
        };
        Self::from_zones((0..self.zones.len()).map(part).collect())
    }

    /// The mesh of one whole grid per zone; node and element numbers are given here.
    ///
    /// # Panics
    /// When names and grids differ in number.
    pub fn from_grids(zones: Vec<String>, grids: Vec<Grid>) -> Self {
        assert_eq!(zones.len(), grids.len(), "one name per grid");
        Self::of_parts(zones.into_iter().zip(grids).map(|(name, grid)| Part::whole(name, grid)).collect())
    }

    /// The mesh of zones whose elements are given; each is turned so that its corners go from x to y.
    ///
    /// # Errors
    /// No zone, two of one name, and elements that are none.
    pub fn from_zones(zones: Vec<ZoneElements>) -> Result<Self, MeshError> {
        if zones.is_empty() {
            return Err(MeshError::NoZone);
        }
        let mut parts: Vec<Part> = Vec::with_capacity(zones.len());
        for zone in zones {
            if parts.iter().any(|other| other.name == zone.name) {
                return Err(MeshError::SameName(zone.name));
            }
            let elements = checked(&zone.name, &zone)?;
            parts.push(Part { name: zone.name, nodes: zone.nodes, elements, grid: None });
        }
        Ok(Self::of_parts(parts))
    }

    pub(super) fn of_parts(parts: Vec<Part>) -> Self {
        let mut mesh = Self {
            zones: Vec::new(),
            layouts: Vec::new(),
            nodes: Vec::new(),
            elements: Vec::new(),
            node_zone: Vec::new(),
            element_zone: Vec::new(),
            first_node: vec![0],
            first_element: vec![0],
            element_size: 0.0,
            unit: PhantomData,
        };
        for (zone, part) in parts.into_iter().enumerate() {
            let (first_node, first_element) = (mesh.nodes.len(), mesh.elements.len());
            mesh.elements.extend(part.elements.iter().map(|nodes| nodes.map(|node| node + first_node as u32)));
            let layout = match part.grid {
                Some((grid, element_at)) => {
                    let grid = Grid { first_node, first_element, ..grid };
                    if element_at.contains(&NONE) {
                        ZoneLayout::Part { grid, element_at }
                    } else {
                        ZoneLayout::Whole(grid)
                    }
                }
                None => ZoneLayout::Free(Bins::new(&part.nodes, &part.elements)),
            };
            mesh.nodes.extend(part.nodes);
            mesh.zones.push(part.name);
            mesh.layouts.push(layout);
            mesh.node_zone.resize(mesh.nodes.len(), zone as u32);
            mesh.element_zone.resize(mesh.elements.len(), zone as u32);
            mesh.first_node.push(mesh.nodes.len());
            mesh.first_element.push(mesh.elements.len());
        }
        let area: f64 = (0..mesh.n_elements()).map(|element| mesh.geometry(element).area()).sum();
        mesh.element_size = (area / mesh.n_elements().max(1) as f64).sqrt();
        mesh
    }

    /// Zone names, in the order of their numbers.
    pub fn zones(&self) -> &[String] {
        &self.zones
    }

    /// The grid that the elements of a zone lie on, all of it or part of it; `None` for a zone without.
    pub fn grid(&self, zone: usize) -> Option<&Grid> {
        match &self.layouts[zone] {
            ZoneLayout::Whole(grid) | ZoneLayout::Part { grid, .. } => Some(grid),
            ZoneLayout::Free(_) => None,
        }
    }

    /// The grid of a zone that holds all of its elements: nodes and elements are then numbered row by row.
    pub fn whole_grid(&self, zone: usize) -> Option<&Grid> {
        match &self.layouts[zone] {
            ZoneLayout::Whole(grid) => Some(grid),
            _ => None,
        }
    }

    /// Node positions, in `U`.
    pub fn nodes(&self) -> &[[f64; 2]] {
        &self.nodes
    }

    /// Nodes of each element at local (0,0), (1,0), (1,1), (0,1); of a triangle the last two are the same.
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
    pub fn zone_nodes(&self, zone: usize) -> Range<usize> {
        self.first_node[zone]..self.first_node[zone + 1]
    }

    /// Numbers of the elements of one zone.
    pub fn zone_elements(&self, zone: usize) -> Range<usize> {
        self.first_element[zone]..self.first_element[zone + 1]
    }

    /// Positions of the corners of an element.
    pub fn corners(&self, element: usize) -> [[f64; 2]; 4] {
        self.elements[element].map(|node| self.nodes[node as usize])
    }

    /// The box `[x0, y0, x1, y1]` around the pixels of an element, the last two not included; of an element in px.
    pub fn pixel_box(&self, element: usize) -> [usize; 4] {
        let corners = self.corners(element);
        let end = |of: fn(f64, f64) -> f64, c: usize| corners.iter().map(|corner| corner[c]).fold(corners[0][c], of);
        [end(f64::min, 0), end(f64::min, 1), end(f64::max, 0), end(f64::max, 1)].map(|at| at.ceil().max(0.0) as usize)
    }

    /// The shape of an element.
    pub fn geometry(&self, element: usize) -> ElementGeometry {
        ElementGeometry::new(self.corners(element))
    }

    /// Square root of the mean area of the elements.
    pub fn element_size(&self) -> f64 {
        self.element_size
    }

    /// The rectangle around a zone: that of its grid, or of its nodes.
    pub fn bounds(&self, zone: usize) -> Roi {
        if let Some(grid) = self.grid(zone) {
            return grid.bounds();
        }
        let [[x0, y0], [x1, y1]] = bounds(&self.nodes[self.zone_nodes(zone)]);
        Roi { x0, y0, x1, y1 }
    }

    /// The element of `zone` that holds the point, and the local coordinates (0..1) there; `None` outside.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::mesh::{Mesh, Roi, Zone};
    /// let roi = Roi { x0: 8.0, y0: 8.0, x1: 40.0, y1: 40.0 };
    /// let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 64, 64).unwrap();
    /// assert_eq!(mesh.locate(0, 28.0, 12.0), Some((1, 0.25, 0.25)));
    /// assert_eq!(mesh.locate(0, 4.0, 12.0), None);
    /// ```
    pub fn locate(&self, zone: usize, x: f64, y: f64) -> Option<(usize, f64, f64)> {
        let within = |xi: f64, eta: f64| (0.0..=1.0).contains(&xi) && (0.0..=1.0).contains(&eta);
        let (grid, at) = match &self.layouts[zone] {
            ZoneLayout::Whole(grid) => (grid, None),
            ZoneLayout::Part { grid, element_at } => (grid, Some(element_at)),
            ZoneLayout::Free(bins) => {
                let [column, row] = bins.square([x, y]);
                // On the border of an element round-off decides: a point there belongs to it.
                let near = |v: f64| (-1e-9..=1.0 + 1e-9).contains(&v);
                return bins.lists[row * bins.columns + column].iter().find_map(|&element| {
                    let element = self.first_element[zone] + element as usize;
                    let [xi, eta] = local_coordinates(self.corners(element), [x, y])?;
                    (near(xi) && near(eta)).then(|| (element, xi.clamp(0.0, 1.0), eta.clamp(0.0, 1.0)))
                });
            }
        };
        let ([i, j], [xi, eta]) = grid.cell(x, y);
        if !within(xi, eta) {
            return None;
        }
        let Some(element_at) = at else {
            return Some((self.first_element[zone] + j * grid.nx + i, xi, eta));
        };
        // A point on a line of the grid belongs to the cells on both sides: one of them may be there.
        let sides = |k: usize, s: f64| if s == 0.0 && k > 0 { vec![(k, s), (k - 1, 1.0)] } else { vec![(k, s)] };
        let cells =
            sides(j, eta).into_iter().flat_map(|(j, eta)| sides(i, xi).into_iter().map(move |(i, xi)| (i, j, xi, eta)));
        for (i, j, xi, eta) in cells {
            let element = element_at[j * grid.nx + i];
            if element != NONE {
                return Some((self.first_element[zone] + element as usize, xi, eta));
            }
        }
        None
    }

    /// As [`Mesh::locate`], over all zones.
    pub fn find(&self, x: f64, y: f64) -> Option<(usize, f64, f64)> {
        (0..self.zones.len()).find_map(|zone| self.locate(zone, x, y))
    }

    /// The element of `zone` that holds the point or is next to it, with local coordinates that go beyond
    /// 0..1 outside, by one element at most: the field is extrapolated linearly, not wildly.
    pub fn nearest(&self, zone: usize, x: f64, y: f64) -> (usize, f64, f64) {
        if let Some(found) = self.locate(zone, x, y) {
            return found;
        }
        if let ZoneLayout::Whole(grid) = &self.layouts[zone] {
            let ([i, j], [xi, eta]) = grid.cell(x, y);
            return (self.first_element[zone] + j * grid.nx + i, xi, eta);
        }
        let distance = |element: usize| {
            let corners = self.corners(element);
            let centre = |k: usize| corners.iter().map(|p| 0.25 * p[k]).sum::<f64>();
            (centre(0) - x).powi(2) + (centre(1) - y).powi(2)
        };
        let elements = self.zone_elements(zone);
        let nearest = elements.min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(0);
        let regular = self.grid(zone).is_some();
        match local_coordinates(self.corners(nearest), [x, y]) {
            Some([xi, eta]) if regular => (nearest, xi.clamp(-1.0, 2.0), eta.clamp(-1.0, 2.0)),
            Some([xi, eta]) => (nearest, xi.clamp(0.0, 1.0), eta.clamp(0.0, 1.0)),
            None => (nearest, 0.5, 0.5),
        }
    }

    /// The field with the nodal values `values` at the point of an element.
    pub fn interpolate(&self, values: &[[f64; 2]], (element, xi, eta): (usize, f64, f64)) -> [f64; 2] {
        let mut u = [0.0; 2];
        for (&node, psi) in self.elements[element].iter().zip(shape_functions(xi, eta)) {
            for c in 0..2 {
                u[c] += psi * values[node as usize][c];
            }
        }
        u
    }

    /// The edges of the elements of one zone that belong to one element alone, each as its two nodes in the order of
    /// the element's corners: with y down the inside lies to the right of the way from the first to the second.
    pub fn boundary(&self, zone: usize) -> Vec<[u32; 2]> {
        let elements = &self.elements[self.zone_elements(zone)];
        let edges = || elements.iter().flat_map(|n| (0..4).map(|k| [n[k], n[(k + 1) % 4]])).filter(|[a, b]| a != b);
        let mut count: HashMap<[u32; 2], u32> = HashMap::new();
        for [a, b] in edges() {
            *count.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
        edges().filter(|[a, b]| count[&[*a.min(b), *a.max(b)]] == 1).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_the_specimen_y_is_up_and_corners_still_lead_from_x_to_y() {
        let zone = |name: &str, left: f64| ZoneElements {
            name: name.to_owned(),
            nodes: [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [8.0, 2.0]].map(|[x, y]| [left + x, y]).to_vec(),
            elements: vec![[0, 1, 2, 3], [1, 4, 2, 2]],
        };
        let mesh = Mesh::<Px>::from_zones(vec![zone("a", 0.0), zone("b", 20.0)]).unwrap();
        let on_specimen = mesh.to_mm(PixelSize::new(0.25).unwrap());
        assert_eq!(on_specimen.zones(), mesh.zones());
        assert_eq!((on_specimen.node_zone(), on_specimen.element_zone()), (mesh.node_zone(), mesh.element_zone()));
        for (found, [x, y]) in on_specimen.nodes().iter().zip(mesh.nodes()) {
            assert_eq!(*found, [0.25 * x, -0.25 * y]);
        }
        for element in 0..mesh.n_elements() {
            let area = on_specimen.geometry(element).signed_area();
            assert_eq!(area, 0.0625 * mesh.geometry(element).signed_area(), "{:?}", on_specimen.elements()[element]);
            assert!(area > 0.0);
            let sorted = |mut nodes: [u32; 4]| {
                nodes.sort_unstable();
                nodes
            };
            let is_triangle = |nodes: [u32; 4]| nodes[2] == nodes[3];
            let (own, was) = (on_specimen.elements()[element], mesh.elements()[element]);
            assert_eq!(is_triangle(own), is_triangle(was));
            if !is_triangle(was) {
                assert_eq!(sorted(own), sorted(was));
            }
        }
        // The same place is found in the same element.
        let [px, mm] = [[26.0, 2.0], [6.5, -0.5]];
        assert_eq!(on_specimen.locate(1, mm[0], mm[1]).unwrap().0, mesh.locate(1, px[0], px[1]).unwrap().0);
    }
}
