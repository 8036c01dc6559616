//! Displacements that are cubic splines: what the nodes of a mesh are bound to.

use crate::linalg::Subspace;
use crate::mesh::{Grid, Mesh};
use crate::units::Px;

/// Elements of the mesh from knot to knot. What is bilinear on half the distance follows a cubic spline so closely that
/// noise and resolution are those of the spline itself (`scripts/noise_resolution.py`).
pub(crate) const KNOT_ELEMENTS: usize = 2;

/// The cubic B-spline whose middle is `t` knots away.
fn cubic(t: f64) -> f64 {
    let t = t.abs();
    match t {
        ..1.0 => 2.0 / 3.0 - t * t + 0.5 * t * t * t,
        ..2.0 => (2.0 - t).powi(3) / 6.0,
        _ => 0.0,
    }
}

/// The fields on `mesh` whose values at the nodes are those of a bicubic spline, one for each zone, with knots
/// [`KNOT_ELEMENTS`] elements apart; `None` where a zone has no grid.
///
/// Every function with a value at a node is one of them: at a border, too, no cubic polynomial is missing.
pub(crate) fn splines(mesh: &Mesh<Px>) -> Option<Subspace> {
    let mut of_nodes = Vec::with_capacity(mesh.n_nodes());
    let (mut coupled, mut lines, mut middles) = (Vec::<Vec<u32>>::new(), Vec::new(), Vec::new());
    for zone in 0..mesh.zones().len() {
        let functions = Functions::new(mesh.grid(zone)?);
        let places: Vec<[usize; 2]> =
            mesh.zone_nodes(zone).map(|node| functions.grid.column_and_row(mesh.nodes()[node])).collect();
        let mut number = vec![u32::MAX; functions.columns * functions.rows];
        for (column, row, _) in places.iter().flat_map(|&at| functions.at(at)) {
            number[row * functions.columns + column] = 0;
        }
        let first = coupled.len() as u32;
        (first..).zip(number.iter_mut().filter(|number| **number == 0)).for_each(|(next, number)| *number = next);
        let of = |column: usize, row: usize| number[row * functions.columns + column];
        let there = |column: usize, row: usize| {
            let is_in = column < functions.columns && row < functions.rows;
            Some(of(column.min(functions.columns - 1), row.min(functions.rows - 1))).filter(|&n| is_in && n != u32::MAX)
        };
        of_nodes.extend(
            places.iter().map(|&at| functions.at(at).map(|(column, row, value)| (of(column, row), value)).collect()),
        );
        for row in 0..functions.rows {
            for column in 0..functions.columns {
                let Some(own) = there(column, row) else { continue };
                let near = |at: usize| at.saturating_sub(3)..at + 4;
                coupled.push(near(row).flat_map(|j| near(column).filter_map(move |i| there(i, j))).collect());
                middles.push([column as f64 * functions.grid.hx, row as f64 * functions.grid.hy]);
                let line = |[a, b]: [Option<u32>; 2]| Some([own, a?, b?]);
                lines.extend(line([1, 2].map(|k| there(column + k, row))));
                lines.extend(line([1, 2].map(|k| there(column, row + k))));
            }
        }
    }
    Some(Subspace::new(&of_nodes, &coupled, &lines, &middles))
}

/// Standard uncertainty of a value at each node (`crate::field::PointFilter`) over that of its coefficient, by its
/// column and row: neighbouring coefficients scatter nearly alike, so that the filter takes less of it than between
/// elements of their own. Two elements from a border, and in a zone that is no rectangle, both are alike.
pub(crate) fn noise_of_values(mesh: &Mesh<Px>) -> Vec<f64> {
    let of_node = |(at, &zone): (&[f64; 2], &u32)| {
        let Some(grid) = mesh.whole_grid(zone as usize) else { return 1.0 };
        let along = |at: usize, n: usize| {
            let is_inside = (2..=n.saturating_sub(2)).contains(&at);
            is_inside.then_some(OF_VALUE[at % KNOT_ELEMENTS])
        };
        let [column, row] = grid.column_and_row(*at);
        along(column, grid.nx).zip(along(row, grid.ny)).map_or(1.0, |(x, y)| x * y)
    };
    mesh.nodes().iter().zip(mesh.node_zone()).map(of_node).collect()
}

/// Of values over coefficients along an axis, at a knot and between two, for a texture alike everywhere.
const OF_VALUE: [f64; 2] = [0.914_374, 0.960_425];

/// The functions of a zone: those whose middles are on its knots, and one more at each side.
struct Functions<'a> {
    grid: &'a Grid,
    columns: usize,
    rows: usize,
}

impl<'a> Functions<'a> {
    fn new(grid: &'a Grid) -> Self {
        let [columns, rows] = [grid.nx, grid.ny].map(|n| n.div_ceil(KNOT_ELEMENTS) + 3);
        Self { grid, columns, rows }
    }

    /// Those that have a value at the node of a column and row of the grid: column, row and value.
    fn at(&self, node: [usize; 2]) -> impl Iterator<Item = (usize, usize, f64)> {
        let along = |at: usize| {
            let knots = at as f64 / KNOT_ELEMENTS as f64;
            let first = at / KNOT_ELEMENTS;
            (first..first + 4).map(move |k| (k, cubic(knots - (k as f64 - 1.0)))).filter(|(_, value)| *value > 0.0)
        };
        let [column, row] = node;
        along(row).flat_map(move |(j, by_row)| along(column).map(move |(i, by_column)| (i, j, by_row * by_column)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::{BlockMatrix, Pattern, alike};
    use crate::mesh::{Roi, Zone};
    use std::sync::Arc;

    /// Means of the products of the shape functions over a square.
    const PRODUCTS: [[f64; 4]; 4] =
        [[4.0, 2.0, 1.0, 2.0], [2.0, 4.0, 2.0, 1.0], [1.0, 2.0, 4.0, 2.0], [2.0, 1.0, 2.0, 4.0]];

    fn rectangle(nx: usize, ny: usize) -> Mesh<Px> {
        let roi = Roi { x0: 8.0, y0: 8.0, x1: 8.0 + 8.0 * nx as f64, y1: 8.0 + 8.0 * ny as f64 };
        Mesh::on_zones(&[Zone::rectangle("all", roi)], 8, 512, 512).unwrap()
    }

    /// The matrix of a texture that is alike everywhere, and the splines.
    fn even(mesh: &Mesh<Px>) -> (BlockMatrix, Subspace) {
        let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
        let matrices = vec![alike(PRODUCTS, 1.0 / 36.0); mesh.n_elements()];
        (BlockMatrix::assemble(&pattern, mesh.elements(), &matrices), splines(mesh).unwrap())
    }

    /// The field of the subspace that is nearest to `u`.
    fn nearest(mesh: &Mesh<Px>, u: impl Fn([f64; 2]) -> [f64; 2]) -> Vec<[f64; 2]> {
        let (matrix, splines) = even(mesh);
        let nodes: Vec<[f64; 2]> = mesh.nodes().iter().map(|&at| u(at)).collect();
        let mut coefficients = splines.right_hand_side(&matrix.multiply(&nodes));
        splines.factor(&splines.matrix(&matrix)).unwrap().solve(&mut coefficients);
        splines.field(&coefficients)
    }

    #[test]
    fn polynomials_up_to_the_third_degree_are_splines_in_rectangles_and_polygons_with_holes() {
        let polygon = vec![[8.0, 8.0], [150.0, 8.0], [150.0, 90.0], [80.0, 130.0], [8.0, 60.0]];
        let exclude = vec![vec![[60.0, 40.0], [90.0, 40.0], [90.0, 70.0], [60.0, 70.0]]];
        let zone = Zone { name: "cut".into(), polygon, exclude, ..Zone::default() };
        let part = Mesh::on_zones(&[zone], 8, 512, 512).unwrap();
        for mesh in [rectangle(12, 9), rectangle(7, 2), part] {
            let cubic = |[x, y]: [f64; 2]| {
                let [s, t] = [(x - 50.0) / 16.0, (y - 30.0) / 16.0];
                [1.0 + s - 2.0 * t + s * t - 0.5 * s * s + 0.3 * s * s * s, t * t * t - s * s * t + 2.0 * s]
            };
            let linear = |[x, y]: [f64; 2]| [0.3 * x - 0.2 * y, 100.0 + 0.1 * x];
            let far = |u: &dyn Fn([f64; 2]) -> [f64; 2]| {
                let off = |(found, &at): ([f64; 2], &[f64; 2])| (found[0] - u(at)[0]).hypot(found[1] - u(at)[1]);
                nearest(&mesh, u).into_iter().zip(mesh.nodes()).map(off).fold(0.0, f64::max)
            };
            // The cubic bends by up to 40 from knot to knot, of which ends of lines lose some thousandths.
            let (of_linear, of_cubic) = (far(&linear), far(&cubic));
            assert!(of_linear < 1e-7 && of_cubic < 0.2, "{of_linear}, {of_cubic}");
        }
    }

    #[test]
    fn a_wave_that_the_elements_could_follow_and_splines_cannot_is_left_out() {
        let mesh = rectangle(40, 6);
        let sign = |x: f64| if ((x - 8.0) / 8.0).round() as i64 % 2 == 0 { 1.0 } else { -1.0 };
        let found = nearest(&mesh, |[x, _]| [sign(x), 0.0]);
        let inside = |node: &usize| (120.0..210.0).contains(&mesh.nodes()[*node][0]);
        let worst = (0..mesh.n_nodes()).filter(inside).fold(0.0f64, |worst, node| worst.max(found[node][0].abs()));
        assert!(worst < 0.02, "{worst}");
    }

    #[test]
    fn the_noise_of_values_is_that_of_the_filter_on_what_splines_leave_of_noise() {
        let mesh = rectangle(24, 24);
        let (matrix, splines) = even(&mesh);
        let factor = splines.factor(&splines.matrix(&matrix)).unwrap();
        let grid = mesh.whole_grid(0).unwrap();
        let factors = noise_of_values(&mesh);
        let spread = splines.spread(&matrix, &factor);
        for (column, row) in [(12, 12), (13, 12), (12, 13), (13, 13)] {
            // Variance of a sum over nodes with these weights, w . S w.
            let mut weights = vec![[0.0; 2]; mesh.n_nodes()];
            for (i, by_column) in [(column - 1, 1.0), (column, 10.0), (column + 1, 1.0)] {
                for (j, by_row) in [(row - 1, 1.0), (row, 10.0), (row + 1, 1.0)] {
                    weights[grid.node(i, j)] = [by_column * by_row / 144.0, 0.0];
                }
            }
            let mut coefficients = splines.right_hand_side(&weights);
            factor.solve(&mut coefficients);
            let field = splines.field(&coefficients);
            let variance: f64 = weights.iter().zip(&field).map(|(w, s)| w[0] * s[0]).sum();
            let node = grid.node(column, row);
            let want = (variance / spread.variance[node][0]).sqrt();
            assert!((factors[node] / want - 1.0).abs() < 1e-3, "{column}, {row}: {} for {want}", factors[node]);
        }
        assert_eq!(factors[grid.node(1, 12)], 1.0);
    }
}
