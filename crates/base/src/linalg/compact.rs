//! A matrix for conjugate gradients in as few bytes as it takes: what these do most of the time is read it.
//!
//! Scaled by the blocks on its diagonal, `L^-1 A L^-T` with `A_ii = L_i L_i^T`, no entry is larger than 1, and the
//! blocks on the diagonal are ones. So 16 bits tell an entry to 1.5e-5, far below what the solution is wanted to, in
//! whatever direction a node has little texture; and where nodes one after the other have their neighbours at the same
//! distances, as on a grid, these are said once for all of them.

use super::blocks::{BlockMatrix, Pattern, ROWS_OF_A_PART, ranges_mut};
use super::conjugate_gradients::{BlockJacobi, PIECE, Root, Scaled, conjugate_gradients};
use crate::isa::{Isa, multiversioned};
use crate::parts;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Nodes side by side.
const SIDE: usize = 8;
/// Their unknowns.
const LANES: usize = 2 * SIDE;
/// Distances to neighbours are said once for the nodes side by side where there are no more than so many for each
/// neighbour of one of them: on a grid there is one, beside a hole there may be two.
const MOST_DISTANCES: usize = 2;
/// What an entry of 1 is stored as.
const ONE: f32 = 32767.0;
/// Groups whose parts of a sum over all nodes are added up in the precision of the vectors.
const TOGETHER: usize = 8;

/// Entries that take part together: of [`SIDE`] nodes, for each a block with one neighbour.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Slot {
    /// From a component to the same one.
    straight: [i16; LANES],
    /// From each component of the neighbour to the other one.
    crossed: [i16; LANES],
}

impl Slot {
    const NONE: Self = Self { straight: [0; LANES], crossed: [0; LANES] };
}

/// Where the neighbours of a group of nodes are.
#[derive(Debug, Clone, Copy)]
struct Group {
    /// First of its slots.
    slot: u32,
    /// First of its neighbours in the list of these.
    neighbour: u32,
    /// Whether there is one distance per slot; else there are [`SIDE`] nodes.
    by_distance: bool,
}

/// What follows from the pattern alone.
#[derive(Debug)]
struct Places {
    /// One more closes the last.
    groups: Vec<Group>,
    /// Distances, or nodes.
    neighbours: Vec<i32>,
    /// The largest distance, and a group.
    margin: usize,
}

impl Places {
    fn new(pattern: &Pattern) -> Self {
        let n_nodes = pattern.n_nodes();
        let (mut groups, mut neighbours, mut farthest, mut slots) = (Vec::new(), Vec::new(), 0, 0);
        let mut distances: Vec<i32> = Vec::new();
        for first in (0..n_nodes).step_by(SIDE) {
            let nodes = first..(first + SIDE).min(n_nodes);
            distances.clear();
            distances
                .extend(nodes.clone().flat_map(|node| others(pattern, node).map(move |(_, at)| distance(node, at))));
            distances.sort_unstable();
            distances.dedup();
            let most = nodes.clone().map(|node| others(pattern, node).count()).max().unwrap_or(0);
            let group = Group {
                slot: slots,
                neighbour: neighbours.len() as u32,
                by_distance: distances.len() <= MOST_DISTANCES * most,
            };
            groups.push(group);
            if group.by_distance {
                slots += distances.len() as u32;
                farthest = distances.iter().map(|d| d.unsigned_abs()).fold(farthest, u32::max);
                neighbours.extend(&distances);
            } else {
                slots += most as u32;
                // Where there is none any node will do: its entries are zero.
                let start = neighbours.len();
                neighbours.resize(start + most * SIDE, first as i32);
                for (lane, node) in nodes.enumerate() {
                    for (slot, (_, at)) in others(pattern, node).enumerate() {
                        neighbours[start + slot * SIDE + lane] = at as i32;
                    }
                }
            }
        }
        groups.push(Group { slot: slots, neighbour: neighbours.len() as u32, by_distance: true });
        Self { groups, neighbours, margin: farthest as usize + SIDE }
    }

    /// The slots of groups one after the other.
    fn slots(&self, groups: Range<usize>) -> Range<usize> {
        self.groups[groups.start].slot as usize..self.groups[groups.end].slot as usize
    }

    /// The neighbours of a group, and whether they are said by their distance.
    fn neighbours(&self, group: usize) -> (&[i32], bool) {
        let [Group { neighbour, by_distance, .. }, end] = [self.groups[group], self.groups[group + 1]];
        (&self.neighbours[neighbour as usize..end.neighbour as usize], by_distance)
    }
}

/// The blocks of a node with others, and these nodes.
fn others(pattern: &Pattern, node: usize) -> impl Iterator<Item = (usize, usize)> {
    let row = pattern.row(node);
    let columns = &pattern.columns()[row.clone()];
    row.zip(columns.iter().map(|&column| column as usize)).filter(move |(_, column)| *column != node)
}

fn distance(from: usize, to: usize) -> i32 {
    to as i32 - from as i32
}

/// To the nearest; a value beyond the range, of a matrix that is not positive definite, as its end.
fn stored(entry: f64) -> i16 {
    let entry = entry * f64::from(ONE);
    (entry + 0.5f64.copysign(entry)) as i16
}

/// Fills in the row of a node in the slots of its group.
fn fill(places: &Places, roots: &[Root<f64>], matrix: &BlockMatrix, node: usize, slots: &mut [Slot]) {
    let lane = node % SIDE;
    let (neighbours, by_distance) = places.neighbours(node / SIDE);
    let of_both = [2 * lane, 2 * lane + 1];
    for Slot { straight, crossed } in slots.iter_mut() {
        of_both.into_iter().for_each(|lane| (straight[lane], crossed[lane]) = (0, 0));
    }
    for (k, (at, other)) in others(matrix.pattern(), node).enumerate() {
        let slot = match by_distance {
            true => neighbours.binary_search(&distance(node, other)).expect("a distance of the group"),
            false => k,
        };
        let block = roots[node].scaled(&matrix.blocks()[at], &roots[other]);
        let [xx, xy, yx, yy] = block.map(stored);
        let Slot { straight, crossed } = &mut slots[slot];
        [straight[of_both[0]], straight[of_both[1]]] = [xx, yy];
        [crossed[of_both[0]], crossed[of_both[1]]] = [yx, xy];
    }
}

/// A symmetric matrix scaled by the blocks on its diagonal, in 16 bits an entry.
#[derive(Debug, Clone)]
pub(super) struct Compact {
    places: Arc<Places>,
    roots: Vec<Root<f64>>,
    slots: Vec<Slot>,
}

impl Compact {
    pub fn new(matrix: &BlockMatrix, jacobi: &BlockJacobi) -> Self {
        let n_nodes = matrix.pattern().n_nodes();
        let roots: Vec<Root<f64>> = jacobi.inverse.par_iter().with_min_len(PIECE).map(Root::of).collect();
        let places = Arc::new(Places::new(matrix.pattern()));
        let mut slots = vec![Slot::NONE; places.slots(0..places.groups.len() - 1).len()];
        let firsts = (0..n_nodes).step_by(PIECE);
        let pieces: Vec<_> = firsts.map(|first| first / SIDE..(first + PIECE).min(n_nodes).div_ceil(SIDE)).collect();
        let of_pieces = ranges_mut(&mut slots, pieces.iter().map(|groups| places.slots(groups.clone())));
        pieces.into_par_iter().zip(of_pieces).for_each(|(groups, mut slots)| {
            for group in groups {
                let (own, others) = slots.split_at_mut(places.slots(group..group + 1).len());
                for node in group * SIDE..((group + 1) * SIDE).min(n_nodes) {
                    fill(&places, &roots, matrix, node, own);
                }
                slots = others;
            }
        });
        Self { places, roots, slots }
    }

    /// Follows the matrix, in which the rows and columns of `nodes` have changed.
    pub fn follow(&mut self, matrix: &BlockMatrix, jacobi: &BlockJacobi, nodes: &[u32]) {
        let Self { places, roots, slots } = self;
        nodes.iter().for_each(|&node| roots[node as usize] = Root::of(&jacobi.inverse[node as usize]));
        // Those beside them are scaled with theirs.
        let around = matrix.pattern().around(nodes, 1);
        let group_of = |node: &u32| *node as usize / SIDE;
        let groups: Vec<&[u32]> = around.chunk_by(|a, b| group_of(a) == group_of(b)).collect();
        let of_groups = groups.iter().map(|nodes| group_of(&nodes[0]));
        let mut slots = ranges_mut(slots, of_groups.map(|group| places.slots(group..group + 1)));
        let some = groups.chunks(ROWS_OF_A_PART / 2).zip(slots.chunks_mut(ROWS_OF_A_PART / 2)).collect();
        parts::for_each(some, |(groups, slots): (&[&[u32]], &mut [&mut [Slot]])| {
            for (nodes, slots) in groups.iter().zip(slots) {
                nodes.iter().for_each(|&node| fill(places, roots, matrix, node as usize, slots));
            }
        });
    }

    /// Solves `matrix x = rhs` from zero until the residual has fallen by `reduction`, in the norm of the inverse
    /// blocks on the diagonal, or `max_iterations` are done. The same bits for any number of threads.
    pub fn solve(&self, rhs: &[[f32; 2]], reduction: f64, max_iterations: usize) -> Vec<[f32; 2]> {
        let roots = || self.roots.iter().map(Root::single);
        let scaled = roots().zip(rhs).map(|(root, &b)| root.forward(b));
        let (mut x, _) = conjugate_gradients(self, scaled, reduction, max_iterations);
        x.iter_mut().zip(roots()).for_each(|(x, root)| *x = root.backward(*x));
        x
    }
}

impl Scaled<f32> for Compact {
    fn n_nodes(&self) -> usize {
        self.roots.len()
    }

    fn margin(&self) -> usize {
        self.places.margin
    }

    fn image(&self, isa: Isa, r: &[[f32; 2]], first: usize, w: &mut [[f32; 2]]) -> f64 {
        image(isa, self, r.as_flattened(), first, w)
    }
}

multiversioned! {
    fn image[][](compact: &Compact, r: &[f32], first: usize, w: &mut [[f32; 2]]) -> f64 => image_body
}

/// Without fused multiply-adds: the same bits by every path.
#[inline(always)]
fn image_body<const FMA: bool>(compact: &Compact, r: &[f32], first: usize, w: &mut [[f32; 2]]) -> f64 {
    let margin = compact.places.margin;
    let mut sum = [0.0f64; LANES];
    // Sums of some groups first: what crosses over where it is made, the compiler would shuffle every slot for.
    let mut sums = [[[0.0; LANES]; 2]; TOGETHER];
    for (w, first) in w.chunks_mut(TOGETHER * SIDE).zip((first..).step_by(TOGETHER * SIDE)) {
        let n_groups = w.len().div_ceil(SIDE);
        for (sums, group) in sums[..n_groups].iter_mut().zip(first / SIDE..) {
            *sums = compact.sums_of(group, r);
        }
        let mut of_some = [0.0; LANES];
        for (k, (w, [to_same, to_other])) in w.chunks_mut(SIDE).zip(&sums).enumerate() {
            let own = lanes_at(r, margin + first + k * SIDE);
            let mut of_nodes = [0.0; LANES];
            for l in 0..LANES {
                of_nodes[l] = own[l] + (to_same[l] + to_other[l ^ 1]) * (1.0 / ONE);
                of_some[l] += own[l] * of_nodes[l];
            }
            let w = w.as_flattened_mut();
            match w.first_chunk_mut() {
                Some(w) => *w = of_nodes,
                None => w.copy_from_slice(&of_nodes[..w.len()]),
            }
        }
        for l in 0..LANES {
            sum[l] += f64::from(of_some[l]);
        }
    }
    sum.iter().sum()
}

impl Compact {
    /// What a group's neighbours come to, in parts of [`ONE`]: from each component to the same one, and to the other.
    #[inline(always)]
    fn sums_of(&self, group: usize, r: &[f32]) -> [[f32; LANES]; 2] {
        let (margin, slots) = (self.places.margin, &self.slots[self.places.slots(group..group + 1)]);
        let (neighbours, by_distance) = self.places.neighbours(group);
        let (mut to_same, mut to_other) = ([0.0; LANES], [0.0; LANES]);
        if by_distance {
            for (slot, distance) in slots.iter().zip(neighbours) {
                add(
                    &mut to_same,
                    &mut to_other,
                    slot,
                    lanes_at(r, (margin + group * SIDE).wrapping_add_signed(*distance as isize)),
                );
            }
        } else {
            for (slot, nodes) in slots.iter().zip(neighbours.chunks_exact(SIDE)) {
                let mut lanes = [0.0; LANES];
                for (lanes, node) in lanes.chunks_exact_mut(2).zip(nodes) {
                    lanes.copy_from_slice(&r[2 * (margin + *node as usize)..][..2]);
                }
                add(&mut to_same, &mut to_other, slot, &lanes);
            }
        }
        [to_same, to_other]
    }
}

#[inline(always)]
fn add(to_same: &mut [f32; LANES], to_other: &mut [f32; LANES], slot: &Slot, lanes: &[f32; LANES]) {
    for l in 0..LANES {
        to_same[l] += f32::from(slot.straight[l]) * lanes[l];
    }
    for l in 0..LANES {
        to_other[l] += f32::from(slot.crossed[l]) * lanes[l];
    }
}

#[inline(always)]
fn lanes_at(r: &[f32], node: usize) -> &[f32; LANES] {
    r[2 * node..].first_chunk().expect("within the margin")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::{ElementMatrix, upper};

    const SIDES: [usize; 2] = [21, 13];

    fn noise(k: usize) -> f64 {
        f64::from((k as u32).wrapping_mul(2_654_435_769) >> 16) / 32768.0 - 1.0
    }

    /// Elements of a grid with a hole, whose nodes have the numbers that `name` gives them.
    fn elements(name: impl Fn(usize) -> usize) -> Vec<[u32; 4]> {
        let [nx, ny] = SIDES;
        let node = |i: usize, j: usize| name(j * nx + i) as u32;
        (0..(nx - 1) * (ny - 1))
            .map(|e| (e % (nx - 1), e / (nx - 1)))
            .filter(|(i, j)| !((7..9).contains(i) && (4..8).contains(j)))
            .map(|(i, j)| [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)])
            .collect()
    }

    /// Of texture that varies by 20 from element to element, and in the part to the right is all but that of stripes.
    fn element_matrix(element: usize) -> ElementMatrix {
        let mut matrix = [0.0; 36];
        let contrast = 10.0 * (1.05 + noise(element));
        let slant = if element % (SIDES[0] - 1) > 12 { 0.05 } else { 1.0 };
        for k in 0..144 {
            let [xi, eta] = [k % 12, k / 12].map(|at| (at as f64 + 0.5) / 12.0);
            let psi = [(1.0 - xi) * (1.0 - eta), xi * (1.0 - eta), xi * eta, (1.0 - xi) * eta];
            let [p, q] = [0, 1].map(|c| contrast * noise(2 * (144 * element + k) + c));
            let gradient = [p + slant * q, p - slant * q];
            for (row, column) in (0..8).flat_map(|row| (row..8).map(move |column| (row, column))) {
                let of = |at: usize| psi[at / 2] * gradient[at % 2];
                matrix[upper(row, column)] += of(row) * of(column);
            }
        }
        matrix
    }

    fn matrix(name: impl Fn(usize) -> usize) -> BlockMatrix {
        let elements = elements(name);
        let pattern = Arc::new(Pattern::new(SIDES[0] * SIDES[1], &elements));
        let matrices: Vec<ElementMatrix> = (0..elements.len()).map(element_matrix).collect();
        BlockMatrix::assemble(&pattern, &elements, &matrices)
    }

    #[test]
    fn a_matrix_in_16_bits_solves_as_one_of_all_digits_however_its_nodes_are_numbered() {
        let n = SIDES[0] * SIDES[1];
        // Row by row, and without any order.
        let mut names: [Vec<usize>; 2] = [(0..n).collect(), (0..n).collect()];
        names[1].sort_by(|a, b| noise(a * a + 1).total_cmp(&noise(b * b + 1)));
        for (names, by_distance) in names.into_iter().zip([true, false]) {
            let matrix = matrix(|node| names[node]);
            let jacobi = BlockJacobi::new(&matrix);
            let compact = Compact::new(&matrix, &jacobi);
            let of_grid = (0..n / SIDE).filter(|&group| compact.places.neighbours(group).1).count();
            assert_eq!(of_grid, if by_distance { n / SIDE } else { 0 });
            // The nodes in the hole have no element, and no load.
            let has_element = |node: usize| matrix.diagonal(node)[0] > 0.0;
            let load = |node: usize, c: usize| if has_element(node) { noise(2 * node + c + 7) as f32 } else { 0.0 };
            let rhs: Vec<[f32; 2]> = (0..n).map(|node| [load(node, 0), load(node, 1)]).collect();
            let wide: Vec<[f64; 2]> = rhs.iter().map(|b| b.map(f64::from)).collect();
            let (want, _) = jacobi.solve(&matrix, &wide, 1e-12, 1000);
            let got = compact.solve(&rhs, 1e-5, 200);
            // In the norm of the matrix, scaled, whose eigenvalues are a tenth and more: 16 entries of a row are off by
            // 1.5e-5 at most, not all to one side.
            let apart: Vec<[f64; 2]> =
                want.iter().zip(&got).map(|(a, b)| [a[0] - f64::from(b[0]), a[1] - f64::from(b[1])]).collect();
            let energy = |x: &[[f64; 2]]| {
                x.iter().zip(matrix.multiply(x)).map(|(x, ax)| x[0] * ax[0] + x[1] * ax[1]).sum::<f64>().sqrt()
            };
            let off = energy(&apart) / energy(&want);
            assert!(off < 2e-4, "{off:.1e}");
        }
    }

    #[test]
    fn what_follows_a_matrix_is_what_is_made_of_it_anew() {
        let before = matrix(|node| node);
        let elements = elements(|node| node);
        // Some side by side, others not.
        let changed: Vec<u32> = (0..SIDES[0] * SIDES[1]).filter(|node| node % 11 < 3).map(|node| node as u32).collect();
        let mut after = before.clone();
        let halved: Vec<ElementMatrix> = (0..elements.len()).map(|e| element_matrix(e).map(|v| 0.25 * v)).collect();
        after.assemble_rows(&changed, &elements, |element| &halved[element as usize]);
        let jacobi = BlockJacobi::new(&after);
        let anew = Compact::new(&after, &jacobi);
        let mut compact = Compact::new(&before, &BlockJacobi::new(&before));
        assert_ne!(compact.slots, anew.slots);
        compact.follow(&after, &jacobi, &changed);
        assert_eq!((compact.slots, compact.roots), (anew.slots, anew.roots));
    }
}
