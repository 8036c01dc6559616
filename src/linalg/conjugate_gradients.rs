//! Conjugate gradients with the inverse nodal blocks as preconditioner.
//!
//! Products and updates run in vector lanes along the entries of a block and the components of a node, without fused
//! multiply-adds: every instruction path gives the same bits.

use super::blocks::BlockMatrix;
use crate::isa::{Isa, multiversioned};
use rayon::prelude::*;

/// Nodes per piece of work: fixed, so that sums have the same order for any number of threads.
const PIECE: usize = 2048;
/// Rows of a product whose sums are kept beside each other.
const ROWS: usize = 64;
/// Up to this many nodes one thread does all pieces: waking others, three times in an iteration, costs more than they would save.
const ALONE_UP_TO: usize = 6144;

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

    /// Solves `matrix x = rhs` from zero until the residual has fallen by `reduction` or `max_iterations`
    /// are done. The same bits for any number of threads.
    pub fn solve(
        &self,
        matrix: &BlockMatrix,
        rhs: &[[f64; 2]],
        reduction: f64,
        max_iterations: usize,
    ) -> (Vec<[f64; 2]>, CgOutcome) {
        let (n, isa) = (rhs.len(), Isa::detect());
        // Pieces that one thread takes at least.
        let pieces = if n <= ALONE_UP_TO { n.div_ceil(PIECE).max(1) } else { 1 };
        let mut x = vec![[0.0; 2]; n];
        let mut r = rhs.to_vec();
        let mut q = vec![[0.0; 2]; n];
        let mut p: Vec<[f64; 2]> = self.inverse.iter().zip(&r).map(|(inverse, &r)| times(inverse, r)).collect();
        let dots = r.chunks(PIECE).zip(p.chunks(PIECE));
        let mut rz = in_order(dots.map(|(r, p)| r.iter().zip(p).map(|(r, p)| r[0] * p[0] + r[1] * p[1]).sum()));
        let rz_start = rz;
        let mut iterations = 0;
        while iterations < max_iterations && rz > reduction * reduction * rz_start && rz > 0.0 {
            let pq: Vec<f64> = q
                .par_chunks_mut(PIECE)
                .enumerate()
                .with_min_len(pieces)
                .map(|(piece, q)| product(isa, matrix, &p, piece * PIECE, q))
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
                .zip(p.par_chunks(PIECE).zip(self.inverse.par_chunks(PIECE)))
                .with_min_len(pieces)
                .map(|(((x, r), q), (p, inverse))| update(isa, inverse, alpha, p, x, r, q))
                .collect();
            let new_rz = in_order(new_rz);
            let beta = new_rz / rz;
            rz = new_rz;
            let directions = p.par_chunks_mut(PIECE).zip(q.par_chunks(PIECE)).with_min_len(pieces);
            directions.for_each(|(p, z)| direction(isa, beta, p, z));
            iterations += 1;
        }
        let relative_residual = if rz_start > 0.0 { (rz / rz_start).max(0.0).sqrt() } else { 0.0 };
        (x, CgOutcome { iterations, relative_residual })
    }
}

multiversioned! {
    fn product[][](matrix: &BlockMatrix, p: &[[f64; 2]], first: usize, q: &mut [[f64; 2]]) -> f64 => product_body
}
multiversioned! {
    fn update[][](inverse: &[[f64; 3]], alpha: f64, p: &[[f64; 2]], x: &mut [[f64; 2]], r: &mut [[f64; 2]], q: &mut [[f64; 2]]) -> f64
        => update_body
}
multiversioned! {
    fn direction[][](beta: f64, p: &mut [[f64; 2]], z: &[[f64; 2]]) => direction_body
}

/// q = matrix times p, at the nodes from `first` on; returns p . q there.
#[inline(always)]
fn product_body<const FMA: bool>(matrix: &BlockMatrix, p: &[[f64; 2]], first: usize, q: &mut [[f64; 2]]) -> f64 {
    let mut sum = [0.0; 2];
    // Sums of some rows first: added where they are made, the compiler would shuffle the entries of every block for it.
    let mut sums = [[0.0; 4]; ROWS];
    for (q, first) in q.chunks_mut(ROWS).zip((first..).step_by(ROWS)) {
        for (sums, node) in sums[..q.len()].iter_mut().zip(first..) {
            *sums = matrix.row_sums(node, p);
        }
        for ((q, [xx, xy, yx, yy]), p) in q.iter_mut().zip(&sums).zip(&p[first..]) {
            *q = [xx + xy, yx + yy];
            (0..2).for_each(|c| sum[c] += q[c] * p[c]);
        }
    }
    sum[0] + sum[1]
}

/// x += alpha p, r -= alpha q, then q = inverse blocks times r, free until the next product; returns r . q.
#[inline(always)]
fn update_body<const FMA: bool>(
    inverse: &[[f64; 3]],
    alpha: f64,
    p: &[[f64; 2]],
    x: &mut [[f64; 2]],
    r: &mut [[f64; 2]],
    q: &mut [[f64; 2]],
) -> f64 {
    let mut sum = [0.0; 2];
    for ((((inverse, p), x), r), q) in inverse.iter().zip(p).zip(x).zip(r).zip(q) {
        for c in 0..2 {
            x[c] += alpha * p[c];
            r[c] -= alpha * q[c];
        }
        *q = times(inverse, *r);
        (0..2).for_each(|c| sum[c] += r[c] * q[c]);
    }
    sum[0] + sum[1]
}

#[inline(always)]
fn direction_body<const FMA: bool>(beta: f64, p: &mut [[f64; 2]], z: &[[f64; 2]]) {
    for (p, z) in p.as_flattened_mut().iter_mut().zip(z.as_flattened()) {
        *p = z + beta * *p;
    }
}

#[inline(always)]
fn times(&[xx, xy, yy]: &[f64; 3], [x, y]: [f64; 2]) -> [f64; 2] {
    [xx * x + xy * y, xy * x + yy * y]
}

fn inverted([xx, xy, yy]: [f64; 3]) -> [f64; 3] {
    let determinant = xx * yy - xy * xy;
    if determinant > 0.0 { [yy / determinant, -xy / determinant, xx / determinant] } else { [0.0; 3] }
}

fn in_order(parts: impl IntoIterator<Item = f64>) -> f64 {
    parts.into_iter().fold(0.0, |sum, part| sum + part)
}
