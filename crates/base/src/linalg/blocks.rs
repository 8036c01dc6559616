//! Sparse symmetric matrices of 2x2 blocks, one row of blocks per node.

use crate::parts;
use rayon::prelude::*;
use std::borrow::Borrow;
use std::ops::{Add, Mul, Range};
use std::sync::Arc;

/// The 8x8 symmetric matrix of a Q4 element, upper triangle by rows; unknown `2 k + c`: component `c` of node `k`.
pub type ElementMatrix = [f64; 36];

/// `factor` times the matrix of the products of corners, for both components alike.
pub fn alike(products: [[f64; 4]; 4], factor: f64) -> ElementMatrix {
    let mut matrix = [0.0; 36];
    for (i, row) in products.iter().enumerate() {
        for (j, product) in row.iter().enumerate().skip(i) {
            (0..2).for_each(|c| matrix[upper(2 * i + c, 2 * j + c)] = factor * product);
        }
    }
    matrix
}

/// Place of entry (row, col), in either order, in an [`ElementMatrix`].
pub fn upper(row: usize, col: usize) -> usize {
    let (r, c) = if row <= col { (row, col) } else { (col, row) };
    r * 8 - r * (r + 1) / 2 + c
}

/// Values by their keys below `n`, in order: where those of each key begin, one more entry at the end, and the values.
pub(crate) fn by_key<T: Copy + Default>(n: usize, pairs: impl Iterator<Item = (u32, T)> + Clone) -> (Vec<u32>, Vec<T>) {
    let mut starts = vec![0u32; n + 1];
    pairs.clone().for_each(|(key, _)| starts[key as usize + 1] += 1);
    for key in 0..n {
        starts[key + 1] += starts[key];
    }
    let mut next = starts.clone();
    let mut values = vec![T::default(); starts[n] as usize];
    for (key, value) in pairs {
        values[next[key as usize] as usize] = value;
        next[key as usize] += 1;
    }
    (starts, values)
}

/// Rows of numbers, each once and ascending, of what `fill` puts into an empty list: where they begin, with one more
/// entry that closes the last, and all of them; `usual` is a length that most rows have.
pub(super) fn ascending_rows(n: usize, usual: usize, fill: impl Fn(usize, &mut Vec<u32>)) -> (Vec<u32>, Vec<u32>) {
    let (mut starts, mut all) = (Vec::with_capacity(n + 1), Vec::with_capacity(n * usual));
    starts.push(0);
    let mut row = Vec::new();
    for k in 0..n {
        row.clear();
        fill(k, &mut row);
        row.sort_unstable();
        row.dedup();
        all.extend_from_slice(&row);
        starts.push(all.len() as u32);
    }
    (starts, all)
}

/// Which blocks of a matrix are filled: nodes coupled by an element.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    /// Per node, where its row of blocks starts in `columns`; one more entry closes the last.
    row_starts: Vec<u32>,
    /// Column (node) of each block, ascending within a row.
    columns: Vec<u32>,
    /// Per node, where its elements start in `incidence`.
    incidence_starts: Vec<u32>,
    /// Element and the node's corner (0..4) in it, ascending by element.
    incidence: Vec<(u32, u8)>,
}

impl Pattern {
    /// The pattern of `n_nodes` nodes joined by four-node elements.
    ///
    /// # Panics
    /// When an element names a node that does not exist.
    pub fn new(n_nodes: usize, elements: &[[u32; 4]]) -> Self {
        let corners = elements.iter().zip(0..).flat_map(|(corners, element)| {
            corners.iter().zip(0..).map(move |(&node, corner)| (node, (element, corner)))
        });
        let (incidence_starts, incidence) = by_key(n_nodes, corners);
        let (row_starts, columns) = ascending_rows(n_nodes, 9, |node, row| {
            row.push(node as u32);
            for &(element, _) in &incidence[incidence_starts[node] as usize..incidence_starts[node + 1] as usize] {
                row.extend_from_slice(&elements[element as usize]);
            }
        });
        Self { row_starts, columns, incidence_starts, incidence }
    }

    /// The pattern whose rows have blocks in these ascending columns, each with its own among them; no elements.
    pub(super) fn of_rows(rows: &[Vec<u32>]) -> Self {
        let mut row_starts = vec![0];
        for row in rows {
            row_starts.push(row_starts[row_starts.len() - 1] + row.len() as u32);
        }
        Self { row_starts, columns: rows.concat(), incidence_starts: vec![0; rows.len() + 1], incidence: Vec::new() }
    }

    /// The pattern that couples neighbours of neighbours too, as `K^T K` of a matrix `K` on this; the same elements.
    pub fn widened(&self) -> Self {
        let (row_starts, columns) = ascending_rows(self.n_nodes(), 25, |node, row| {
            for &near in self.neighbours(node) {
                row.extend_from_slice(self.neighbours(near as usize));
            }
        });
        Self { row_starts, columns, incidence_starts: self.incidence_starts.clone(), incidence: self.incidence.clone() }
    }

    /// Number of nodes (rows of blocks).
    pub fn n_nodes(&self) -> usize {
        self.row_starts.len() - 1
    }

    /// Number of stored blocks.
    pub fn n_blocks(&self) -> usize {
        self.columns.len()
    }

    /// Places of the row of `node` among [`columns`](Self::columns).
    pub fn row(&self, node: usize) -> std::ops::Range<usize> {
        self.row_starts[node] as usize..self.row_starts[node + 1] as usize
    }

    /// Columns of all blocks, row by row.
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// The nodes that `node` is coupled with, itself among them, ascending.
    pub fn neighbours(&self, node: usize) -> &[u32] {
        &self.columns[self.row(node)]
    }

    /// Place of a block; panics when the pattern has none.
    fn place(&self, row: usize, column: u32) -> usize {
        match self.neighbours(row).binary_search(&column) {
            Ok(at) => self.row(row).start + at,
            Err(_) => panic!("the pattern does not couple the nodes {row} and {column}"),
        }
    }

    /// The nodes that are at most `steps` steps along couplings away from any of `nodes`, ascending.
    pub fn around(&self, nodes: &[u32], steps: usize) -> Vec<u32> {
        let mut is_in = vec![false; self.n_nodes()];
        nodes.iter().for_each(|&node| is_in[node as usize] = true);
        let (mut all, mut ring) = (nodes.to_vec(), nodes.to_vec());
        for _ in 0..steps {
            let mut next = Vec::new();
            for &node in &ring {
                for &other in self.neighbours(node as usize) {
                    if !std::mem::replace(&mut is_in[other as usize], true) {
                        next.push(other);
                    }
                }
            }
            all.extend_from_slice(&next);
            ring = next;
        }
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The elements of any of `nodes`, ascending.
    pub fn elements_around(&self, nodes: &[u32]) -> Vec<u32> {
        let of_node = |&node: &u32| self.elements_of(node as usize).iter().map(|&(element, _)| element);
        let mut elements: Vec<u32> = nodes.iter().flat_map(of_node).collect();
        elements.sort_unstable();
        elements.dedup();
        elements
    }

    /// The elements of a node, with the node's corner in each.
    pub fn elements_of(&self, node: usize) -> &[(u32, u8)] {
        &self.incidence[self.incidence_starts[node] as usize..self.incidence_starts[node + 1] as usize]
    }

    /// The diagonal block `[xx, xy, yy]` of `node`; `entry` is that of an element at a place of its [`ElementMatrix`].
    pub fn diagonal_block(&self, elements: &[[u32; 4]], node: usize, entry: impl Fn(u32, usize) -> f64) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for &(element, corner) in self.elements_of(node) {
            // A triangle has two corners at one of its nodes.
            let same = (0..4).filter(|&other| elements[element as usize][other] as usize == node);
            for (a, b) in same.map(|other| (2 * corner as usize, 2 * other)) {
                let places = [upper(a, b), upper(a, b + 1), upper(a + 1, b + 1)];
                sum.iter_mut().zip(places).for_each(|(sum, at)| *sum += entry(element, at));
            }
        }
        sum
    }

    /// Colours of the nodes in `nodes`, two of one colour at least `steps` apart: each gets the first that is free.
    pub fn colours(&self, nodes: Range<usize>, steps: usize) -> Vec<u32> {
        const NONE: u32 = u32::MAX;
        let first = nodes.start;
        let mut colour = vec![NONE; nodes.len()];
        // The node that saw another node, or a colour, last.
        let (mut seen, mut taken) = (vec![usize::MAX; nodes.len()], Vec::new());
        let (mut ring, mut next) = (Vec::new(), Vec::new());
        for node in nodes.clone() {
            ring.clear();
            ring.push(node);
            seen[node - first] = node;
            for _ in 1..steps {
                for &at in &ring {
                    for &other in self.neighbours(at) {
                        let other = other as usize;
                        if nodes.contains(&other) && seen[other - first] != node {
                            seen[other - first] = node;
                            next.push(other);
                            if colour[other - first] != NONE {
                                taken[colour[other - first] as usize] = node;
                            }
                        }
                    }
                }
                std::mem::swap(&mut ring, &mut next);
                next.clear();
            }
            let free = taken.iter().position(|&by| by != node).unwrap_or(taken.len());
            if free == taken.len() {
                taken.push(node);
            }
            colour[node - first] = free as u32;
        }
        colour
    }

    /// Sums element vectors (unknown `2 k + c` of corner `k`) into nodal ones, in element order.
    pub fn gather(&self, element_vector: impl Fn(usize) -> [f64; 8] + Sync) -> Vec<[f64; 2]> {
        self.gather_corners(|element, corner| {
            let vector = element_vector(element);
            [vector[2 * corner], vector[2 * corner + 1]]
        })
    }

    /// As [`Pattern::gather`], from the part of each corner of an element.
    pub fn gather_corners(&self, of_corner: impl Fn(usize, usize) -> [f64; 2] + Sync) -> Vec<[f64; 2]> {
        parts::map(self.n_nodes(), 2048, [0.0; 2], |node| {
            let mut sum = [0.0; 2];
            for &(element, corner) in self.elements_of(node) {
                let [x, y] = of_corner(element as usize, corner as usize);
                sum = [sum[0] + x, sum[1] + y];
            }
            sum
        })
    }
}

/// Rows that are worth to ask another thread for.
pub(super) const ROWS_OF_A_PART: usize = 64;

/// Ranges of `all`, one after the other, each for itself.
pub(super) fn ranges_mut<T>(all: &mut [T], ranges: impl Iterator<Item = Range<usize>>) -> Vec<&mut [T]> {
    let (mut rest, mut at) = (all, 0);
    ranges
        .map(|range| {
            let (_, from) = std::mem::take(&mut rest).split_at_mut(range.start - at);
            let (own, after) = from.split_at_mut(range.len());
            (rest, at) = (after, range.end);
            own
        })
        .collect()
}

/// Adds the part of each element of a node to its row of blocks, in element order.
fn add_row<M: Borrow<ElementMatrix>>(
    pattern: &Pattern,
    elements: &[[u32; 4]],
    matrix: impl Fn(u32) -> M,
    node: usize,
    row: &mut [[f64; 4]],
) {
    let columns = &pattern.columns[pattern.row(node)];
    for &(element, corner) in pattern.elements_of(node) {
        let matrix = matrix(element);
        let matrix = matrix.borrow();
        let a = 2 * corner as usize;
        for (b, other) in elements[element as usize].iter().enumerate() {
            // A row has at most nine blocks: looking is faster than an index table in memory.
            let Some(at) = columns.iter().position(|c| c == other) else { continue };
            let b = 2 * b;
            row[at][0] += matrix[upper(a, b)];
            row[at][1] += matrix[upper(a, b + 1)];
            row[at][2] += matrix[upper(a + 1, b)];
            row[at][3] += matrix[upper(a + 1, b + 1)];
        }
    }
}

/// A symmetric matrix on a [`Pattern`]; both triangles are stored. A block is `[xx, xy, yx, yy]`.
#[derive(Debug, Clone)]
pub struct BlockMatrix {
    pattern: Arc<Pattern>,
    blocks: Vec<[f64; 4]>,
    /// Nodes whose unknowns stay zero.
    held: Vec<u32>,
}

impl BlockMatrix {
    /// Assembles the element matrices of the pattern's `elements`, in element order: the same bits for any threads.
    pub fn assemble(pattern: &Arc<Pattern>, elements: &[[u32; 4]], matrices: &[ElementMatrix]) -> Self {
        Self::assemble_by(pattern, elements, |element| &matrices[element as usize])
    }

    /// The same of matrices that are made where they are asked for: once for each node of an element.
    pub fn assemble_by<M: Borrow<ElementMatrix>>(
        pattern: &Arc<Pattern>,
        elements: &[[u32; 4]],
        matrix: impl Fn(u32) -> M + Sync,
    ) -> Self {
        let mut blocks = vec![[0.0; 4]; pattern.n_blocks()];
        let rows = ranges_mut(&mut blocks, (0..pattern.n_nodes()).map(|node| pattern.row(node)));
        rows.into_par_iter().with_min_len(512).enumerate().for_each(|(node, row)| {
            // Memory that is fresh from the kernel, read before it is written, would be mapped twice.
            row.fill([0.0; 4]);
            add_row(pattern, elements, &matrix, node, row);
        });
        Self { pattern: pattern.clone(), blocks, held: Vec::new() }
    }

    /// Assembles the rows of `nodes` anew, bit for bit as [`BlockMatrix::assemble`] and [`BlockMatrix::hold`] would:
    /// for a matrix of which some elements have changed, and `nodes`, ascending, all of theirs.
    pub fn assemble_rows<M: Borrow<ElementMatrix>>(
        &mut self,
        nodes: &[u32],
        elements: &[[u32; 4]],
        matrix: impl Fn(u32) -> M + Sync,
    ) {
        let Self { pattern, blocks, held } = self;
        let is_held = |node: u32| held.binary_search(&node).is_ok();
        let assembled = |node: u32, row: &mut [[f64; 4]]| {
            row.fill([0.0; 4]);
            add_row(pattern, elements, &matrix, node as usize, row);
            if held.is_empty() {
                return;
            }
            for (block, &column) in row.iter_mut().zip(&pattern.columns[pattern.row(node as usize)]) {
                if is_held(node) || is_held(column) {
                    *block = if node == column { [1.0, 0.0, 0.0, 1.0] } else { [0.0; 4] };
                }
            }
        };
        let mut rows = ranges_mut(blocks, nodes.iter().map(|&node| pattern.row(node as usize)));
        let some = nodes.chunks(ROWS_OF_A_PART).zip(rows.chunks_mut(ROWS_OF_A_PART)).collect();
        parts::for_each(some, |(nodes, rows): (&[u32], &mut [&mut [[f64; 4]]])| {
            nodes.iter().zip(rows).for_each(|(&node, row)| assembled(node, row));
        });
    }

    /// Takes the rows of `nodes` from a matrix on the same pattern.
    pub(super) fn copy_rows(&mut self, from: &Self, nodes: &[u32]) {
        for row in nodes.iter().map(|&node| self.pattern.row(node as usize)) {
            self.blocks[row.clone()].copy_from_slice(&from.blocks[row]);
        }
    }

    /// The rows and columns of `nodes`, ascending, alone: as if all others were held. It has no elements.
    pub fn part(&self, nodes: &[u32]) -> Self {
        let mut part = Self::part_of(&self.pattern, nodes, |node, row| {
            row.extend_from_slice(&self.blocks[self.pattern.row(node)]);
        });
        let own = |node: &u32| nodes.binary_search(node).ok().map(|at| at as u32);
        part.held = self.held.iter().filter_map(own).collect();
        part
    }

    /// That part of the assembled matrix, from the matrices of the elements of `nodes`.
    pub fn assemble_part<'a>(
        pattern: &Pattern,
        nodes: &[u32],
        elements: &[[u32; 4]],
        matrix: impl Fn(u32) -> &'a ElementMatrix,
    ) -> Self {
        Self::part_of(pattern, nodes, |node, row| {
            row.resize(pattern.row(node).len(), [0.0; 4]);
            add_row(pattern, elements, &matrix, node, row);
        })
    }

    /// The part of a matrix whose rows are what `whole_row` puts into an empty list.
    fn part_of(pattern: &Pattern, nodes: &[u32], whole_row: impl Fn(usize, &mut Vec<[f64; 4]>)) -> Self {
        let mut number = vec![u32::MAX; pattern.n_nodes()];
        (0..).zip(nodes).for_each(|(at, &node)| number[node as usize] = at);
        let (mut row_starts, mut columns, mut blocks) = (vec![0], Vec::new(), Vec::new());
        let mut row = Vec::with_capacity(16);
        for &node in nodes {
            row.clear();
            whole_row(node as usize, &mut row);
            for (block, &column) in row.iter().zip(pattern.neighbours(node as usize)) {
                let own = number[column as usize];
                if own != u32::MAX {
                    columns.push(own);
                    blocks.push(*block);
                }
            }
            row_starts.push(columns.len() as u32);
        }
        let incidence_starts = vec![0; row_starts.len()];
        let pattern = Arc::new(Pattern { row_starts, columns, incidence_starts, incidence: Vec::new() });
        Self { pattern, blocks, held: Vec::new() }
    }

    /// The matrix of these blocks, row by row of the pattern; `None` where they are not as many.
    pub fn of_blocks(pattern: &Arc<Pattern>, blocks: Vec<[f64; 4]>) -> Option<Self> {
        (blocks.len() == pattern.n_blocks()).then(|| Self { pattern: pattern.clone(), blocks, held: Vec::new() })
    }

    /// The zero matrix.
    pub fn zero(pattern: &Arc<Pattern>) -> Self {
        Self { pattern: pattern.clone(), blocks: vec![[0.0; 4]; pattern.n_blocks()], held: Vec::new() }
    }

    /// Adds `weight B^T B`, where the two rows of `B` hold `blocks` at `nodes` and nothing elsewhere: a
    /// penalty on two linear combinations of unknowns.
    ///
    /// # Panics
    /// When the pattern has no place for a pair of these nodes.
    pub fn add_square(&mut self, nodes: &[u32], blocks: &[[f64; 4]], weight: f64) {
        for (&row, a) in nodes.iter().zip(blocks) {
            for (&column, b) in nodes.iter().zip(blocks) {
                let sum = &mut self.blocks[self.pattern.place(row as usize, column)];
                sum[0] += weight * (a[0] * b[0] + a[2] * b[2]);
                sum[1] += weight * (a[0] * b[1] + a[2] * b[3]);
                sum[2] += weight * (a[1] * b[0] + a[3] * b[2]);
                sum[3] += weight * (a[1] * b[1] + a[3] * b[3]);
            }
        }
    }

    pub(super) fn from_blocks(pattern: &Arc<Pattern>, block: impl Fn(usize, usize) -> [f64; 4]) -> Self {
        let rows = 0..pattern.n_nodes();
        let places = rows.flat_map(|row| pattern.neighbours(row).iter().map(move |&column| (row, column as usize)));
        let blocks = places.map(|(row, column)| block(row, column)).collect();
        Self { pattern: pattern.clone(), blocks, held: Vec::new() }
    }

    pub(super) fn of_rows(pattern: &Arc<Pattern>, rows: &[Vec<[f64; 4]>]) -> Self {
        Self { pattern: pattern.clone(), blocks: rows.concat(), held: Vec::new() }
    }

    /// Adds `scale` times a matrix of the same nodes whose pattern lies within that of `self`.
    ///
    /// # Panics
    /// When it does not.
    pub fn add(&mut self, other: &Self, scale: f64) {
        for node in 0..other.pattern.n_nodes() {
            for (block, &column) in other.blocks[other.pattern.row(node)].iter().zip(other.pattern.neighbours(node)) {
                for (sum, value) in self.blocks[self.pattern.place(node, column)].iter_mut().zip(block) {
                    *sum += scale * value;
                }
            }
        }
    }

    /// The pattern.
    pub fn pattern(&self) -> &Arc<Pattern> {
        &self.pattern
    }

    /// All blocks, row after row.
    pub fn blocks(&self) -> &[[f64; 4]] {
        &self.blocks
    }

    /// The block on the diagonal at `node`, as `[xx, xy, yy]`.
    pub fn diagonal(&self, node: usize) -> [f64; 3] {
        let range = self.pattern.row(node);
        let at = self.pattern.columns[range.clone()].iter().position(|&c| c as usize == node).unwrap_or(0);
        let [xx, xy, _, yy] = self.blocks[range.start + at];
        [xx, xy, yy]
    }

    /// Replaces the rows and columns of the nodes where `keep` is false by those of the identity: their
    /// unknowns stay zero (a solver takes no right-hand side there) and couple to nothing.
    pub fn hold(&mut self, keep: &[bool]) {
        self.held = (0..).zip(keep).filter(|(_, keep)| !**keep).map(|(node, _)| node).collect();
        for node in 0..self.pattern.n_nodes() {
            for at in self.pattern.row(node) {
                let other = self.pattern.columns[at] as usize;
                if !(keep[node] && keep[other]) {
                    self.blocks[at] = if node == other { [1.0, 0.0, 0.0, 1.0] } else { [0.0; 4] };
                }
            }
        }
    }

    /// The nodes whose unknowns stay zero.
    pub fn held(&self) -> &[u32] {
        &self.held
    }

    /// `self * x`.
    pub fn multiply(&self, x: &[[f64; 2]]) -> Vec<[f64; 2]> {
        (0..self.pattern.n_nodes()).map(|node| self.row_times(node, x)).collect()
    }

    /// The row of `node` times `x`.
    #[inline(always)]
    pub fn row_times(&self, node: usize, x: &[[f64; 2]]) -> [f64; 2] {
        let [xx, xy, yx, yy] = row_sums(&self.pattern, &self.blocks, node, x);
        [xx + xy, yx + yy]
    }
}

/// The row of `node` times `x`, entry by entry of `blocks`: the parts of both components of `x` are not added yet.
#[inline(always)]
pub(super) fn row_sums<T: Copy + Default + Add<Output = T> + Mul<Output = T>>(
    pattern: &Pattern,
    blocks: &[[T; 4]],
    node: usize,
    x: &[[T; 2]],
) -> [T; 4] {
    let range = pattern.row(node);
    let mut sum = [T::default(); 4];
    for (block, &column) in blocks[range.clone()].iter().zip(&pattern.columns[range]) {
        let [x, y] = x[column as usize];
        for (k, v) in [x, y, x, y].into_iter().enumerate() {
            sum[k] = sum[k] + block[k] * v;
        }
    }
    sum
}
