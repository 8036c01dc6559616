//! The regular grid of a zone, and the shape functions of its elements.

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

    /// Column and row of the element that holds `(x, y)` and the local coordinates (0..1) there. Points
    /// outside get the nearest element and local coordinates beyond 0..1, so that the field is
    /// extrapolated linearly.
    pub(super) fn cell(&self, x: f64, y: f64) -> ([usize; 2], [f64; 2]) {
        let (s, t) = ((x - self.x0) / self.hx, (y - self.y0) / self.hy);
        let i = (s.floor().max(0.0) as usize).min(self.nx - 1);
        let j = (t.floor().max(0.0) as usize).min(self.ny - 1);
        ([i, j], [s - i as f64, t - j as f64])
    }
}

/// Bilinear shape functions at the local coordinates (0..1), in the order of an element's nodes:
/// (0,0), (1,0), (1,1), (0,1).
pub fn shape_functions(xi: f64, eta: f64) -> [f64; 4] {
    [(1.0 - xi) * (1.0 - eta), xi * (1.0 - eta), xi * eta, (1.0 - xi) * eta]
}

/// The local coordinates at which the element with these corners has the point `p`; beyond 0..1 outside of
/// it. `None` where there are none (far outside a distorted element).
pub fn local_coordinates(corners: [[f64; 2]; 4], p: [f64; 2]) -> Option<[f64; 2]> {
    let [a, b, c, d] = corners;
    let minus = |u: [f64; 2], v: [f64; 2]| [u[0] - v[0], u[1] - v[1]];
    let cross = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
    if c == d {
        // A triangle: its area coordinates are (1 - xi)(1 - eta), xi (1 - eta), eta.
        let area = cross(minus(b, a), minus(c, a));
        let (second, third) = (cross(minus(p, a), minus(c, a)) / area, cross(minus(b, a), minus(p, a)) / area);
        let rest = 1.0 - third;
        let xi = if rest.abs() > 1e-12 { second / rest } else { 0.0 };
        return Some([xi, third]);
    }
    let (e, f) = (minus(b, a), minus(d, a));
    let twist = [a[0] - b[0] + c[0] - d[0], a[1] - b[1] + c[1] - d[1]];
    let (mut xi, mut eta) = (0.5, 0.5);
    for _ in 0..30 {
        let at = |k: usize| a[k] + xi * e[k] + eta * f[k] + xi * eta * twist[k] - p[k];
        let rest = [at(0), at(1)];
        let by_xi = [e[0] + eta * twist[0], e[1] + eta * twist[1]];
        let by_eta = [f[0] + xi * twist[0], f[1] + xi * twist[1]];
        let area = cross(by_xi, by_eta);
        let step = [cross(rest, by_eta) / area, cross(by_xi, rest) / area];
        xi -= step[0];
        eta -= step[1];
        if !(xi.is_finite() && eta.is_finite()) {
            return None;
        }
        if step[0].abs() + step[1].abs() < 1e-14 {
            break;
        }
    }
    let psi = shape_functions(xi, eta);
    let off = |k: usize| corners.iter().zip(psi).map(|(corner, psi)| psi * corner[k]).sum::<f64>() - p[k];
    let size = e[0].abs() + e[1].abs() + f[0].abs() + f[1].abs();
    (off(0).abs() + off(1).abs() < 1e-9 * size).then_some([xi, eta])
}
