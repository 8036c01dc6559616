//! The 2x2 diagonal blocks of the inverse of a normal matrix, all nodes at once.

use super::blocks::{BlockMatrix, Pattern};
use super::conjugate_gradients::BlockJacobi;
use crate::isa::{Isa, mul_add, multiversioned};
use rayon::prelude::*;

/// Right-hand sides solved together, one per lane.
const LANES: usize = 16;
/// Fall of the residual at which the iterations stop: about nine of them.
const REDUCTION: f32 = 2e-3;
/// Reached only where texture is so poor that the matrix is nearly singular.
const MAX_ITERATIONS: usize = 100;
/// Nodes whose lanes are summed in single precision.
const PIECE: usize = 1024;
/// Nodes that one thread does by themselves, in its cache.
const TILE: usize = 2048;
/// and with them those at most so many steps away, as far as loads of one colour are apart; all others are held
/// meanwhile, which takes about 0.27^10 = 2e-6 of a variance.
const RINGS: usize = 5;

type Lanes = [f32; LANES];

/// Variances `[xx, yy]` of each node in the inverse of `matrix`.
///
/// The inverse of a normal matrix decays by about 0.27 per step along a mesh line, so one right-hand side can hold unit
/// loads at many nodes far apart: `colour` (0..16) says which nodes share one; nodes of one colour must be at least
/// five steps apart. Random signs (fixed, by node number) keep what leaks from one load to the next, about 0.15 % each,
/// from adding up: the standard deviations are right to 0.2 % typically, 1 % at worst.
pub fn inverse_diagonal(isa: Isa, matrix: &BlockMatrix, jacobi: &BlockJacobi, colour: &[u32]) -> Vec<[f64; 2]> {
    probed(isa, matrix, jacobi, colour, None, |node| node).0
}

/// As [`inverse_diagonal`] for `A` (`matrix`), and with it the diagonal of `A^-1 B A^-1` for a second matrix `B` on the
/// same pattern: `(diagonal of A^-1, diagonal of A^-1 B A^-1)`.
///
/// With the column `x` of the inverse the second is `x . B x`. Where `B` is about a multiple of `A`, `B x` is about
/// that multiple of a unit load, so that a sum over the node and its neighbours is enough: exact then, else short of
/// terms of second order in how uneven the two are, from two steps away.
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

/// As [`inverse_diagonal_with`] for parts of two matrices at `nodes` with the signs of the whole: leaks are the same.
pub fn inverse_diagonal_of_part(
    isa: Isa,
    (matrix, second): (&BlockMatrix, &BlockMatrix),
    colour: &[u32],
    nodes: &[u32],
) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    assert_eq!(matrix.pattern().n_blocks(), second.pattern().n_blocks(), "matrices on different patterns");
    probed(isa, matrix, &BlockJacobi::new(matrix), colour, Some(second), |node| nodes[node] as usize)
}

/// Group by group of nodes, each by one thread with its vectors in the cache, not a dozen times from memory.
fn probed(
    isa: Isa,
    matrix: &BlockMatrix,
    jacobi: &BlockJacobi,
    colour: &[u32],
    second: Option<&BlockMatrix>,
    number: impl Fn(usize) -> usize + Sync,
) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    let sign = |node: u32| sign(number(node as usize));
    let n_colours = colour.iter().max().map_or(0, |&c| c as usize + 1);
    let tiles = tiles(matrix.pattern());
    let of_tile = |place: &mut Vec<u32>, tile: &Vec<u32>| {
        let part = Part::around(tile, matrix, jacobi, place);
        let mut found = vec![([0.0; 2], [0.0; 2]); tile.len()];
        // Lane 2 k + c of a batch: colour 8 b + k, component c.
        for batch in 0..n_colours.div_ceil(LANES / 2) {
            let first = (batch * LANES / 2) as u32;
            let lane_of = |node: u32| {
                let c = colour[node as usize];
                (first..first + LANES as u32 / 2).contains(&c).then(|| 2 * (c - first) as usize)
            };
            let load = part.nodes.iter().map(|&node| {
                let mut rows = [[0.0; LANES]; 2];
                if let Some(lane) = lane_of(node) {
                    rows[0][lane] = sign(node);
                    rows[1][lane + 1] = sign(node);
                }
                rows
            });
            let x = part.solve_lanes(isa, load.collect());
            for (&node, (variance, forms)) in tile.iter().zip(&mut found) {
                let Some(lane) = lane_of(node) else { continue };
                let [own_x, own_y] = &x[place[node as usize] as usize];
                *variance = [own_x[lane], own_y[lane + 1]].map(|v| f64::from(v * sign(node)).max(0.0));
                if let Some(second) = second {
                    *forms = forms_nearby(second, node, |node| &x[place[node as usize] as usize], lane);
                }
            }
        }
        part.nodes.iter().for_each(|&node| place[node as usize] = NOWHERE);
        found
    };
    let n = matrix.pattern().n_nodes();
    let found: Vec<_> = tiles.par_iter().map_init(|| vec![NOWHERE; n], of_tile).collect();
    let mut variance = vec![[0.0; 2]; n];
    let mut forms = vec![[0.0; 2]; if second.is_some() { n } else { 0 }];
    for (&node, (of_node, form)) in tiles.iter().flatten().zip(found.iter().flatten()) {
        variance[node as usize] = *of_node;
        forms.get_mut(node as usize).into_iter().for_each(|forms| *forms = *form);
    }
    (variance, forms)
}

/// All nodes in groups of some [`TILE`] that lie beside each other.
fn tiles(pattern: &Pattern) -> Vec<Vec<u32>> {
    let mut taken = vec![false; pattern.n_nodes()];
    let mut tiles: Vec<Vec<u32>> = Vec::new();
    for start in 0..pattern.n_nodes() as u32 {
        let mut tile = Vec::new();
        let mut take = |node: u32, tile: &mut Vec<u32>| {
            if tile.len() < TILE && !std::mem::replace(&mut taken[node as usize], true) {
                tile.push(node);
            }
        };
        take(start, &mut tile);
        let mut at = 0;
        while at < tile.len() && tile.len() < TILE {
            pattern.neighbours(tile[at] as usize).iter().for_each(|&node| take(node, &mut tile));
            at += 1;
        }
        match tiles.last_mut() {
            // What is left between others.
            Some(last) if tile.len() < TILE / 4 && last.len() < TILE + TILE / 2 => last.append(&mut tile),
            _ if tile.is_empty() => {}
            _ => tiles.push(tile),
        }
    }
    tiles
}

const NOWHERE: u32 = u32::MAX;

/// The rows and columns of some nodes alone, in single precision: as if all others were held.
struct Part {
    /// Ascending.
    nodes: Vec<u32>,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
    blocks: Vec<[f32; 4]>,
    /// Of the blocks on the diagonal.
    inverse: Vec<[f32; 3]>,
}

impl Part {
    /// That of a tile and the [`RINGS`] around it; writes the places of its nodes into `place`.
    fn around(tile: &[u32], matrix: &BlockMatrix, jacobi: &BlockJacobi, place: &mut [u32]) -> Self {
        let pattern = matrix.pattern();
        let mut nodes = tile.to_vec();
        tile.iter().for_each(|&node| place[node as usize] = 0);
        let mut ring = 0..nodes.len();
        for _ in 0..RINGS {
            for at in ring.clone() {
                for &node in pattern.neighbours(nodes[at] as usize) {
                    if std::mem::replace(&mut place[node as usize], 0) == NOWHERE {
                        nodes.push(node);
                    }
                }
            }
            ring = ring.end..nodes.len();
        }
        nodes.sort_unstable();
        (0..).zip(&nodes).for_each(|(at, &node)| place[node as usize] = at);
        let mut row_starts = Vec::with_capacity(nodes.len() + 1);
        let (mut columns, mut blocks) = (Vec::with_capacity(9 * nodes.len()), Vec::with_capacity(9 * nodes.len()));
        row_starts.push(0);
        for &node in &nodes {
            let row = pattern.row(node as usize);
            for (block, &column) in matrix.blocks()[row.clone()].iter().zip(&pattern.columns()[row]) {
                if place[column as usize] != NOWHERE {
                    columns.push(place[column as usize]);
                    blocks.push(block.map(|v| v as f32));
                }
            }
            row_starts.push(columns.len() as u32);
        }
        let inverse = nodes.iter().map(|&node| jacobi.inverse[node as usize].map(|v| v as f32)).collect();
        Self { nodes, row_starts, columns, blocks, inverse }
    }

    /// Conjugate gradients, each lane its own system.
    fn solve_lanes(&self, isa: Isa, mut r: Vec<[Lanes; 2]>) -> Vec<[Lanes; 2]> {
        let n = r.len();
        let mut x = vec![[[0.0; LANES]; 2]; n];
        let mut q = vec![[[0.0; LANES]; 2]; n];
        let mut p = vec![[[0.0; LANES]; 2]; n];
        let zero = [0.0; LANES];
        let mut rz = self.update(isa, &zero, &p, [&mut x, &mut r, &mut q]);
        let wanted = rz.map(|rz| REDUCTION * REDUCTION * rz);
        p.copy_from_slice(&q);
        for _ in 0..MAX_ITERATIONS {
            if rz.iter().zip(&wanted).all(|(rz, wanted)| rz <= wanted) {
                break;
            }
            let pieces = (0..).step_by(PIECE).zip(q.chunks_mut(PIECE));
            let pq = in_order(pieces.map(|(first, q)| product(isa, self, &p, first, q)));
            let alpha = ratio(&rz, &pq);
            let new_rz = self.update(isa, &alpha, &p, [&mut x, &mut r, &mut q]);
            let beta = ratio(&new_rz, &rz);
            rz = new_rz;
            direction(isa, &beta, &mut p, &q);
        }
        x
    }

    /// x += alpha p, r -= alpha q, then q = inverse blocks times r; returns r . q.
    fn update(&self, isa: Isa, alpha: &Lanes, p: &[[Lanes; 2]], [x, r, q]: [&mut [[Lanes; 2]]; 3]) -> Lanes {
        let pieces = x.chunks_mut(PIECE).zip(r.chunks_mut(PIECE)).zip(q.chunks_mut(PIECE));
        let pieces = pieces.zip(p.chunks(PIECE).zip(self.inverse.chunks(PIECE)));
        in_order(pieces.map(|(((x, r), q), (p, inverse))| update_piece(isa, inverse, alpha, p, x, r, q)))
    }
}

/// `x . B x` for the columns in a lane and the next, summed over the rows of a node and its neighbours.
fn forms_nearby<'a>(b: &BlockMatrix, node: u32, x: impl Fn(u32) -> &'a [Lanes; 2], lane: usize) -> [f64; 2] {
    let pattern = b.pattern();
    // Of both columns.
    let value = |node: u32| x(node).map(|x| [lane, lane + 1].map(|lane| f64::from(x[lane])));
    let mut sum = [0.0; 2];
    for &near in pattern.neighbours(node as usize) {
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

fn ratio(a: &Lanes, b: &Lanes) -> Lanes {
    std::array::from_fn(|k| if b[k] > 0.0 { a[k] / b[k] } else { 0.0 })
}

fn in_order(parts: impl Iterator<Item = Lanes>) -> Lanes {
    // Across pieces in f64: a lane sums over all nodes.
    let mut sum = [0.0f64; LANES];
    for part in parts {
        for (s, v) in sum.iter_mut().zip(&part) {
            *s += f64::from(*v);
        }
    }
    sum.map(|s| s as f32)
}

multiversioned! {
    fn product[][](part: &Part, p: &[[Lanes; 2]], first: usize, q: &mut [[Lanes; 2]]) -> Lanes => product_body
}
multiversioned! {
    fn update_piece[][](inverse: &[[f32; 3]], alpha: &Lanes, p: &[[Lanes; 2]], x: &mut [[Lanes; 2]], r: &mut [[Lanes; 2]], q: &mut [[Lanes; 2]]) -> Lanes
        => update_body
}
multiversioned! {
    fn direction[][](beta: &Lanes, p: &mut [[Lanes; 2]], z: &[[Lanes; 2]]) => direction_body
}

#[inline(always)]
fn product_body<const FMA: bool>(part: &Part, p: &[[Lanes; 2]], first: usize, q: &mut [[Lanes; 2]]) -> Lanes {
    let mut dot = [0.0; LANES];
    for (k, q) in q.iter_mut().enumerate() {
        let row = part.row_starts[first + k] as usize..part.row_starts[first + k + 1] as usize;
        let mut sum = [[0.0; LANES]; 2];
        for (block, &column) in part.blocks[row.clone()].iter().zip(&part.columns[row]) {
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
