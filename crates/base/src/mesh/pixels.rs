//! The pixels of each element.

use super::element::local_coordinates;
use super::grid::Grid;
use super::pixel_set::PixelSet;
use super::q4::Mesh;
use crate::plane::bounds;
use crate::units::Px;

/// The pixels of one element and their local coordinates.
///
/// With `n_runs == 0` they are a rectangle of `nx` columns and `ny` rows from (x, y) on; column k is at `xi0 + k dxi`,
/// row k at `eta0 + k deta`. Else they are the runs from `first_run` on, and the rectangle is the one around them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementPixels {
    /// First column.
    pub x: i32,
    /// First row.
    pub y: i32,
    /// Columns.
    pub nx: u16,
    /// Rows.
    pub ny: u16,
    /// Local coordinate of the first column.
    pub xi0: f32,
    /// Its increment.
    pub dxi: f32,
    /// Local coordinate of the first row.
    pub eta0: f32,
    /// Its increment.
    pub deta: f32,
    /// Number of the first run.
    pub first_run: u32,
    /// Number of runs.
    pub n_runs: u32,
}

impl ElementPixels {
    /// No pixel at all.
    pub const NONE: Self =
        Self { x: 0, y: 0, nx: 0, ny: 0, xi0: 0.0, dxi: 0.0, eta0: 0.0, deta: 0.0, first_run: 0, n_runs: 0 };
}

/// Neighbouring pixels of one row that belong to one element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// First column.
    pub x: i32,
    /// Row.
    pub y: i32,
    /// Pixels.
    pub n: u32,
    /// Where their local coordinates begin.
    pub at: u32,
}

/// The pixels of all elements: of the zone, with the centre in an element, left and upper edge included.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PixelMap {
    elements: Vec<ElementPixels>,
    runs: Vec<Run>,
    xi: Vec<f32>,
    eta: Vec<f32>,
}

/// Longest vector that kernels read local coordinates with.
const PADDING: usize = 16;

impl PixelMap {
    /// The pixels of `mesh` on an image of `width` x `height` px, where `zones` holds those of each zone.
    pub(super) fn new(mesh: &Mesh<Px>, zones: &[PixelSet], image: [usize; 2]) -> Self {
        let mut map = Self { elements: Vec::with_capacity(mesh.n_elements()), ..Self::default() };
        for (zone, set) in zones.iter().enumerate() {
            match mesh.grid(zone) {
                Some(grid) => map.add_grid(mesh, zone, grid, set, image),
                None => map.add_free(mesh, zone, set, image),
            }
        }
        for local in [&mut map.xi, &mut map.eta] {
            local.resize(local.len() + PADDING, 0.0);
        }
        map
    }

    fn add_grid(&mut self, mesh: &Mesh<Px>, zone: usize, grid: &Grid, set: &PixelSet, image: [usize; 2]) {
        let cells: Vec<Cell> = cells(grid, image).collect();
        for element in mesh.zone_elements(zone) {
            let [i, j] = grid.column_and_row(mesh.nodes()[mesh.elements()[element][0] as usize]);
            let cell = &cells[j * grid.nx + i];
            let [x0, y0, x1, y1] = cell.bounds;
            match set {
                // What a guard leaves of an element is a rectangle again.
                PixelSet::Box { x0: bx0, y0: by0, x1: bx1, y1: by1 } => {
                    self.elements.push(cell.pixels([x0.max(*bx0), y0.max(*by0), x1.min(*bx1), y1.min(*by1)]));
                }
                PixelSet::Raster { .. } if set.count(cell.bounds) == (x1 - x0) * (y1 - y0) => {
                    self.elements.push(cell.pixels(cell.bounds));
                }
                PixelSet::Raster { .. } => {
                    let whole = cell.pixels(cell.bounds);
                    let local = |x: usize, y: usize| {
                        let (k, l) = ((x - x0) as f32, (y - y0) as f32);
                        [whole.xi0 + k * whole.dxi, whole.eta0 + l * whole.deta]
                    };
                    let inside = |x: usize, y: usize| set.contains(x, y).then(|| local(x, y));
                    self.add_runs(cell.bounds, inside);
                }
            }
        }
    }

    fn add_free(&mut self, mesh: &Mesh<Px>, zone: usize, set: &PixelSet, [width, height]: [usize; 2]) {
        for element in mesh.zone_elements(zone) {
            let corners = mesh.corners(element);
            if let Some(cell) = Cell::of(corners, [width, height])
                && set.count(cell.bounds) == cell.n_pixels()
            {
                self.elements.push(cell.pixels(cell.bounds));
                continue;
            }
            let owns = Owner::new(mesh.elements()[element], corners);
            let bounds = around(&corners, width, height);
            self.add_runs(bounds, |x, y| {
                let p = [x as f64, y as f64];
                let local = (set.contains(x, y) && owns.pixel(p)).then(|| local_coordinates(corners, p))??;
                Some(local.map(|v| v.clamp(0.0, 1.0) as f32))
            });
        }
    }

    /// Adds an element of the pixels in `bounds` for which `local` gives coordinates.
    fn add_runs(&mut self, [x0, y0, x1, y1]: [usize; 4], local: impl Fn(usize, usize) -> Option<[f32; 2]>) {
        let first_run = self.runs.len();
        for y in y0..y1 {
            let mut run: Option<Run> = None;
            for x in x0..x1 {
                let Some([xi, eta]) = local(x, y) else {
                    self.runs.extend(run.take());
                    continue;
                };
                let begin = Run { x: x as i32, y: y as i32, n: 0, at: self.xi.len() as u32 };
                run.get_or_insert(begin).n += 1;
                self.xi.push(xi);
                self.eta.push(eta);
            }
            self.runs.extend(run);
        }
        let n_runs = self.runs.len() - first_run;
        if n_runs == 0 {
            self.elements.push(ElementPixels::NONE);
            return;
        }
        self.elements.push(ElementPixels {
            x: x0 as i32,
            y: y0 as i32,
            nx: (x1 - x0) as u16,
            ny: (y1 - y0) as u16,
            first_run: first_run as u32,
            n_runs: n_runs as u32,
            ..ElementPixels::NONE
        });
    }

    /// Of each element.
    pub fn elements(&self) -> &[ElementPixels] {
        &self.elements
    }

    /// Runs of the elements that are no rectangle of pixels.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Local coordinates xi of the pixels of the runs; padded, so that whole vectors can be read from each.
    pub fn xi(&self) -> &[f32] {
        &self.xi
    }

    /// Local coordinates eta of the same.
    pub fn eta(&self) -> &[f32] {
        &self.eta
    }

    /// The runs of an element; none when its pixels are a rectangle.
    pub fn runs_of(&self, element: &ElementPixels) -> &[Run] {
        &self.runs[element.first_run as usize..][..element.n_runs as usize]
    }

    /// Calls `visit(x, y, xi, eta)` for every pixel of an element.
    pub fn for_each(&self, element: &ElementPixels, mut visit: impl FnMut(i32, i32, f32, f32)) {
        for run in self.runs_of(element) {
            for k in 0..run.n {
                let at = (run.at + k) as usize;
                visit(run.x + k as i32, run.y, self.xi[at], self.eta[at]);
            }
        }
        if element.n_runs > 0 {
            return;
        }
        for row in 0..i32::from(element.ny) {
            for column in 0..i32::from(element.nx) {
                let (xi, eta) = (element.xi0 + column as f32 * element.dxi, element.eta0 + row as f32 * element.deta);
                visit(element.x + column, element.y + row, xi, eta);
            }
        }
    }
}

/// A cell of a grid and the pixels whose centre lies in its half-open rectangle.
pub(super) struct Cell {
    /// Columns and rows of its pixels: `[x0, y0, x1, y1]`, the last two not included.
    pub bounds: [usize; 4],
    origin: [f64; 2],
    size: [f64; 2],
}

impl Cell {
    /// The cell with these corners, when they are those of an upright rectangle in the order of the local coordinates.
    fn of([a, b, c, d]: [[f64; 2]; 4], [width, height]: [usize; 2]) -> Option<Self> {
        let upright = a[1] == b[1] && b[0] == c[0] && c[1] == d[1] && d[0] == a[0] && b[0] > a[0] && d[1] > a[1];
        let first = |v: f64, n: usize| v.ceil().clamp(0.0, n as f64) as usize;
        let bounds = [first(a[0], width), first(a[1], height), first(c[0], width), first(c[1], height)];
        upright.then_some(Self { bounds, origin: a, size: [b[0] - a[0], d[1] - a[1]] })
    }

    fn n_pixels(&self) -> usize {
        let [x0, y0, x1, y1] = self.bounds;
        (x1 - x0) * (y1 - y0)
    }

    /// Those of its pixels that lie in `[x0, y0, x1, y1]`.
    fn pixels(&self, [x0, y0, x1, y1]: [usize; 4]) -> ElementPixels {
        if x0 >= x1 || y0 >= y1 {
            return ElementPixels::NONE;
        }
        let local = |v: usize, k: usize| ((v as f64 - self.origin[k]) / self.size[k]) as f32;
        ElementPixels {
            x: x0 as i32,
            y: y0 as i32,
            nx: (x1 - x0) as u16,
            ny: (y1 - y0) as u16,
            xi0: local(x0, 0),
            dxi: (1.0 / self.size[0]) as f32,
            eta0: local(y0, 1),
            deta: (1.0 / self.size[1]) as f32,
            ..ElementPixels::NONE
        }
    }
}

/// The cells of a grid, row by row.
pub(super) fn cells(grid: &Grid, [width, height]: [usize; 2]) -> impl Iterator<Item = Cell> + use<> {
    let grid = *grid;
    let first = |origin: f64, h: f64, k: usize, n: usize| (origin + k as f64 * h).ceil().clamp(0.0, n as f64) as usize;
    (0..grid.ny).flat_map(move |j| {
        let (y0, y1) = (first(grid.y0, grid.hy, j, height), first(grid.y0, grid.hy, j + 1, height));
        (0..grid.nx).map(move |i| {
            let (x0, x1) = (first(grid.x0, grid.hx, i, width), first(grid.x0, grid.hx, i + 1, width));
            Cell { bounds: [x0, y0, x1, y1], origin: grid.position(i, j), size: [grid.hx, grid.hy] }
        })
    })
}

pub(super) fn around(corners: &[[f64; 2]; 4], width: usize, height: usize) -> [usize; 4] {
    let [[x0, y0], [x1, y1]] = bounds(corners);
    let pixel = |v: f64, n: usize| v.clamp(0.0, n as f64) as usize;
    let (behind_x, behind_y) = (x1.floor() + 1.0, y1.floor() + 1.0);
    [pixel(x0.ceil(), width), pixel(y0.ceil(), height), pixel(behind_x, width), pixel(behind_y, height)]
}

/// Decides which pixels an element of any shape owns alone: one on an edge goes to the element to its right or below.
pub(super) struct Owner([Option<Edge>; 4]);

/// The line between two nodes, from the smaller number to the larger: both elements that share it compute its bits.
struct Edge {
    from: [f64; 2],
    way: [f64; 2],
    sense: f64,
    keeps_border: bool,
}

impl Owner {
    pub fn new(nodes: [u32; 4], corners: [[f64; 2]; 4]) -> Self {
        Self(std::array::from_fn(|k| {
            let next = (k + 1) % 4;
            if nodes[k] == nodes[next] {
                return None; // the fourth side of a triangle
            }
            let (a, b) = (corners[k], corners[next]);
            let swapped = nodes[k] > nodes[next];
            let (from, to) = if swapped { (b, a) } else { (a, b) };
            // Corners go from x to y: a left edge leads up, an upper one to the right.
            let keeps_border = b[1] < a[1] || (b[1] == a[1] && b[0] > a[0]);
            let sense = if swapped { -1.0 } else { 1.0 };
            Some(Edge { from, way: [to[0] - from[0], to[1] - from[1]], sense, keeps_border })
        }))
    }

    pub fn pixel(&self, [x, y]: [f64; 2]) -> bool {
        self.0.iter().flatten().all(|edge| {
            let side = edge.sense * (edge.way[0] * (y - edge.from[1]) - edge.way[1] * (x - edge.from[0]));
            side > 0.0 || (side == 0.0 && edge.keeps_border)
        })
    }
}

/// The pixels that elements of any shape cover.
pub(super) fn covered(nodes: &[[f64; 2]], elements: &[[u32; 4]], [width, height]: [usize; 2]) -> PixelSet {
    let mut bits = vec![false; width * height];
    for element in elements {
        let corners = element.map(|node| nodes[node as usize]);
        let owner = Owner::new(*element, corners);
        let [x0, y0, x1, y1] = around(&corners, width, height);
        for y in y0..y1 {
            for x in x0..x1 {
                bits[y * width + x] |= owner.pixel([x as f64, y as f64]);
            }
        }
    }
    PixelSet::Raster { x0: 0, y0: 0, width, bits }
}

pub(super) fn shared(mesh: &Mesh<Px>, pixels: &PixelMap, [width, height]: [usize; 2]) -> Option<[usize; 2]> {
    let mut owner = vec![0u32; width * height];
    let mut found = None;
    for (element, of) in pixels.elements.iter().enumerate() {
        let zone = mesh.element_zone()[element];
        pixels.for_each(of, |x, y, _, _| {
            let owner = &mut owner[y as usize * width + x as usize];
            if *owner > 0 && *owner != zone + 1 {
                found.get_or_insert([*owner as usize - 1, zone as usize]);
            }
            *owner = zone + 1;
        });
    }
    found
}
