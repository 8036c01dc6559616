//! Fields that are sums of fewer functions than a mesh has nodes, and least squares among them.

use super::blocks::{BlockMatrix, Pattern};
use super::cholesky::{Cholesky, NotPositiveDefinite};
use super::dissection::dissection;
use super::selected_inverse::{inverse_by, selected_inverse};
use super::spread::Spread;
use rayon::prelude::*;
use std::sync::Arc;

/// Weight of the second differences along the lines of functions, in the mean diagonal entry of the matrix of the data:
/// it decides where a border leaves next to nothing of a function. Of a wave of four knots it takes 5e-5; the ends of
/// lines are drawn towards straight ones by 1e-3 of what the field bends there from knot to knot.
const OF_LINES: f64 = 1e-5;

/// Pieces of work of which each has a row of all nodes, or functions, of its own.
const PIECES: usize = 32;
#[derive(Debug)]
struct Rows {
    starts: Vec<u32>,
    entries: Vec<(u32, f64)>,
}

impl Rows {
    fn new(rows: &[Vec<(u32, f64)>]) -> Self {
        let mut starts = vec![0];
        let mut entries = Vec::new();
        for row in rows {
            entries.extend_from_slice(row);
            starts.push(entries.len() as u32);
        }
        Self { starts, entries }
    }

    fn transposed(&self, n_columns: usize) -> Self {
        let mut rows = vec![Vec::new(); n_columns];
        for row in 0..self.len() {
            for &(column, weight) in self.of(row) {
                rows[column as usize].push((row as u32, weight));
            }
        }
        Self::new(&rows)
    }

    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn of(&self, row: usize) -> &[(u32, f64)] {
        &self.entries[self.starts[row] as usize..self.starts[row + 1] as usize]
    }

    /// This matrix times a vector of two components.
    fn times(&self, x: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let of_row = |row: usize| {
            self.of(row).iter().fold([0.0; 2], |[sum_x, sum_y], &(column, weight)| {
                let [x, y] = x[column as usize];
                [sum_x + weight * x, sum_y + weight * y]
            })
        };
        (0..self.len()).into_par_iter().with_min_len(1024).map(of_row).collect()
    }
}

/// Nodal fields `a = B c` that are sums of functions, each of which has a value at some nodes.
#[derive(Debug)]
pub struct Subspace {
    of_nodes: Rows,
    of_functions: Rows,
    /// Which functions are coupled.
    pattern: Arc<Pattern>,
    /// The squares of the second differences along the lines of functions.
    lines: BlockMatrix,
    /// Elimination order of the functions.
    order: Vec<usize>,
}

impl Subspace {
    /// From the functions of every node and their values there; the functions that each is coupled with by an element,
    /// ascending, itself among them; three that follow each other on a line, each time; and where their middles are.
    ///
    /// # Panics
    /// When a line joins functions that are not coupled.
    pub fn new(of_nodes: &[Vec<(u32, f64)>], coupled: &[Vec<u32>], lines: &[[u32; 3]], middles: &[[f64; 2]]) -> Self {
        let of_nodes = Rows::new(of_nodes);
        let pattern = Arc::new(Pattern::of_rows(coupled));
        let mut of_lines = BlockMatrix::zero(&pattern);
        let alike = |c: f64| [c, 0.0, 0.0, c];
        lines.iter().for_each(|line| of_lines.add_square(line, &[1.0, -2.0, 1.0].map(alike), 1.0));
        let order = dissection(&pattern, middles, 0..middles.len());
        Self { of_functions: of_nodes.transposed(coupled.len()), of_nodes, pattern, lines: of_lines, order }
    }

    /// Number of functions.
    pub fn n_functions(&self) -> usize {
        self.of_functions.len()
    }

    /// The field with these coefficients.
    pub fn field(&self, coefficients: &[[f64; 2]]) -> Vec<[f64; 2]> {
        self.of_nodes.times(coefficients)
    }

    /// The right-hand side of the functions from that of the nodes.
    pub fn right_hand_side(&self, of_nodes: &[[f64; 2]]) -> Vec<[f64; 2]> {
        self.of_functions.times(of_nodes)
    }

    /// `B^T M B` of a matrix `data` of the nodes, with next to nothing of the second differences, without held nodes.
    pub fn matrix(&self, data: &BlockMatrix) -> BlockMatrix {
        self.matrix_of(data, &(0..self.n_functions() as u32).collect::<Vec<_>>(), &self.pattern, &self.lines)
    }

    /// The rows and columns of these functions, ascending, alone.
    fn part(&self, data: &BlockMatrix, functions: &[u32]) -> BlockMatrix {
        let lines = self.lines.part(functions);
        self.matrix_of(data, functions, &lines.pattern().clone(), &lines)
    }

    fn matrix_of(
        &self,
        data: &BlockMatrix,
        functions: &[u32],
        pattern: &Arc<Pattern>,
        lines: &BlockMatrix,
    ) -> BlockMatrix {
        let nodes = data.pattern();
        let is_held = |node: u32| data.held().binary_search(&node).is_ok();
        let mut number = vec![u32::MAX; self.n_functions()];
        (0..).zip(functions).for_each(|(at, &function)| number[function as usize] = at);
        // Row by row: of the nodes of the function, then of all functions there.
        let row = |of_node: &mut Vec<[f64; 4]>, function: u32| {
            let mut touched: Vec<u32> = Vec::with_capacity(128);
            for &(node, weight) in self.of_functions.of(function as usize).iter().filter(|(node, _)| !is_held(*node)) {
                let range = nodes.row(node as usize);
                for (block, &other) in data.blocks()[range].iter().zip(nodes.neighbours(node as usize)) {
                    if is_held(other) {
                        continue;
                    }
                    let sum = &mut of_node[other as usize];
                    if *sum == [0.0; 4] {
                        touched.push(other);
                    }
                    sum.iter_mut().zip(block).for_each(|(sum, value)| *sum += weight * value);
                }
            }
            touched.sort_unstable();
            touched.dedup();
            let columns = pattern.neighbours(number[function as usize] as usize);
            let mut row = vec![[0.0; 4]; columns.len()];
            for node in touched {
                let value = std::mem::take(&mut of_node[node as usize]);
                for &(other, weight) in self.of_nodes.of(node as usize) {
                    let other = number[other as usize];
                    if other == u32::MAX {
                        continue;
                    }
                    let at = columns.binary_search(&other).expect("functions that an element couples");
                    row[at].iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
                }
            }
            row
        };
        let nothing = || vec![[0.0; 4]; nodes.n_nodes()];
        let piece = functions.len().div_ceil(PIECES).max(64);
        let rows: Vec<Vec<[f64; 4]>> =
            functions.par_iter().with_min_len(piece).map_init(nothing, |of_node, &f| row(of_node, f)).collect();
        let mut matrix = BlockMatrix::of_rows(pattern, &rows);
        let mean = {
            let of = |function: usize| {
                let [xx, _, yy] = matrix.diagonal(function);
                xx + yy
            };
            let n = pattern.n_nodes().max(1);
            (0..pattern.n_nodes()).map(of).sum::<f64>() / (2 * n) as f64
        };
        matrix.add(lines, OF_LINES * mean);
        matrix
    }

    /// A factor of the matrix of the functions.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`], with a function in place of a node, when the data does not determine them.
    pub fn factor(&self, matrix: &BlockMatrix) -> Result<Cholesky, NotPositiveDefinite> {
        Cholesky::in_pieces(matrix, &self.order)
    }

    /// Variances and degrees of freedom of the solution `a = B (B^T M B)^-1 B^T b` at the nodes, where `b` has the
    /// covariance `M` (`data`) and the matrix of the functions this `factor`: the diagonals of `B (B^T M B)^-1 B^T`
    /// and of its product with `M`.
    pub fn spread(&self, data: &BlockMatrix, factor: &Cholesky) -> Spread {
        let inverse = inverse_by(factor, &self.order, &self.pattern);
        let number: Vec<u32> = (0..self.n_functions() as u32).collect();
        let nodes: Vec<u32> = (0..self.of_nodes.len() as u32).collect();
        self.spread_by(data, &inverse, &number, &nodes)
    }

    /// The same at `redone` with the functions that have no value at any node but the `free`, both ascending, as if all
    /// others were held.
    ///
    /// # Errors
    /// As [`Subspace::factor`].
    pub fn spread_of_part(
        &self,
        data: &BlockMatrix,
        free: &[u32],
        redone: &[u32],
    ) -> Result<Spread, NotPositiveDefinite> {
        let is_inside = |function: &u32| {
            self.of_functions.of(*function as usize).iter().all(|(node, _)| free.binary_search(node).is_ok())
        };
        let functions: Vec<u32> = (0..self.n_functions() as u32).filter(is_inside).collect();
        let mut number = vec![u32::MAX; self.n_functions()];
        (0..).zip(&functions).for_each(|(at, &function)| number[function as usize] = at);
        let matrix = self.part(data, &functions);
        let own = |&function: &usize| Some(number[function] as usize).filter(|&at| at != u32::MAX as usize);
        let order: Vec<usize> = self.order.iter().filter_map(own).collect();
        let inverse = selected_inverse(&matrix, &order, matrix.pattern())?;
        Ok(self.spread_by(data, &inverse, &number, redone))
    }

    /// From the inverse on the pattern of the functions `number`ed in it.
    fn spread_by(&self, data: &BlockMatrix, inverse: &BlockMatrix, number: &[u32], nodes: &[u32]) -> Spread {
        let functions = |node: usize| {
            let own = |&(function, weight): &(u32, f64)| (number[function as usize], weight);
            self.of_nodes.of(node).iter().map(own).filter(|(function, _)| *function != u32::MAX)
        };
        let of_node = |row: &mut Vec<[f64; 4]>, node: usize| {
            // The row of B (B^T M B)^-1.
            for (function, weight) in functions(node) {
                let pattern = inverse.pattern();
                let range = pattern.row(function as usize);
                for (block, &other) in inverse.blocks()[range].iter().zip(pattern.neighbours(function as usize)) {
                    row[other as usize].iter_mut().zip(block).for_each(|(sum, value)| *sum += weight * value);
                }
            }
            let (mut variance, mut freedom) = ([0.0; 2], 0.0);
            let is_held = data.held().binary_search(&(node as u32)).is_ok();
            let range = data.pattern().row(node);
            for (block, &other) in data.blocks()[range].iter().zip(data.pattern().neighbours(node)) {
                let covariance = functions(other as usize).fold([0.0; 4], |sum, (function, weight)| {
                    std::array::from_fn(|k| sum[k] + weight * row[function as usize][k])
                });
                freedom +=
                    f64::from(u8::from(!is_held)) * block.iter().zip(covariance).map(|(m, c)| m * c).sum::<f64>();
                if other as usize == node {
                    variance = [covariance[0].max(0.0), covariance[3].max(0.0)];
                }
            }
            for (function, _) in functions(node) {
                inverse
                    .pattern()
                    .neighbours(function as usize)
                    .iter()
                    .for_each(|&other| row[other as usize] = [0.0; 4]);
            }
            (variance, freedom)
        };
        let nothing = || vec![[0.0; 4]; inverse.pattern().n_nodes()];
        let piece = nodes.len().div_ceil(PIECES).max(256);
        let all = nodes.par_iter().with_min_len(piece).map_init(nothing, |row, &node| of_node(row, node as usize));
        let (variance, freedom) = all.unzip();
        Spread { variance, freedom }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::Solver;

    const NODES: usize = 15;

    /// Nodes in a line, each coupled with its neighbours, and functions over three nodes each, middles two nodes apart.
    fn line() -> (BlockMatrix, Arc<Subspace>) {
        let elements: Vec<[u32; 4]> = (0..NODES as u32 - 1).map(|k| [k, k + 1, k + 1, k]).collect();
        let pattern = Arc::new(Pattern::new(NODES, &elements));
        let noise = |k: usize| f64::from((k as u32).wrapping_mul(2_654_435_769) >> 16) / 65536.0;
        let mut data = BlockMatrix::zero(&pattern);
        for k in 0..NODES as u32 - 1 {
            let c = |at: usize| noise(8 * k as usize + at) - 0.5;
            for at in [0, 4] {
                data.add_square(&[k, k + 1], &[[c(at) + 1.0, 0.1, 0.2, 1.0], [c(at + 1), 0.3, c(at + 2), 1.5]], 1.0);
            }
        }
        let of_node = |node: usize| match node % 2 {
            0 => vec![(node as u32 / 2, 1.0)],
            _ => vec![(node as u32 / 2, 0.4), (node as u32 / 2 + 1, 0.6)],
        };
        let n = NODES as u32 / 2 + 1;
        let coupled: Vec<Vec<u32>> = (0..n).map(|k| (k.saturating_sub(2)..(k + 3).min(n)).collect()).collect();
        let lines: Vec<[u32; 3]> = (0..n - 2).map(|k| [k, k + 1, k + 2]).collect();
        let middles: Vec<[f64; 2]> = (0..n).map(|k| [f64::from(k), 0.0]).collect();
        let of_nodes: Vec<_> = (0..NODES).map(of_node).collect();
        (data, Arc::new(Subspace::new(&of_nodes, &coupled, &lines, &middles)))
    }

    /// The column of `B (B^T M B)^-1 B^T` of a component of a node.
    fn column(data: &BlockMatrix, subspace: &Arc<Subspace>, node: usize, c: usize) -> Vec<[f64; 2]> {
        let mut unit = vec![[0.0; 2]; NODES];
        unit[node][c] = 1.0;
        Solver::within(data.clone(), subspace.clone()).unwrap().solve(unit)
    }

    #[test]
    fn the_matrix_of_the_functions_is_that_of_their_energies() {
        let (data, subspace) = line();
        let matrix = subspace.matrix(&data);
        for (at, c) in (0..subspace.n_functions()).flat_map(|at| [(at, 0), (at, 1)]) {
            let mut coefficients = vec![[0.0; 2]; subspace.n_functions()];
            coefficients[at][c] = 1.0;
            let want = subspace.right_hand_side(&data.multiply(&subspace.field(&coefficients)));
            let found = matrix.multiply(&coefficients);
            for (found, want) in found.as_flattened().iter().zip(want.as_flattened()) {
                // A little of the second differences is in it, 6e-5 at most of the mean diagonal entry of about 10.
                assert!((found - want).abs() < 1e-3, "{at}: {found} for {want}");
            }
        }
    }

    #[test]
    fn a_correction_leads_to_the_field_of_the_subspace_that_fits_best_from_wherever_it_starts() {
        let (data, subspace) = line();
        let solver = Solver::within(data.clone(), subspace.clone()).unwrap();
        let wanted: Vec<[f64; 2]> = (0..NODES).map(|k| [(k as f64).sin(), (2.0 * k as f64).cos()]).collect();
        let from = |start: Vec<[f64; 2]>| {
            let off: Vec<[f64; 2]> = wanted.iter().zip(&start).map(|(u, s)| [u[0] - s[0], u[1] - s[1]]).collect();
            let correction = solver.correction(data.multiply(&off), &start);
            start.iter().zip(correction).map(|(u, d)| [u[0] + d[0], u[1] + d[1]]).collect::<Vec<_>>()
        };
        let found = from(vec![[0.0; 2]; NODES]);
        let left: Vec<[f64; 2]> = wanted.iter().zip(&found).map(|(u, a)| [u[0] - a[0], u[1] - a[1]]).collect();
        let rest = subspace.right_hand_side(&data.multiply(&left));
        // Right-hand sides are about 10; of the second differences, up to 4 times 4, a little is left.
        assert!(
            rest.as_flattened().iter().all(|b| b.abs() < 0.02),
            "what is left is at right angles to all functions: {rest:?}"
        );
        let other = from((0..NODES).map(|k| [k as f64, (3.0 * k as f64).sin()]).collect());
        for (a, b) in found.as_flattened().iter().zip(other.as_flattened()) {
            assert!((a - b).abs() < 1e-6, "{a}, {b}");
        }
    }

    #[test]
    fn variances_and_degrees_of_freedom_are_those_of_the_dense_inverse() {
        let (mut data, subspace) = line();
        let mut keep = [true; NODES];
        keep[4] = false;
        data.hold(&keep);
        let spread = subspace.spread(&data, &subspace.factor(&subspace.matrix(&data)).unwrap());
        let mut freedom = 0.0;
        for node in 0..NODES {
            let columns = [0, 1].map(|c| column(&data, &subspace, node, c));
            if keep[node] {
                let variance = [0, 1].map(|c| columns[c][node][c]);
                for c in 0..2 {
                    let found = spread.variance[node][c];
                    assert!((found / variance[c] - 1.0).abs() < 1e-9, "{node}: {found} for {}", variance[c]);
                }
            }
            freedom += spread.freedom[node];
        }
        // As many as there are unknowns of functions, less what the second differences decide.
        assert!((freedom - 2.0 * subspace.n_functions() as f64).abs() < 0.05, "{freedom}");
        // Where nothing else is free, all is as before.
        let all: Vec<u32> = (0..NODES as u32).collect();
        let part = subspace.spread_of_part(&data, &all, &[3, 9]).unwrap();
        assert_eq!(part.variance, [spread.variance[3], spread.variance[9]]);
        // Of fewer functions each is known better.
        let part = subspace.spread_of_part(&data, &all[5..14], &[9]).unwrap();
        assert!(part.variance[0][0] < spread.variance[9][0] && part.variance[0][0] > 0.5 * spread.variance[9][0]);
    }
}
