//! Sparse LU by nested dissection and dense fronts, for large meshes in the plane.
//!
//! The unknowns are cut in two halves by a thin set of separators, recursively (George 1973); each separator with the
//! unknowns around it makes a dense front (multifrontal method, Duff and Reid 1983). Rows are exchanged within the
//! unknowns that a front eliminates, and only where a pivot is small: a tangent that is positive definite but for a
//! softening interface hardly needs it. The pattern must be symmetric, the values need not be.

use super::dissection::halve;
use super::pivots::{PivotSigns, Singular};
use super::sparse::{SparseMatrix, SparsePattern};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_unit_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};
use std::sync::Arc;

/// Sets of at most this many unknowns are not cut further.
const LEAF: usize = 48;

/// A pivot below this share of the largest entry that could take its place is exchanged.
const PIVOT_SHARE: f64 = 0.1;

/// One front: what it eliminates, and what it is coupled with that is eliminated later.
#[derive(Debug)]
struct Front {
    own: Vec<u32>,
    border: Vec<u32>,
    /// Number of the front that takes what this one leaves.
    parent: Option<usize>,
    /// Place of each border unknown among the unknowns (own, then border) of the parent; ascending.
    lift: Vec<u32>,
    /// Entries of the matrix: place among its values, place in this front's part of the factor.
    entries: Vec<(u32, u32)>,
    /// Where this front's part of the factor begins: own block, right block, lower block, by columns.
    start: usize,
}

impl Front {
    fn size(&self) -> usize {
        self.own.len() * (self.own.len() + 2 * self.border.len())
    }
}

/// The fronts of a pattern, children before parents.
#[derive(Debug)]
pub(super) struct Fronts {
    n: usize,
    fronts: Vec<Front>,
    n_values: usize,
}

impl Fronts {
    pub(super) fn new(pattern: &SparsePattern, points: &[[f64; 2]]) -> Self {
        let n = pattern.n();
        let mut sets = Vec::new();
        cut((0..n as u32).collect(), pattern, points, &mut vec![false; n], &mut sets);
        let mut place = vec![0u32; n];
        sets.iter().flatten().zip(0u32..).for_each(|(&k, at)| place[k as usize] = at);
        let mut fronts: Vec<Front> = Vec::with_capacity(sets.len());
        let mut children: Vec<Vec<usize>> = vec![Vec::new(); sets.len()];
        let mut front_of = vec![0u32; n];
        for (number, set) in sets.iter().enumerate() {
            set.iter().for_each(|&k| front_of[k as usize] = number as u32);
        }
        let (mut start, mut first) = (0, 0u32);
        // Place of an unknown among those of the front at hand.
        let mut local = vec![u32::MAX; n];
        for (number, own) in sets.into_iter().enumerate() {
            let last = first + own.len() as u32;
            let neighbours = own.iter().flat_map(|&k| pattern.column(k as usize)).copied();
            let passed_on = children[number].iter().flat_map(|&child| fronts[child].border.iter().copied());
            let mut border: Vec<u32> = neighbours.chain(passed_on).filter(|&k| place[k as usize] >= last).collect();
            border.sort_unstable_by_key(|&k| place[k as usize]);
            border.dedup();
            let (k, b) = (own.len(), border.len());
            own.iter().chain(&border).zip(0u32..).for_each(|(&unknown, at)| local[unknown as usize] = at);
            for &child in &children[number] {
                fronts[child].lift = fronts[child].border.iter().map(|&unknown| local[unknown as usize]).collect();
            }
            let mut entries = Vec::new();
            for (j, &column) in own.iter().enumerate() {
                let range = pattern.range(column as usize);
                for (&row, at) in pattern.column(column as usize).iter().zip(range) {
                    if place[row as usize] < first {
                        continue; // eliminated before
                    }
                    let i = local[row as usize] as usize;
                    if i < k {
                        entries.push((at as u32, (j * k + i) as u32));
                    } else {
                        entries.push((at as u32, (k * k + k * b + j * b + i - k) as u32));
                        let mirrored = pattern.place(column as usize, row as usize);
                        let mirrored = mirrored.expect("a symmetric pattern");
                        entries.push((mirrored as u32, (k * k + (i - k) * k + j) as u32));
                    }
                }
            }
            // The parent eliminates the first of what is left.
            let parent = border.first().map(|&unknown| front_of[unknown as usize] as usize);
            if let Some(parent) = parent {
                children[parent].push(number);
            }
            let front = Front { own, border, parent, lift: Vec::new(), entries, start };
            start += front.size();
            first = last;
            fronts.push(front);
        }
        Self { n, fronts, n_values: start }
    }

    pub(super) fn n_values(&self) -> usize {
        self.n_values
    }
}

/// Adds what each front eliminates to `sets`.
fn cut(set: Vec<u32>, pattern: &SparsePattern, points: &[[f64; 2]], is_upper: &mut [bool], sets: &mut Vec<Vec<u32>>) {
    if set.len() <= LEAF {
        sets.extend((!set.is_empty()).then_some(set));
        return;
    }
    let [lower, upper, separator] = halve(set, points, is_upper, |k| pattern.column(k as usize));
    cut(lower, pattern, points, is_upper, sets);
    cut(upper, pattern, points, is_upper, sets);
    sets.extend((!separator.is_empty()).then_some(separator));
}

#[derive(Debug)]
pub(super) struct NestedLu {
    fronts: Arc<Fronts>,
    values: Vec<f64>,
    /// Per eliminated unknown, front by front: the row exchanged with it, within the front.
    exchanged: Vec<u32>,
    signs: PivotSigns,
    ready: bool,
}

impl NestedLu {
    pub(super) fn new(fronts: &Arc<Fronts>) -> Self {
        let signs = PivotSigns { negative: 0, exchanged: 0 };
        let (values, exchanged) = (vec![0.0; fronts.n_values], vec![0; fronts.n]);
        Self { fronts: fronts.clone(), values, exchanged, signs, ready: false }
    }

    pub(super) fn pivots(&self) -> PivotSigns {
        self.signs
    }

    pub(super) fn factor(&mut self, matrix: &SparseMatrix) -> Result<(), Singular> {
        self.ready = false;
        self.signs = PivotSigns { negative: 0, exchanged: 0 };
        self.values.fill(0.0);
        // What each front leaves to its parent, until that takes it.
        let mut left: Vec<Vec<f64>> = vec![Vec::new(); self.fronts.fronts.len()];
        let mut children: Vec<Vec<usize>> = vec![Vec::new(); left.len()];
        let mut first = 0;
        for (number, front) in self.fronts.fronts.iter().enumerate() {
            let (k, b) = (front.own.len(), front.border.len());
            let part = &mut self.values[front.start..front.start + front.size()];
            for &(at, to) in &front.entries {
                part[to as usize] += matrix.values()[at as usize];
            }
            let (own, rest) = part.split_at_mut(k * k);
            let (right, below) = rest.split_at_mut(k * b);
            let mut schur = vec![0.0; b * b];
            for child in std::mem::take(&mut children[number]) {
                let lift = &self.fronts.fronts[child].lift;
                let given = std::mem::take(&mut left[child]);
                // Ascending: the first of them are eliminated here.
                let here = lift.partition_point(|&at| (at as usize) < k);
                for (column, &to) in given.chunks_exact(lift.len()).zip(lift) {
                    let to = to as usize;
                    let (upper, lower) = match to < k {
                        true => (&mut own[to * k..(to + 1) * k], &mut below[to * b..(to + 1) * b]),
                        false => {
                            (&mut right[(to - k) * k..(to - k + 1) * k], &mut schur[(to - k) * b..(to - k + 1) * b])
                        }
                    };
                    for (value, &at) in column[..here].iter().zip(lift) {
                        upper[at as usize] += value;
                    }
                    for (value, &at) in column[here..].iter().zip(&lift[here..]) {
                        lower[at as usize - k] += value;
                    }
                }
            }
            let exchanged = &mut self.exchanged[first..first + k];
            first += k;
            let signs = eliminate(own, right, exchanged).map_err(|at| Singular { unknown: front.own[at] as usize })?;
            self.signs.negative += signs.negative;
            self.signs.exchanged += signs.exchanged;
            if b > 0 {
                let own = MatRef::from_column_major_slice(own, k, k);
                let mut right = MatMut::from_column_major_slice_mut(right, k, b);
                let mut below = MatMut::from_column_major_slice_mut(below, b, k);
                solve_unit_lower_triangular_in_place(own, right.rb_mut(), Par::Seq);
                solve_lower_triangular_in_place(own.transpose(), below.rb_mut().transpose_mut(), Par::Seq);
                let mut schur_part = MatMut::from_column_major_slice_mut(&mut schur, b, b);
                matmul(schur_part.rb_mut(), Accum::Add, below.rb(), right.rb(), -1.0, Par::Seq);
            }
            if let Some(parent) = front.parent {
                left[number] = schur;
                children[parent].push(number);
            }
        }
        self.ready = true;
        Ok(())
    }

    pub(super) fn solve(&self, rhs: &mut [f64]) {
        assert!(self.ready, "a factor was made");
        let n = self.fronts.n;
        assert_eq!(rhs.len() % n, 0, "the length of the right-hand sides");
        let columns = rhs.len() / n;
        let (mut own_rhs, mut border_rhs) = (Vec::new(), Vec::new());
        let mut first = 0;
        for front in &self.fronts.fronts {
            let (k, b) = (front.own.len(), front.border.len());
            let part = &self.values[front.start..front.start + front.size()];
            gather(rhs, n, &front.own, &mut own_rhs);
            for column in own_rhs.chunks_exact_mut(k) {
                for (row, &with) in self.exchanged[first..first + k].iter().enumerate() {
                    column.swap(row, with as usize);
                }
            }
            first += k;
            let own = MatRef::from_column_major_slice(&part[..k * k], k, k);
            let mut y = MatMut::from_column_major_slice_mut(&mut own_rhs, k, columns);
            solve_unit_lower_triangular_in_place(own, y.rb_mut(), Par::Seq);
            if b > 0 {
                border_rhs.clear();
                border_rhs.resize(b * columns, 0.0);
                let below = MatRef::from_column_major_slice(&part[k * k + k * b..], b, k);
                let change = MatMut::from_column_major_slice_mut(&mut border_rhs, b, columns);
                matmul(change, Accum::Replace, below, y.rb(), -1.0, Par::Seq);
                for (column, change) in rhs.chunks_exact_mut(n).zip(border_rhs.chunks_exact(b)) {
                    front.border.iter().zip(change).for_each(|(&unknown, change)| column[unknown as usize] += change);
                }
            }
            scatter(rhs, n, &front.own, &own_rhs);
        }
        for front in self.fronts.fronts.iter().rev() {
            let (k, b) = (front.own.len(), front.border.len());
            let part = &self.values[front.start..front.start + front.size()];
            gather(rhs, n, &front.own, &mut own_rhs);
            let mut x = MatMut::from_column_major_slice_mut(&mut own_rhs, k, columns);
            if b > 0 {
                gather(rhs, n, &front.border, &mut border_rhs);
                let right = MatRef::from_column_major_slice(&part[k * k..k * k + k * b], k, b);
                let known = MatRef::from_column_major_slice(&border_rhs, b, columns);
                matmul(x.rb_mut(), Accum::Add, right, known, -1.0, Par::Seq);
            }
            let own = MatRef::from_column_major_slice(&part[..k * k], k, k);
            solve_upper_triangular_in_place(own, x, Par::Seq);
            scatter(rhs, n, &front.own, &own_rhs);
        }
    }
}

/// The entries of `unknowns` of every column of `n` numbers.
fn gather(rhs: &[f64], n: usize, unknowns: &[u32], into: &mut Vec<f64>) {
    into.clear();
    for column in rhs.chunks_exact(n) {
        into.extend(unknowns.iter().map(|&unknown| column[unknown as usize]));
    }
}

fn scatter(rhs: &mut [f64], n: usize, unknowns: &[u32], from: &[f64]) {
    for (column, values) in rhs.chunks_exact_mut(n).zip(from.chunks_exact(unknowns.len())) {
        unknowns.iter().zip(values).for_each(|(&unknown, value)| column[unknown as usize] = *value);
    }
}

/// Factorises the square `own` by columns and swaps the rows of `right` with it; the column without pivot as error.
fn eliminate(own: &mut [f64], right: &mut [f64], exchanged: &mut [u32]) -> Result<PivotSigns, usize> {
    let k = exchanged.len();
    let mut signs = PivotSigns { negative: 0, exchanged: 0 };
    for s in 0..k {
        let column = &own[s * k..(s + 1) * k];
        let (mut pivot, mut largest) = (s, column[s].abs());
        for (row, value) in column.iter().enumerate().skip(s + 1) {
            if value.abs() > largest {
                (pivot, largest) = (row, value.abs());
            }
        }
        if !(largest > 0.0 && largest.is_finite()) {
            return Err(s);
        }
        if column[s].abs() >= PIVOT_SHARE * largest {
            pivot = s;
        }
        exchanged[s] = pivot as u32;
        if pivot != s {
            signs.exchanged += 1;
            own.chunks_exact_mut(k).chain(right.chunks_exact_mut(k)).for_each(|column| column.swap(s, pivot));
        }
        let (before, after) = own.split_at_mut((s + 1) * k);
        let column = &mut before[s * k..];
        signs.negative += usize::from(column[s] < 0.0);
        let inverse = 1.0 / column[s];
        column[s + 1..].iter_mut().for_each(|value| *value *= inverse);
        for other in after.chunks_exact_mut(k) {
            let factor = other[s];
            if factor != 0.0 {
                other[s + 1..].iter_mut().zip(&column[s + 1..]).for_each(|(value, l)| *value -= factor * l);
            }
        }
    }
    Ok(signs)
}
