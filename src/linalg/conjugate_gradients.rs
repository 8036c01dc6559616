//! Conjugate gradients with the inverse nodal blocks as preconditioner.
//!
//! Products and updates run in vector lanes along the entries of a block and the components of a node, without fused
//! multiply-adds: every instruction path gives the same bits.

use super::blocks::{BlockMatrix, Pattern, row_sums};
use crate::isa::{Isa, multiversioned};
use rayon::prelude::*;
use std::ops::{Add, Mul, Sub};

/// Nodes per piece of work: fixed, so that sums have the same order for any number of threads.
const PIECE: usize = 2048;
/// Rows of a product whose sums are kept beside each other, and whose parts of a sum over all rows are added up in the precision of the
/// vectors.
const ROWS: usize = 64;
/// Up to this many nodes one thread does all pieces: waking others, twice in an iteration, costs more than they would save.
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

    /// Follows the matrix, in which the blocks of `nodes` have changed.
    pub(super) fn follow(&mut self, matrix: &BlockMatrix, nodes: &[u32]) {
        nodes.iter().for_each(|&node| self.inverse[node as usize] = inverted(matrix.diagonal(node as usize)));
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
        let system = System { pattern: matrix.pattern(), blocks: matrix.blocks(), inverse: &self.inverse };
        system.solve(rhs, reduction, max_iterations)
    }
}

/// A matrix with the inverses of its diagonal blocks in single precision: half as many bytes to read in every iteration, which is what it
/// takes its time for. Enough for solutions to 0.1 %.
#[derive(Debug, Clone)]
pub(super) struct Single {
    blocks: Vec<[f32; 4]>,
    inverse: Vec<[f32; 3]>,
}

impl Single {
    pub fn new(matrix: &BlockMatrix, jacobi: &BlockJacobi) -> Self {
        let blocks = matrix.blocks().iter().map(single).collect();
        Self { blocks, inverse: jacobi.inverse.iter().map(single).collect() }
    }

    /// Follows the matrix, in which the rows of `nodes` have changed.
    pub fn follow(&mut self, matrix: &BlockMatrix, jacobi: &BlockJacobi, nodes: &[u32]) {
        for node in nodes.iter().map(|&node| node as usize) {
            self.inverse[node] = single(&jacobi.inverse[node]);
            let row = matrix.pattern().row(node);
            self.blocks[row.clone()].iter_mut().zip(&matrix.blocks()[row]).for_each(|(to, from)| *to = single(from));
        }
    }

    /// As [`BlockJacobi::solve`].
    pub fn solve(&self, pattern: &Pattern, rhs: &[[f32; 2]], reduction: f64, max_iterations: usize) -> Vec<[f32; 2]> {
        System { pattern, blocks: &self.blocks, inverse: &self.inverse }.solve(rhs, reduction, max_iterations).0
    }
}

fn single<const N: usize>(of: &[f64; N]) -> [f32; N] {
    of.map(|v| v as f32)
}

/// A number that conjugate gradients are computed in.
trait Real:
    Copy + Default + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Into<f64>
{
    fn rounded(v: f64) -> Self;
}

impl Real for f64 {
    #[inline(always)]
    fn rounded(v: f64) -> Self {
        v
    }
}

impl Real for f32 {
    #[inline(always)]
    fn rounded(v: f64) -> Self {
        v as f32
    }
}

/// A matrix with the inverses of the blocks on its diagonal.
#[derive(Clone, Copy)]
struct System<'a, T> {
    pattern: &'a Pattern,
    blocks: &'a [[T; 4]],
    inverse: &'a [[T; 3]],
}

impl<T: Real> System<'_, T> {
    /// See [`BlockJacobi::solve`].
    ///
    /// The image of a direction follows from that of the preconditioned residual, as the direction itself does (Chronopoulos and Gear,
    /// 1989): threads wait for each other twice in an iteration, not three times.
    fn solve(self, rhs: &[[T; 2]], reduction: f64, max_iterations: usize) -> (Vec<[T; 2]>, CgOutcome) {
        let (n, isa) = (rhs.len(), Isa::detect());
        // Pieces that one thread takes at least.
        let pieces = if n <= ALONE_UP_TO { n.div_ceil(PIECE).max(1) } else { 1 };
        let zero = || vec![[T::default(); 2]; n];
        // The directions p, their images q, and the images w of z.
        let (mut x, mut p, mut q, mut w) = (zero(), zero(), zero(), zero());
        let mut r = rhs.to_vec();
        let mut z: Vec<[T; 2]> = self.inverse.iter().zip(&r).map(|(inverse, &r)| times(inverse, r)).collect();
        let wide = |[x, y]: [T; 2]| -> [f64; 2] { [x.into(), y.into()] };
        let dot = |(&r, &z): (&[T; 2], &[T; 2])| {
            let (r, z) = (wide(r), wide(z));
            r[0] * z[0] + r[1] * z[1]
        };
        let dots = r.chunks(PIECE).zip(z.chunks(PIECE));
        let mut rz = in_order(dots.map(|(r, z)| r.iter().zip(z).map(dot).sum()));
        let rz_start = rz;
        let (mut alpha, mut beta, mut iterations) = (1.0, 0.0, 0);
        while iterations < max_iterations && rz > reduction * reduction * rz_start && rz > 0.0 {
            let zw: Vec<f64> = w
                .par_chunks_mut(PIECE)
                .enumerate()
                .with_min_len(pieces)
                .map(|(piece, w)| product(isa, self, &z, piece * PIECE, w))
                .collect();
            // p . q of the new direction.
            let pq = in_order(zw) - beta * rz / alpha;
            if pq <= 0.0 {
                break; // not positive definite along p: what is reached so far stands
            }
            alpha = rz / pq;
            let new_rz: Vec<f64> = x
                .par_chunks_mut(PIECE)
                .zip(r.par_chunks_mut(PIECE))
                .zip(z.par_chunks_mut(PIECE))
                .zip(p.par_chunks_mut(PIECE).zip(q.par_chunks_mut(PIECE)))
                .zip(w.par_chunks(PIECE).zip(self.inverse.par_chunks(PIECE)))
                .with_min_len(pieces)
                .map(|((((x, r), z), (p, q)), (w, inverse))| update(isa, inverse, [alpha, beta], w, [p, q, x, r, z]))
                .collect();
            let new_rz = in_order(new_rz);
            (beta, rz) = (new_rz / rz, new_rz);
            iterations += 1;
        }
        let relative_residual = if rz_start > 0.0 { (rz / rz_start).max(0.0).sqrt() } else { 0.0 };
        (x, CgOutcome { iterations, relative_residual })
    }
}

multiversioned! {
    fn product[T: Real][T](system: System<'_, T>, z: &[[T; 2]], first: usize, w: &mut [[T; 2]]) -> f64 => product_body
}
multiversioned! {
    fn update[T: Real][T](inverse: &[[T; 3]], alpha_and_beta: [f64; 2], w: &[[T; 2]], vectors: [&mut [[T; 2]]; 5]) -> f64 => update_body
}

/// w = matrix times z, at the nodes from `first` on; returns z . w there.
#[inline(always)]
fn product_body<const FMA: bool, T: Real>(system: System<'_, T>, z: &[[T; 2]], first: usize, w: &mut [[T; 2]]) -> f64 {
    let mut sum = [0.0; 2];
    // Sums of some rows first: added where they are made, the compiler would shuffle the entries of every block for it.
    let mut sums = [[T::default(); 4]; ROWS];
    for (w, first) in w.chunks_mut(ROWS).zip((first..).step_by(ROWS)) {
        for (sums, node) in sums[..w.len()].iter_mut().zip(first..) {
            *sums = row_sums(system.pattern, system.blocks, node, z);
        }
        let mut of_rows = [T::default(); 2];
        for ((w, &[xx, xy, yx, yy]), z) in w.iter_mut().zip(&sums).zip(&z[first..]) {
            *w = [xx + xy, yx + yy];
            (0..2).for_each(|c| of_rows[c] = of_rows[c] + w[c] * z[c]);
        }
        (0..2).for_each(|c| sum[c] += of_rows[c].into());
    }
    sum[0] + sum[1]
}

/// p = z + beta p and q = w + beta q, then x += alpha p, r -= alpha q, z = inverse blocks times r; returns r . z.
#[inline(always)]
fn update_body<const FMA: bool, T: Real>(
    inverse: &[[T; 3]],
    alpha_and_beta: [f64; 2],
    w: &[[T; 2]],
    [p, q, x, r, z]: [&mut [[T; 2]]; 5],
) -> f64 {
    let [alpha, beta] = alpha_and_beta.map(T::rounded);
    let mut sum = [0.0; 2];
    let rows = inverse.chunks(ROWS).zip(w.chunks(ROWS));
    let vectors = p.chunks_mut(ROWS).zip(q.chunks_mut(ROWS)).zip(x.chunks_mut(ROWS).zip(r.chunks_mut(ROWS)));
    for ((inverse, w), (((p, q), (x, r)), z)) in rows.zip(vectors.zip(z.chunks_mut(ROWS))) {
        let mut of_rows = [T::default(); 2];
        for ((((inverse, w), (p, q)), (x, r)), z) in
            inverse.iter().zip(w).zip(p.iter_mut().zip(q)).zip(x.iter_mut().zip(r)).zip(z)
        {
            // Through values of its own: what is stored by halves and then read as a whole has to be waited for.
            let (new_p, new_q) = ([0, 1].map(|c| z[c] + beta * p[c]), [0, 1].map(|c| w[c] + beta * q[c]));
            let new_r = [0, 1].map(|c| r[c] - alpha * new_q[c]);
            let new_z = times(inverse, new_r);
            *x = [0, 1].map(|c| x[c] + alpha * new_p[c]);
            (*p, *q, *r, *z) = (new_p, new_q, new_r, new_z);
            (0..2).for_each(|c| of_rows[c] = of_rows[c] + new_r[c] * new_z[c]);
        }
        (0..2).for_each(|c| sum[c] += of_rows[c].into());
    }
    sum[0] + sum[1]
}

#[inline(always)]
fn times<T: Real>(&[xx, xy, yy]: &[T; 3], [x, y]: [T; 2]) -> [T; 2] {
    [xx * x + xy * y, xy * x + yy * y]
}

fn inverted([xx, xy, yy]: [f64; 3]) -> [f64; 3] {
    let determinant = xx * yy - xy * xy;
    if determinant > 0.0 { [yy / determinant, -xy / determinant, xx / determinant] } else { [0.0; 3] }
}

fn in_order(parts: impl IntoIterator<Item = f64>) -> f64 {
    parts.into_iter().fold(0.0, |sum, part| sum + part)
}
