//! The regular grid of a zone.

/// A regular grid of `nx` by `ny` elements of `hx` by `hy`.
///
/// Node (i, j) stands at `(x0 + i hx, y0 + j hy)`. Where a zone holds the whole grid, that node has the number
/// `first_node + j (nx + 1) + i` and element (i, j) the number `first_element + j nx + i`.
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
    /// Number of nodes of the whole grid.
    pub fn n_nodes(&self) -> usize {
        (self.nx + 1) * (self.ny + 1)
    }

    /// Number of elements of the whole grid.
    pub fn n_elements(&self) -> usize {
        self.nx * self.ny
    }

    /// Number, in the mesh, of the node in column `i` and row `j` of the whole grid.
    pub fn node(&self, i: usize, j: usize) -> usize {
        self.first_node + j * (self.nx + 1) + i
    }

    /// Position of the node in column `i` and row `j`.
    pub fn position(&self, i: usize, j: usize) -> [f64; 2] {
        [self.x0 + i as f64 * self.hx, self.y0 + j as f64 * self.hy]
    }

    /// Column and row of the node at a position.
    pub fn column_and_row(&self, [x, y]: [f64; 2]) -> [usize; 2] {
        [((x - self.x0) / self.hx).round() as usize, ((y - self.y0) / self.hy).round() as usize]
    }

    /// The rectangle that it covers.
    pub fn bounds(&self) -> super::Roi {
        let [x1, y1] = self.position(self.nx, self.ny);
        super::Roi { x0: self.x0, y0: self.y0, x1, y1 }
    }

    /// Column and row of the element that holds `(x, y)` and the local coordinates (0..1) there. Points outside get the
    /// nearest element and local coordinates beyond 0..1, so that the field is extrapolated linearly.
    pub(super) fn cell(&self, x: f64, y: f64) -> ([usize; 2], [f64; 2]) {
        let (s, t) = ((x - self.x0) / self.hx, (y - self.y0) / self.hy);
        let i = (s.floor().max(0.0) as usize).min(self.nx - 1);
        let j = (t.floor().max(0.0) as usize).min(self.ny - 1);
        ([i, j], [s - i as f64, t - j as f64])
    }
}
