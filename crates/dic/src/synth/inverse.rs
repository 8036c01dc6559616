//! From a pixel of the deformed image back to its material point.

use super::SynthError;
use super::kernel::{LANES, product, to_material};
use super::motion::Motion;
use std::f64::consts::PI;

/// Pixels along the side of a tile.
pub(super) const TILE: usize = 32;
/// Numbers of Chebyshev nodes per side that are tried, in this order; two are enough for affine motions.
const ORDERS: [usize; 6] = [2, 6, 10, 16, 24, 32];

/// The material points that `motion` carries to `points` of the deformed image, to 1e-12 px; `None` without a body.
///
/// # Errors
/// [`SynthError::Folded`] where the motion cannot be inverted.
pub fn inverse_at<M: Motion + ?Sized>(motion: &M, points: &[[f64; 2]]) -> Result<Vec<Option<[f64; 2]>>, SynthError> {
    let material = |&x: &[f64; 2]| {
        for body in 0..motion.n_bodies() {
            let v = solve_at(motion, body, x, None)?;
            let at = [x[0] - v[0], x[1] - v[1]];
            if motion.body_holds(body, at) {
                return Ok(Some(at));
            }
        }
        Ok(None)
    };
    points.iter().map(material).collect()
}

/// What rounding alone leaves in `v - u(x - v)`.
fn rounding(x: [f64; 2]) -> f64 {
    3e-13 + f64::EPSILON * (x[0].abs() + x[1].abs())
}

/// Solves `v = u(x - v)` by Newton from `v`, the displacement itself: a translation comes out without rounding.
fn solve<M: Motion + ?Sized>(motion: &M, body: usize, x: [f64; 2], mut v: [f64; 2]) -> Option<[f64; 2]> {
    let mut inverse = [[0.0; 2]; 2];
    let mut before = f64::INFINITY;
    for iteration in 0..50 {
        let at = [x[0] - v[0], x[1] - v[1]];
        let u = motion.body_displacement(body, at);
        let r = [u[0] - v[0], u[1] - v[1]];
        // A sum, because `max` would hide NaN.
        let size = r[0].abs() + r[1].abs();
        if size <= rounding(x) {
            return Some(u);
        }
        // The last gradient contracts by size / before or better: is another step with it the last one?
        let last = iteration > 0 && size * size <= 1e-14 * before;
        if !last {
            let [[xx, xy], [yx, yy]] = motion.body_gradient(body, at);
            let [a, d] = [1.0 + xx, 1.0 + yy];
            let det = a * d - xy * yx;
            // Written so that NaN ends here.
            if !(det > 0.0 && size.is_finite()) {
                return None;
            }
            inverse = [[d / det, -xy / det], [-yx / det, a / det]];
        }
        for (v, [by_x, by_y]) in v.iter_mut().zip(inverse) {
            *v += by_x * r[0] + by_y * r[1];
        }
        if last {
            return Some(v);
        }
        before = size;
    }
    None
}

/// Sample positions along a stretch of pixels, and the Lagrange polynomials there for every order.
pub(super) struct Axis {
    /// Positions relative to the first pixel centre, px; padded to a multiple of [`LANES`] by repetition.
    pub positions: Vec<f64>,
    half: f64,
    orders: Vec<Order>,
}

/// Chebyshev-Lobatto nodes and their Lagrange polynomials: a matrix with a row for each node, or for each point.
struct Order {
    nodes: Vec<f64>,
    /// Distance to each node from the one before it, in terms of the distance before that.
    reach: Vec<f64>,
    by_node: Vec<f64>,
    by_position: Vec<f64>,
    checks_by_node: Vec<f64>,
    checks_by_position: Vec<f64>,
}

/// Where the interpolated map is checked, as fractions of the tile.
const CHECKS: [f64; 4] = [0.03, 0.31, 0.56, 0.93];

impl Axis {
    /// `offsets` are the sample points of a pixel relative to its centre.
    pub fn new(n_pixels: usize, offsets: &[f64]) -> Self {
        let mut positions: Vec<f64> =
            (0..n_pixels).flat_map(|pixel| offsets.iter().map(move |offset| pixel as f64 + offset)).collect();
        let last = positions.last().copied().unwrap_or(0.0);
        positions.resize(positions.len().next_multiple_of(LANES), last);
        let half = 0.5 * n_pixels as f64;
        let to_unit = |position: f64| (position + 0.5) / half - 1.0;
        let orders = ORDERS
            .iter()
            .map(|&n| {
                let nodes: Vec<f64> = (0..n).map(|j| -(PI * j as f64 / (n - 1) as f64).cos()).collect();
                let by_node = lagrange(&nodes, positions.iter().map(|&p| to_unit(p)));
                let checks_by_node = lagrange(&nodes, CHECKS.iter().map(|c| 2.0 * c - 1.0));
                let by_position = transposed(&by_node, positions.len());
                let checks_by_position = transposed(&checks_by_node, CHECKS.len());
                let reach = (0..n)
                    .map(|j| if j < 2 { 0.0 } else { (nodes[j] - nodes[j - 1]) / (nodes[j - 1] - nodes[j - 2]) })
                    .collect();
                Order { nodes, reach, by_node, by_position, checks_by_node, checks_by_position }
            })
            .collect();
        Self { positions, half, orders }
    }

    /// Position (px from the first pixel centre) of a coordinate of -1..1.
    fn position(&self, unit: f64) -> f64 {
        self.half * (unit + 1.0) - 0.5
    }
}

/// Lagrange polynomials of Chebyshev-Lobatto nodes at `points`, by the barycentric formula.
fn lagrange(nodes: &[f64], points: impl ExactSizeIterator<Item = f64>) -> Vec<f64> {
    let width = points.len();
    let mut table = vec![0.0; nodes.len() * width];
    for (p, point) in points.enumerate() {
        if let Some(hit) = nodes.iter().position(|&node| node == point) {
            table[hit * width + p] = 1.0;
            continue;
        }
        let mut total = 0.0;
        for (j, &node) in nodes.iter().enumerate() {
            let sign = if j % 2 == 0 { 1.0 } else { -1.0 };
            let end = if j == 0 || j + 1 == nodes.len() { 0.5 } else { 1.0 };
            let share = sign * end / (point - node);
            table[j * width + p] = share;
            total += share;
        }
        for j in 0..nodes.len() {
            table[j * width + p] /= total;
        }
    }
    table
}

fn transposed(table: &[f64], width: usize) -> Vec<f64> {
    (0..width).flat_map(|column| table.iter().skip(column).step_by(width).copied()).collect()
}

/// Material coordinates of all sample points of a tile, row by row.
#[derive(Debug, Clone, Default)]
pub(super) struct TileMap {
    /// Columns.
    pub x: Vec<f64>,
    /// Rows.
    pub y: Vec<f64>,
    /// The smallest rectangle around them: its upper left and its lower right corner.
    pub bounds: ([f64; 2], [f64; 2]),
    /// Inverse displacements at the nodes, less that of the first.
    v: [Vec<f64>; 2],
    half_way: Vec<f64>,
}

impl TileMap {
    /// Inverts the motion of `body` on the tile whose first pixel is `corner`.
    ///
    /// The inverse displacement is as smooth as the motion: it is solved at Chebyshev nodes and interpolated between
    /// them by polynomials of an order at which the equation holds, to the rounding, at points between the nodes.
    /// Orders from `order` on are tried, and the one used is left there. Where none suffices every point is solved.
    pub fn invert<M: Motion + ?Sized>(
        &mut self,
        motion: &M,
        body: usize,
        corner: [f64; 2],
        axes: [&Axis; 2],
        order: &mut usize,
    ) -> Result<(), SynthError> {
        let [columns, rows] = axes;
        let n_points = columns.positions.len() * rows.positions.len();
        let [at_columns, at_rows] =
            [0, 1].map(|k| -> Vec<f64> { axes[k].positions.iter().map(|position| corner[k] + position).collect() });
        self.x.resize(n_points, 0.0);
        self.y.resize(n_points, 0.0);
        if !motion.is_smooth() {
            *order = ORDERS.len();
        }
        while let (Some(along_x), Some(along_y)) = (columns.orders.get(*order), rows.orders.get(*order)) {
            let base = self.solve_at_nodes(motion, body, corner, axes, [along_x, along_y])?;
            if self.holds(motion, body, corner, axes, [along_x, along_y], base) {
                let (n, width) = (along_x.nodes.len(), columns.positions.len());
                self.half_way.resize(n * width, 0.0);
                for (v, out) in self.v.iter().zip([&mut self.x, &mut self.y]) {
                    product(v, n, &along_x.by_node, width, &mut self.half_way);
                    product(&along_y.by_position, n, &self.half_way, width, out);
                }
                self.bounds = to_material(&at_columns, &at_rows, base, &mut self.x, &mut self.y);
                return Ok(());
            }
            *order += 1;
        }
        let mut at = 0;
        for &y in &at_rows {
            let mut start = None;
            for &x in &at_columns {
                let v = solve_at(motion, body, [x, y], start)?;
                start = Some(v);
                // Displacements first, to share the step to material coordinates.
                (self.x[at], self.y[at]) = (v[0], v[1]);
                at += 1;
            }
        }
        self.bounds = to_material(&at_columns, &at_rows, [0.0, 0.0], &mut self.x, &mut self.y);
        // The motion may be gentler in the next tile.
        *order = ORDERS.len() - 1;
        Ok(())
    }

    /// Fills `v`; returns what was subtracted, so that a translation passes without rounding.
    fn solve_at_nodes<M: Motion + ?Sized>(
        &mut self,
        motion: &M,
        body: usize,
        corner: [f64; 2],
        axes: [&Axis; 2],
        orders: [&Order; 2],
    ) -> Result<[f64; 2], SynthError> {
        for v in &mut self.v {
            v.clear();
        }
        let base = solve_at(motion, body, corner, None)?;
        let mut start_of_row = base;
        for &at_y in &orders[1].nodes {
            // The line through the last two nodes is a good start.
            let (mut near, mut far) = (start_of_row, start_of_row);
            for (j, &at_x) in orders[0].nodes.iter().enumerate() {
                let x = [corner[0] + axes[0].position(at_x), corner[1] + axes[1].position(at_y)];
                let reach = orders[0].reach[j];
                let start = [0, 1].map(|k| near[k] + reach * (near[k] - far[k]));
                let v = solve_at(motion, body, x, Some(start))?;
                if j == 0 {
                    (near, start_of_row) = (v, v);
                }
                (far, near) = (near, v);
                for k in 0..2 {
                    self.v[k].push(v[k] - base[k]);
                }
            }
        }
        Ok(base)
    }

    /// Whether the interpolated map satisfies `v = u(x - v)` between the nodes.
    fn holds<M: Motion + ?Sized>(
        &self,
        motion: &M,
        body: usize,
        corner: [f64; 2],
        axes: [&Axis; 2],
        orders: [&Order; 2],
        base: [f64; 2],
    ) -> bool {
        const N: usize = CHECKS.len();
        let n = orders[0].nodes.len();
        let mut half_way = [0.0; N * ORDERS[ORDERS.len() - 1]];
        let mut v = [[0.0; N * N]; 2];
        for (all, v) in self.v.iter().zip(&mut v) {
            product(all, n, &orders[0].checks_by_node, N, &mut half_way[..N * n]);
            product(&orders[1].checks_by_position, n, &half_way[..N * n], N, v);
        }
        (0..N * N).all(|at| {
            let x = [0, 1].map(|k| {
                let check = if k == 0 { CHECKS[at % N] } else { CHECKS[at / N] };
                corner[k] + axes[k].position(2.0 * check - 1.0)
            });
            let v = [base[0] + v[0][at], base[1] + v[1][at]];
            let u = motion.body_displacement(body, [x[0] - v[0], x[1] - v[1]]);
            (u[0] - v[0]).abs() + (u[1] - v[1]).abs() <= rounding(x)
        })
    }
}

fn solve_at<M: Motion + ?Sized>(
    motion: &M,
    body: usize,
    x: [f64; 2],
    start: Option<[f64; 2]>,
) -> Result<[f64; 2], SynthError> {
    start
        .and_then(|start| solve(motion, body, x, start))
        .or_else(|| solve(motion, body, x, motion.body_displacement(body, x)))
        .ok_or(SynthError::Folded(x[0], x[1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::{Accuracy, Peel, Rotation, Sinusoids, Star, Translation};

    #[track_caller]
    fn assert_inverse(motion: &impl Motion, corner: [f64; 2], n_pixels: [usize; 2]) {
        let offsets = [-0.25, 0.25];
        let axes = n_pixels.map(|n| Axis::new(n, &offsets));
        let mut map = TileMap::default();
        for body in 0..motion.n_bodies() {
            map.invert(motion, body, corner, [&axes[0], &axes[1]], &mut 0).unwrap();
            let width = axes[0].positions.len();
            for (at, (&x, &y)) in map.x.iter().zip(&map.y).enumerate() {
                let want = [corner[0] + axes[0].positions[at % width], corner[1] + axes[1].positions[at / width]];
                let u = motion.body_displacement(body, [x, y]);
                let error = (x + u[0] - want[0]).abs().max((y + u[1] - want[1]).abs());
                assert!(error < 2e-12, "off by {error:e} px at {want:?}, body {body}");
            }
        }
    }

    #[test]
    fn every_point_of_a_tile_is_inverted_to_a_few_roundings() {
        // 2e-12 px: the check allows 3e-13 plus the rounding of coordinates near 1000, 2.3e-13 each.
        for corner in [[0.0, 0.0], [480.0, 512.0], [992.0, 960.0]] {
            assert_inverse(&Translation([0.3, -7.7]), corner, [32, 32]);
            assert_inverse(&Rotation::new(30.0, 1024, 1024), corner, [32, 32]);
            assert_inverse(&Sinusoids { amplitude: 2.0, wavelength: 40.0 }, corner, [32, 32]);
            assert_inverse(&Accuracy::new(1024, 1024), corner, [32, 5]);
            assert_inverse(&Star::new(1024, 1024), corner, [32, 32]);
            assert_inverse(&Peel::new(1024, 1024), corner, [1, 32]);
        }
    }
}
