//! Conjugate gradients with the inverse nodal blocks as preconditioner: on the matrix scaled by the blocks on its
//! diagonal, which is the same.
//!
//! Products and updates run in vector lanes along the entries of a block and the components of a node, without fused
//! multiply-adds: every instruction path gives the same bits.

use super::blocks::{BlockMatrix, Pattern, row_sums};
use crate::isa::{Isa, multiversioned};
use crate::parts;
use std::ops::{Add, Mul, Sub};

/// Nodes per piece of work: fixed, so that sums have the same order for any number of threads.
pub(super) const PIECE: usize = 2048;
/// Rows whose sums are kept side by side, and whose parts of a sum over all rows add up in the vectors' precision.
const ROWS: usize = 64;
/// Up to this many nodes one thread does all pieces: waking others twice in an iteration costs more.
const ALONE_UP_TO: usize = 6144;

/// The inverses of the 2x2 blocks on the diagonal.
#[derive(Debug, Clone)]
pub struct BlockJacobi {
    /// Of each node: `xx`, `xy`, `yy`.
    pub inverse: Vec<[f64; 3]>,
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

    /// Solves from zero until the residual has fallen by `reduction` or at `max_iterations`; same bits for any threads.
    pub fn solve(
        &self,
        matrix: &BlockMatrix,
        rhs: &[[f64; 2]],
        reduction: f64,
        max_iterations: usize,
    ) -> (Vec<[f64; 2]>, CgOutcome) {
        let roots: Vec<Root<f64>> = self.inverse.iter().map(Root::of).collect();
        let pattern = matrix.pattern();
        let mut blocks = matrix.blocks().to_vec();
        for (node, root) in roots.iter().enumerate() {
            for at in pattern.row(node) {
                blocks[at] = root.scaled(&blocks[at], &roots[pattern.columns()[at] as usize]);
            }
        }
        let scaled = roots.iter().zip(rhs).map(|(root, &b)| root.forward(b));
        let (mut x, outcome) = conjugate_gradients(&Whole { pattern, blocks }, scaled, reduction, max_iterations);
        x.iter_mut().zip(&roots).for_each(|(x, root)| *x = root.backward(*x));
        (x, outcome)
    }
}

/// A number that conjugate gradients are computed in.
pub(super) trait Real:
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

/// The inverse of the triangle `L` of a diagonal block, `L L^T`: `[[xx, 0], [yx, yy]]`; zero if not positive definite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Root<T> {
    xx: T,
    yx: T,
    yy: T,
}

impl Root<f64> {
    /// Of the inverse of a block, `L^-T L^-1`.
    pub fn of(&[xx, xy, yy]: &[f64; 3]) -> Self {
        let determinant = xx * yy - xy * xy;
        if !(determinant > 0.0 && yy > 0.0) {
            return Self { xx: 0.0, yx: 0.0, yy: 0.0 };
        }
        let root = yy.sqrt();
        Self { xx: (determinant / yy).sqrt(), yx: xy / root, yy: root }
    }

    /// `L^-1` of this node times its block `[xx, xy, yx, yy]` with another times `L^-T` of that.
    pub fn scaled(&self, [xx, xy, yx, yy]: &[f64; 4], other: &Self) -> [f64; 4] {
        let (left, right) = (self.forward([*xx, *yx]), self.forward([*xy, *yy]));
        let [upper, lower] = [0, 1].map(|row| other.forward([left[row], right[row]]));
        [upper[0], upper[1], lower[0], lower[1]]
    }

    pub fn single(&self) -> Root<f32> {
        Root { xx: self.xx as f32, yx: self.yx as f32, yy: self.yy as f32 }
    }
}

impl<T: Real> Root<T> {
    /// `L^-1 b`.
    pub fn forward(&self, [x, y]: [T; 2]) -> [T; 2] {
        [self.xx * x, self.yx * x + self.yy * y]
    }

    /// `L^-T x`.
    pub fn backward(&self, [x, y]: [T; 2]) -> [T; 2] {
        [self.xx * x + self.yx * y, self.yy * y]
    }
}

/// A symmetric matrix `A` that is scaled by the blocks on its diagonal, `A_ii = L_i L_i^T`: `L^-1 A L^-T`.
pub(super) trait Scaled<T>: Sync {
    fn n_nodes(&self) -> usize;

    /// How far before the first node and behind the last [`Scaled::image`] may read.
    fn margin(&self) -> usize;

    /// The image `w` of `r` at the nodes from `first`, where a piece begins, and `r . w`; `r` begins at its margin.
    fn image(&self, isa: Isa, r: &[[T; 2]], first: usize, w: &mut [[T; 2]]) -> f64;
}

/// Solves from zero until the residual, `rhs` at first, has fallen by `reduction` or `max_iterations` are done.
///
/// The image of a direction follows from that of the residual, as the direction itself does (Chronopoulos and Gear,
/// 1989): threads wait for each other twice in an iteration, not three times.
pub(super) fn conjugate_gradients<T: Real>(
    matrix: &impl Scaled<T>,
    rhs: impl Iterator<Item = [T; 2]>,
    reduction: f64,
    max_iterations: usize,
) -> (Vec<[T; 2]>, CgOutcome) {
    let (n, margin, isa) = (matrix.n_nodes(), matrix.margin(), Isa::detect());
    let zero = |n: usize| vec![[T::default(); 2]; n];
    // The directions p, their images q, and the images w of r.
    let (mut x, mut p, mut q, mut w) = (zero(n), zero(n), zero(n), zero(n));
    let mut r = zero(n + 2 * margin);
    r[margin..].iter_mut().zip(rhs).for_each(|(r, b)| *r = b);
    let square = |r: &[T; 2]| -> f64 { r.iter().map(|&r| r.into() * r.into()).sum() };
    let mut rr = in_order(r[margin..][..n].chunks(PIECE).map(|r| r.iter().map(square).sum()));
    let rr_start = rr;
    let mut of_pieces = vec![0.0; n.div_ceil(PIECE)];
    let (mut alpha, mut beta, mut iterations) = (1.0, 0.0, 0);
    while iterations < max_iterations && rr > reduction * reduction * rr_start && rr > 0.0 {
        let parts = w.chunks_mut(PIECE).zip(&mut of_pieces).enumerate();
        shared(n, parts, |(piece, (w, rw))| *rw = matrix.image(isa, &r, piece * PIECE, w));
        // p . q of the new direction.
        let pq = in_order(of_pieces.iter().copied()) - beta * rr / alpha;
        if pq <= 0.0 {
            break; // not positive definite along p: what is reached so far stands
        }
        alpha = rr / pq;
        let of_solution = x.chunks_mut(PIECE).zip(r[margin..][..n].chunks_mut(PIECE));
        let parts = of_solution.zip(p.chunks_mut(PIECE).zip(q.chunks_mut(PIECE)));
        let parts = parts.zip(w.chunks(PIECE)).zip(&mut of_pieces);
        shared(n, parts, |((((x, r), (p, q)), w), rr)| *rr = update(isa, [alpha, beta], w, [p, q, x, r]));
        let new_rr = in_order(of_pieces.iter().copied());
        (beta, rr) = (new_rr / rr, new_rr);
        iterations += 1;
    }
    let relative_residual = if rr_start > 0.0 { (rr / rr_start).max(0.0).sqrt() } else { 0.0 };
    (x, CgOutcome { iterations, relative_residual })
}

/// Does `work` for the parts of `n` nodes.
fn shared<P: Send>(n: usize, parts: impl Iterator<Item = P>, work: impl Fn(P) + Sync) {
    match n <= ALONE_UP_TO {
        true => parts.for_each(work),
        false => parts::for_each(parts.collect(), work),
    }
}

/// All digits of it.
struct Whole<'a> {
    pattern: &'a Pattern,
    blocks: Vec<[f64; 4]>,
}

impl Scaled<f64> for Whole<'_> {
    fn n_nodes(&self) -> usize {
        self.pattern.n_nodes()
    }

    fn margin(&self) -> usize {
        0
    }

    fn image(&self, isa: Isa, r: &[[f64; 2]], first: usize, w: &mut [[f64; 2]]) -> f64 {
        product(isa, self, r, first, w)
    }
}

multiversioned! {
    fn product[][](matrix: &Whole<'_>, r: &[[f64; 2]], first: usize, w: &mut [[f64; 2]]) -> f64 => product_body
}
multiversioned! {
    fn update[T: Real][T](alpha_and_beta: [f64; 2], w: &[[T; 2]], vectors: [&mut [[T; 2]]; 4]) -> f64 => update_body
}

#[inline(always)]
fn product_body<const FMA: bool>(matrix: &Whole<'_>, r: &[[f64; 2]], first: usize, w: &mut [[f64; 2]]) -> f64 {
    let mut sum = [0.0; 2];
    // Sums of some rows first: added where they are made, the compiler would shuffle the entries of every block for it.
    let mut sums = [[0.0; 4]; ROWS];
    for (w, first) in w.chunks_mut(ROWS).zip((first..).step_by(ROWS)) {
        for (sums, node) in sums[..w.len()].iter_mut().zip(first..) {
            *sums = row_sums(matrix.pattern, &matrix.blocks, node, r);
        }
        for ((w, &[xx, xy, yx, yy]), r) in w.iter_mut().zip(&sums).zip(&r[first..]) {
            *w = [xx + xy, yx + yy];
            (0..2).for_each(|c| sum[c] += w[c] * r[c]);
        }
    }
    sum[0] + sum[1]
}

/// p = r + beta p and q = w + beta q, then x += alpha p, r -= alpha q; returns r . r.
#[inline(always)]
fn update_body<const FMA: bool, T: Real>(alpha_and_beta: [f64; 2], w: &[[T; 2]], vectors: [&mut [[T; 2]]; 4]) -> f64 {
    const LANES: usize = 16;
    let by = alpha_and_beta.map(T::rounded);
    let [p, q, x, r] = vectors.map(|of| of.as_flattened_mut().chunks_mut(2 * ROWS));
    let (mut sum, mut of_rest) = ([0.0; LANES], 0.0);
    for ((w, p), (q, (x, r))) in w.as_flattened().chunks(2 * ROWS).zip(p).zip(q.zip(x.zip(r))) {
        let (w, w_rest) = w.as_chunks::<LANES>();
        let [(p, p_rest), (q, q_rest), (x, x_rest), (r, r_rest)] = [p, q, x, r].map(|of| of.as_chunks_mut::<LANES>());
        let mut squares = [T::default(); LANES];
        for ((w, p), (q, (x, r))) in w.iter().zip(p).zip(q.iter_mut().zip(x.iter_mut().zip(r))) {
            update_lanes(by, w, [p, q, x, r], &mut squares);
        }
        (0..LANES).for_each(|l| sum[l] += squares[l].into());
        for ((w, p), (q, (x, r))) in w_rest.iter().zip(p_rest).zip(q_rest.iter_mut().zip(x_rest.iter_mut().zip(r_rest)))
        {
            let mut square = [T::default()];
            let one = [p, q, x, r].map(std::array::from_mut);
            update_lanes(by, &[*w], one, &mut square);
            of_rest += square[0].into();
        }
    }
    sum.iter().sum::<f64>() + of_rest
}

#[inline(always)]
fn update_lanes<T: Real, const L: usize>(
    [alpha, beta]: [T; 2],
    w: &[T; L],
    [p, q, x, r]: [&mut [T; L]; 4],
    squares: &mut [T; L],
) {
    for l in 0..L {
        p[l] = r[l] + beta * p[l];
        q[l] = w[l] + beta * q[l];
        x[l] = x[l] + alpha * p[l];
        r[l] = r[l] - alpha * q[l];
        squares[l] = squares[l] + r[l] * r[l];
    }
}

fn inverted([xx, xy, yy]: [f64; 3]) -> [f64; 3] {
    let determinant = xx * yy - xy * xy;
    if determinant > 0.0 { [yy / determinant, -xy / determinant, xx / determinant] } else { [0.0; 3] }
}

fn in_order(parts: impl IntoIterator<Item = f64>) -> f64 {
    parts.into_iter().fold(0.0, |sum, part| sum + part)
}
