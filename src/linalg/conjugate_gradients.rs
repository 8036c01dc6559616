//! Conjugate gradients with the inverse nodal blocks as preconditioner.

use super::blocks::BlockMatrix;
use rayon::prelude::*;

/// Nodes per piece of work: fixed, so that sums have the same order for any number of threads.
const PIECE: usize = 2048;

/// The inverses of the 2x2 blocks on the diagonal.
#[derive(Debug, Clone)]
pub struct BlockJacobi {
    pub(crate) inverse: Vec<[f64; 3]>,
}

/// What conjugate gradients reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CgOutcome {
    /// Iterations done.
    pub iterations: usize,
    /// Final residual relative to the right-hand side, in the norm of the preconditioner.
    pub relative_residual: f64,
}

impl BlockJacobi {
    /// Inverts the diagonal blocks of `matrix`; a singular block counts as zero.
    pub fn new(matrix: &BlockMatrix) -> Self {
        Self { inverse: (0..matrix.pattern().n_nodes()).map(|node| inverted(matrix.diagonal(node))).collect() }
    }

    /// The same where the blocks of `nodes` have changed.
    pub(super) fn changed(&self, matrix: &BlockMatrix, nodes: &[u32]) -> Self {
        let mut inverse = self.inverse.clone();
        nodes.iter().for_each(|&node| inverse[node as usize] = inverted(matrix.diagonal(node as usize)));
        Self { inverse }
    }

    fn apply(&self, node: usize, r: [f64; 2]) -> [f64; 2] {
        let [xx, xy, yy] = self.inverse[node];
        [xx * r[0] + xy * r[1], xy * r[0] + yy * r[1]]
    }

    /// Solves `matrix x = rhs` from zero until the residual has fallen by `reduction` or `max_iterations`
    /// are done. The same bits for any number of threads.
    pub fn solve(
        &self,
        matrix: &BlockMatrix,
        rhs: &[[f64; 2]],
        reduction: f64,
        max_iterations: usize,
    ) -> (Vec<[f64; 2]>, CgOutcome) {
        let n = rhs.len();
        let mut x = vec![[0.0; 2]; n];
        let mut r = rhs.to_vec();
        let mut q = vec![[0.0; 2]; n];
        let mut p: Vec<[f64; 2]> = (0..n).map(|node| self.apply(node, r[node])).collect();
        let mut rz = in_order((0..n.div_ceil(PIECE)).map(|piece| {
            let nodes = piece * PIECE..((piece + 1) * PIECE).min(n);
            nodes.map(|i| r[i][0] * p[i][0] + r[i][1] * p[i][1]).sum()
        }));
        let rz_start = rz;
        let mut iterations = 0;
        while iterations < max_iterations && rz > reduction * reduction * rz_start && rz > 0.0 {
            let pq: Vec<f64> = q
                .par_chunks_mut(PIECE)
                .enumerate()
                .map(|(piece, q)| {
                    let mut sum = 0.0;
                    for (k, q) in q.iter_mut().enumerate() {
                        let node = piece * PIECE + k;
                        *q = matrix.row_times(node, &p);
                        sum += q[0] * p[node][0] + q[1] * p[node][1];
                    }
                    sum
                })
                .collect();
            let pq = in_order(pq);
            if pq <= 0.0 {
                break; // not positive definite along p: what is reached so far stands
            }
            let alpha = rz / pq;
            let new_rz: Vec<f64> = x
                .par_chunks_mut(PIECE)
                .zip(r.par_chunks_mut(PIECE))
                .zip(q.par_chunks_mut(PIECE))
                .enumerate()
                .map(|(piece, ((x, r), q))| {
                    let mut sum = 0.0;
                    for k in 0..x.len() {
                        let node = piece * PIECE + k;
                        for c in 0..2 {
                            x[k][c] += alpha * p[node][c];
                            r[k][c] -= alpha * q[k][c];
                        }
                        let z = self.apply(node, r[k]);
                        sum += r[k][0] * z[0] + r[k][1] * z[1];
                        q[k] = z; // q is free until the next product: it carries z
                    }
                    sum
                })
                .collect();
            let new_rz = in_order(new_rz);
            let beta = new_rz / rz;
            rz = new_rz;
            p.par_iter_mut().with_min_len(PIECE).zip(&q).for_each(|(p, z)| {
                p[0] = z[0] + beta * p[0];
                p[1] = z[1] + beta * p[1];
            });
            iterations += 1;
        }
        let relative_residual = if rz_start > 0.0 { (rz / rz_start).max(0.0).sqrt() } else { 0.0 };
        (x, CgOutcome { iterations, relative_residual })
    }
}

fn inverted([xx, xy, yy]: [f64; 3]) -> [f64; 3] {
    let determinant = xx * yy - xy * xy;
    if determinant > 0.0 { [yy / determinant, -xy / determinant, xx / determinant] } else { [0.0; 3] }
}

fn in_order(parts: impl IntoIterator<Item = f64>) -> f64 {
    parts.into_iter().fold(0.0, |sum, part| sum + part)
}
