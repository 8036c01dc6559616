//! From a pixel of the deformed image back to its material point.

use super::SynthError;
use super::kernel::{LANES, add_products};
use super::motion::Motion;
use std::f64::consts::PI;

/// Pixels along the side of a tile.
pub(super) const TILE: usize = 32;
/// Numbers of Chebyshev nodes per side that are tried, in this order; two are enough for affine motions.
const ORDERS: [usize; 6] = [2, 6, 10, 16, 24, 32];

/// The material points that `motion` carries to `points` of the deformed image, to about 1e-12 px; `None`
/// where there is no body.
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

/// Solves `v = u(x - v)` by Newton from `v`; the unknown is the displacement itself, so that a
/// translation comes out without rounding.
fn solve<M: Motion + ?Sized>(motion: &M, body: usize, x: [f64; 2], mut v: [f64; 2]) -> Option<[f64; 2]> {
    for _ in 0..50 {
        let at = [x[0] - v[0], x[1] - v[1]];
        let u = motion.body_displacement(body, at);
        let r = [u[0] - v[0], u[1] - v[1]];
        // A sum, because `max` would hide NaN.
        let size = r[0].abs() + r[1].abs();
        if size <= rounding(x) {
            return Some(u);
        }
        let [[xx, xy], [yx, yy]] = motion.body_gradient(body, at);
        let [a, d] = [1.0 + xx, 1.0 + yy];
        let det = a * d - xy * yx;
        // Written so that NaN ends here.
        if !(det > 0.0 && size.is_finite()) {
            return None;
        }
        v = [v[0] + (d * r[0] - xy * r[1]) / det, v[1] + (a * r[1] - yx * r[0]) / det];
    }
    None
}

/// Sample positions along a stretch of pixels, and the Lagrange polynomials there for every order.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    /// Positions relative to the first pixel centre, px; padded to a multiple of [`LANES`] by repetition.
    pub positions: Vec<f64>,
    half: f64,
    orders: Vec<Order>,
}

/// Chebyshev-Lobatto nodes and their Lagrange polynomials.
#[derive(Debug, Clone)]
struct Order {
    nodes: Vec<f64>,
    /// `at_positions[j * n_positions + p]`: polynomial of node `j` at position `p`.
    at_positions: Vec<f64>,
    /// `at_checks[j * CHECKS.len() + c]`.
    at_checks: Vec<f64>,
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
                let at_positions = lagrange(&nodes, positions.iter().map(|&p| to_unit(p)));
                let at_checks = lagrange(&nodes, CHECKS.iter().map(|c| 2.0 * c - 1.0));
                Order { nodes, at_positions, at_checks }
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

/// Material coordinates of all sample points of a tile, row by row.
#[derive(Debug, Clone, Default)]
pub(super) struct TileMap {
    /// Columns.
    pub x: Vec<f64>,
    /// Rows.
    pub y: Vec<f64>,
}

impl TileMap {
    /// Inverts the motion of `body` on the tile whose first pixel is `corner`.
    ///
    /// The inverse displacement is as smooth as the motion: it is solved at Chebyshev nodes and
    /// interpolated between them by polynomials of an order at which the equation holds, to the rounding,
    /// at points between the nodes. Where no order suffices every point is solved.
    pub fn invert<M: Motion + ?Sized>(
        &mut self,
        motion: &M,
        body: usize,
        corner: [f64; 2],
        axes: [&Axis; 2],
    ) -> Result<(), SynthError> {
        let (width, height) = (axes[0].positions.len(), axes[1].positions.len());
        self.x.clear();
        self.x.resize(width * height, 0.0);
        self.y.clear();
        self.y.resize(width * height, 0.0);
        let [columns, rows] = axes;
        for (along_x, along_y) in columns.orders.iter().zip(&rows.orders) {
            let base = solve_at(motion, body, [corner[0] - 0.5, corner[1] - 0.5], None)?;
            let n = along_x.nodes.len();
            // Differences to one value, so that a translation passes without rounding.
            let (mut vx, mut vy) = (vec![0.0; n * n], vec![0.0; n * n]);
            let mut start = base;
            for (i, &at_y) in along_y.nodes.iter().enumerate() {
                for (j, &at_x) in along_x.nodes.iter().enumerate() {
                    let x = [corner[0] + columns.position(at_x), corner[1] + rows.position(at_y)];
                    let v = solve_at(motion, body, x, Some(start))?;
                    (vx[i * n + j], vy[i * n + j]) = (v[0] - base[0], v[1] - base[1]);
                    start = if j + 1 < n { v } else { [vx[i * n] + base[0], vy[i * n] + base[1]] };
                }
            }
            let holds = CHECKS.iter().enumerate().all(|(q, &at_y)| {
                let mut sums = [[0.0; CHECKS.len()]; 2];
                for (sums, v) in sums.iter_mut().zip([&vx, &vy]) {
                    let at_row = collapse(&along_y.at_checks, CHECKS.len(), q, v, n);
                    add_products(&along_x.at_checks, &at_row, sums);
                }
                CHECKS.iter().enumerate().all(|(p, &at_x)| {
                    let v = [base[0] + sums[0][p], base[1] + sums[1][p]];
                    let x =
                        [corner[0] + columns.position(2.0 * at_x - 1.0), corner[1] + rows.position(2.0 * at_y - 1.0)];
                    let u = motion.body_displacement(body, [x[0] - v[0], x[1] - v[1]]);
                    (u[0] - v[0]).abs() + (u[1] - v[1]).abs() <= rounding(x)
                })
            });
            if holds {
                for row in 0..height {
                    for (axis, v, out) in [(0, &vx, &mut self.x), (1, &vy, &mut self.y)] {
                        let out = &mut out[row * width..][..width];
                        let at_row = collapse(&along_y.at_positions, height, row, v, n);
                        add_products(&along_x.at_positions, &at_row, out);
                        for (out, &column) in out.iter_mut().zip(&columns.positions) {
                            let position = if axis == 0 { column } else { rows.positions[row] };
                            *out = (corner[axis] + position) - (base[axis] + *out);
                        }
                    }
                }
                return Ok(());
            }
        }
        for (row, &at_y) in rows.positions.iter().enumerate() {
            let mut start = None;
            for (column, &at_x) in columns.positions.iter().enumerate() {
                let x = [corner[0] + at_x, corner[1] + at_y];
                let v = solve_at(motion, body, x, start)?;
                start = Some(v);
                (self.x[row * width + column], self.y[row * width + column]) = (x[0] - v[0], x[1] - v[1]);
            }
        }
        Ok(())
    }
}

/// The values of the nodes' columns at one row: `sum_i weights[i][row] v[i][j]`.
fn collapse(weights: &[f64], n_rows: usize, row: usize, v: &[f64], n: usize) -> Vec<f64> {
    let mut sums = vec![0.0; n];
    for (i, v) in v.chunks_exact(n).enumerate() {
        let weight = weights[i * n_rows + row];
        for (sum, v) in sums.iter_mut().zip(v) {
            *sum += weight * v;
        }
    }
    sums
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
        .ok_or(SynthError::Folded { x: x[0], y: x[1] })
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
            map.invert(motion, body, corner, [&axes[0], &axes[1]]).unwrap();
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
