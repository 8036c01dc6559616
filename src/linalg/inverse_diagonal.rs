//! The 2x2 diagonal blocks of the inverse of a normal matrix, all nodes at once.

use super::blocks::BlockMatrix;
use super::conjugate_gradients::BlockJacobi;
use crate::isa::{Isa, mul_add, multiversioned};
use rayon::prelude::*;

/// Right-hand sides solved together, one per lane.
const LANES: usize = 16;
/// Fall of the residual at which the iterations stop: about nine of them.
const REDUCTION: f32 = 2e-3;
/// Reached only where texture is so poor that the matrix is nearly singular.
const MAX_ITERATIONS: usize = 100;
const PIECE: usize = 1024;

type Lanes = [f32; LANES];

/// Variances `[xx, yy]` of each node in the inverse of `matrix`.
///
/// The inverse of a normal matrix decays by about 0.27 per step along a mesh line, so one right-hand side
/// can hold unit loads at many nodes far apart: `colour` (0..16) says which nodes share one; nodes of one
/// colour must be at least five steps apart. Random signs (fixed, by node number) keep what leaks from one
/// load to the next, about 0.15 % each, from adding up: the standard deviations are right to 0.2 % typically, 1 %
/// at worst.
pub fn inverse_diagonal(isa: Isa, matrix: &BlockMatrix, jacobi: &BlockJacobi, colour: &[u32]) -> Vec<[f64; 2]> {
    probed(isa, matrix, jacobi, colour, None, |node| node).0
}

/// As [`inverse_diagonal`] for `A` (`matrix`), and with it the diagonal of `A^-1 B A^-1` for a second matrix `B` on the
/// same pattern: `(diagonal of A^-1, diagonal of A^-1 B A^-1)`.
///
/// With the column `x` of the inverse the second is `x . B x`. Where `B` is about a multiple of `A`, `B x` is about that
/// multiple of a unit load, so that a sum over the node and its neighbours is enough: exact then, else short of terms of
/// second order in how uneven the two are, from two steps away.
///
/// # Panics
/// When the patterns differ.
pub fn inverse_diagonal_with(
    isa: Isa,
    matrix: &BlockMatrix,
    jacobi: &BlockJacobi,
    colour: &[u32],
    second: &BlockMatrix,
) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    assert_eq!(matrix.pattern().n_blocks(), second.pattern().n_blocks(), "matrices on different patterns");
    probed(isa, matrix, jacobi, colour, Some(second), |node| node)
}

/// As [`inverse_diagonal_with`] for the parts of two matrices at the `nodes` of a mesh, with the signs that these have in the
/// whole: what leaks is then the same.
pub(crate) fn inverse_diagonal_of_part(
    isa: Isa,
    (matrix, second): (&BlockMatrix, &BlockMatrix),
    colour: &[u32],
    nodes: &[u32],
) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    assert_eq!(matrix.pattern().n_blocks(), second.pattern().n_blocks(), "matrices on different patterns");
    probed(isa, matrix, &BlockJacobi::new(matrix), colour, Some(second), |node| nodes[node] as usize)
}

fn probed(
    isa: Isa,
    matrix: &BlockMatrix,
    jacobi: &BlockJacobi,
    colour: &[u32],
    second: Option<&BlockMatrix>,
    number: impl Fn(usize) -> usize + Sync,
) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    let sign = |node: usize| sign(number(node));
    let mut forms = vec![[0.0; 2]; if second.is_some() { colour.len() } else { 0 }];
    let blocks: Vec<[f32; 4]> = matrix.blocks().par_iter().map(|b| b.map(|v| v as f32)).collect();
    let inverse: Vec<[f32; 3]> = jacobi.inverse.iter().map(|b| b.map(|v| v as f32)).collect();
    let n_colours = colour.iter().max().map_or(0, |&c| c as usize + 1);
    let mut variance = vec![[0.0; 2]; colour.len()];
    // Lane 2 k + c of a batch: colour 8 b + k, component c.
    for batch in 0..n_colours.div_ceil(LANES / 2) {
        let first = (batch * LANES / 2) as u32;
        let lane_of = |node: usize| {
            let c = colour[node];
            (first..first + LANES as u32 / 2).contains(&c).then(|| 2 * (c - first) as usize)
        };
        let load: Vec<[Lanes; 2]> = (0..colour.len())
            .into_par_iter()
            .with_min_len(PIECE)
            .map(|node| {
                let mut rows = [[0.0; LANES]; 2];
                if let Some(lane) = lane_of(node) {
                    rows[0][lane] = sign(node);
                    rows[1][lane + 1] = sign(node);
                }
                rows
            })
            .collect();
        let x = solve_lanes(isa, matrix, &blocks, &inverse, load);
        for (node, x) in x.iter().enumerate() {
            if let Some(lane) = lane_of(node) {
                variance[node] =
                    [f64::from(x[0][lane] * sign(node)).max(0.0), f64::from(x[1][lane + 1] * sign(node)).max(0.0)];
            }
        }
        if let Some(second) = second {
            forms.par_iter_mut().enumerate().with_min_len(PIECE / 4).for_each(|(node, forms)| {
                if let Some(lane) = lane_of(node) {
                    *forms = forms_nearby(second, node, &x, lane);
                }
            });
        }
    }
    (variance, forms)
}

/// `x . B x` for the columns in a lane and the next, summed over the rows of a node and its neighbours.
fn forms_nearby(b: &BlockMatrix, node: usize, x: &[[Lanes; 2]], lane: usize) -> [f64; 2] {
    let pattern = b.pattern();
    // Of both columns.
    let value = |node: u32| x[node as usize].map(|x| [lane, lane + 1].map(|lane| f64::from(x[lane])));
    let mut sum = [0.0; 2];
    for &near in pattern.neighbours(node) {
        let mut image = [[0.0; 2]; 2];
        let row = pattern.row(near as usize);
        for (b, &column) in b.blocks()[row.clone()].iter().zip(&pattern.columns()[row]) {
            let [x, y] = value(column);
            for k in 0..2 {
                image[0][k] += b[0] * x[k] + b[1] * y[k];
                image[1][k] += b[2] * x[k] + b[3] * y[k];
            }
        }
        let [x, y] = value(near);
        for k in 0..2 {
            sum[k] += x[k] * image[0][k] + y[k] * image[1][k];
        }
    }
    sum
}

/// A fixed random sign per node (hash of its number).
fn sign(node: usize) -> f32 {
    let hash = (node as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    if (hash ^ (hash >> 29)) >> 40 & 1 == 0 { 1.0 } else { -1.0 }
}

/// Conjugate gradients, each lane its own system.
fn solve_lanes(
    isa: Isa,
    matrix: &BlockMatrix,
    blocks: &[[f32; 4]],
    inverse: &[[f32; 3]],
    mut r: Vec<[Lanes; 2]>,
) -> Vec<[Lanes; 2]> {
    let n = r.len();
    let mut x = vec![[[0.0; LANES]; 2]; n];
    let mut q = vec![[[0.0; LANES]; 2]; n];
    let mut p = vec![[[0.0; LANES]; 2]; n];
    let zero = [0.0; LANES];
    let mut rz = update(isa, inverse, &zero, &p, &mut x, &mut r, &mut q);
    let wanted = rz.map(|rz| REDUCTION * REDUCTION * rz);
    p.copy_from_slice(&q);
    for _ in 0..MAX_ITERATIONS {
        if rz.iter().zip(&wanted).all(|(rz, wanted)| rz <= wanted) {
            break;
        }
        let pq: Vec<Lanes> = q
            .par_chunks_mut(PIECE)
            .enumerate()
            .map(|(piece, q)| product(isa, matrix, blocks, &p, piece * PIECE, q))
            .collect();
        let pq = in_order(&pq);
        let alpha = ratio(&rz, &pq);
        let new_rz = update(isa, inverse, &alpha, &p, &mut x, &mut r, &mut q);
        let beta = ratio(&new_rz, &rz);
        rz = new_rz;
        p.par_chunks_mut(PIECE).zip(q.par_chunks(PIECE)).for_each(|(p, z)| direction(isa, &beta, p, z));
    }
    x
}

fn ratio(a: &Lanes, b: &Lanes) -> Lanes {
    std::array::from_fn(|k| if b[k] > 0.0 { a[k] / b[k] } else { 0.0 })
}

fn in_order(parts: &[Lanes]) -> Lanes {
    // Across pieces in f64: a lane sums over all nodes.
    let mut sum = [0.0f64; LANES];
    for part in parts {
        for (s, v) in sum.iter_mut().zip(part) {
            *s += f64::from(*v);
        }
    }
    sum.map(|s| s as f32)
}

/// x += alpha p, r -= alpha q, then q = inverse blocks times r; returns r . q.
fn update(
    isa: Isa,
    inverse: &[[f32; 3]],
    alpha: &Lanes,
    p: &[[Lanes; 2]],
    x: &mut [[Lanes; 2]],
    r: &mut [[Lanes; 2]],
    q: &mut [[Lanes; 2]],
) -> Lanes {
    let parts: Vec<Lanes> = x
        .par_chunks_mut(PIECE)
        .zip(r.par_chunks_mut(PIECE))
        .zip(q.par_chunks_mut(PIECE))
        .zip(p.par_chunks(PIECE).zip(inverse.par_chunks(PIECE)))
        .map(|(((x, r), q), (p, inverse))| update_piece(isa, inverse, alpha, p, x, r, q))
        .collect();
    in_order(&parts)
}

multiversioned! {
    fn product[][](matrix: &BlockMatrix, blocks: &[[f32; 4]], p: &[[Lanes; 2]], first: usize, q: &mut [[Lanes; 2]]) -> Lanes
        => product_body
}
multiversioned! {
    fn update_piece[][](inverse: &[[f32; 3]], alpha: &Lanes, p: &[[Lanes; 2]], x: &mut [[Lanes; 2]], r: &mut [[Lanes; 2]], q: &mut [[Lanes; 2]]) -> Lanes
        => update_body
}
multiversioned! {
    fn direction[][](beta: &Lanes, p: &mut [[Lanes; 2]], z: &[[Lanes; 2]]) => direction_body
}

#[inline(always)]
fn product_body<const FMA: bool>(
    matrix: &BlockMatrix,
    blocks: &[[f32; 4]],
    p: &[[Lanes; 2]],
    first: usize,
    q: &mut [[Lanes; 2]],
) -> Lanes {
    let mut dot = [0.0; LANES];
    for (k, q) in q.iter_mut().enumerate() {
        let row = matrix.pattern().row(first + k);
        let mut sum = [[0.0; LANES]; 2];
        for (block, &column) in blocks[row.clone()].iter().zip(&matrix.pattern().columns()[row]) {
            let v = &p[column as usize];
            for lane in 0..LANES {
                sum[0][lane] = mul_add::<FMA>(block[0], v[0][lane], mul_add::<FMA>(block[1], v[1][lane], sum[0][lane]));
                sum[1][lane] = mul_add::<FMA>(block[2], v[0][lane], mul_add::<FMA>(block[3], v[1][lane], sum[1][lane]));
            }
        }
        let own = &p[first + k];
        for lane in 0..LANES {
            dot[lane] =
                mul_add::<FMA>(sum[0][lane], own[0][lane], mul_add::<FMA>(sum[1][lane], own[1][lane], dot[lane]));
        }
        *q = sum;
    }
    dot
}

#[inline(always)]
fn update_body<const FMA: bool>(
    inverse: &[[f32; 3]],
    alpha: &Lanes,
    p: &[[Lanes; 2]],
    x: &mut [[Lanes; 2]],
    r: &mut [[Lanes; 2]],
    q: &mut [[Lanes; 2]],
) -> Lanes {
    let mut dot = [0.0; LANES];
    for k in 0..x.len() {
        let [xx, xy, yy] = inverse[k];
        // One component after the other: lanes that lie side by side in memory.
        for c in 0..2 {
            for lane in 0..LANES {
                x[k][c][lane] = mul_add::<FMA>(alpha[lane], p[k][c][lane], x[k][c][lane]);
                r[k][c][lane] = mul_add::<FMA>(-alpha[lane], q[k][c][lane], r[k][c][lane]);
            }
        }
        let [rx, ry] = r[k];
        let (mut zx, mut zy) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            zx[lane] = xx * rx[lane] + xy * ry[lane];
            zy[lane] = xy * rx[lane] + yy * ry[lane];
            dot[lane] = mul_add::<FMA>(rx[lane], zx[lane], mul_add::<FMA>(ry[lane], zy[lane], dot[lane]));
        }
        q[k] = [zx, zy];
    }
    dot
}

#[inline(always)]
fn direction_body<const FMA: bool>(beta: &Lanes, p: &mut [[Lanes; 2]], z: &[[Lanes; 2]]) {
    for (p, z) in p.iter_mut().zip(z) {
        // Unseen by the compiler, which would take a lane of sixteen nodes together, by gathering and scattering.
        let beta = std::hint::black_box(beta);
        for c in 0..2 {
            for lane in 0..LANES {
                p[c][lane] = mul_add::<FMA>(beta[lane], p[c][lane], z[c][lane]);
            }
        }
    }
}
