//! Cholesky factor of a small sparse matrix, each row kept from its first entry to the diagonal.

use crate::isa::{Isa, multiversioned};

/// The factor `L` of `A = L L^T`.
///
/// What a row of `A` has before its first entry stays zero in `L`, so that an order in which neighbours are near each
/// other keeps it small. Made for some hundred unknowns, solved for many right-hand sides.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::linalg::Envelope;
/// // A chain of three: 2 on the diagonal, 1 beside it.
/// let entries = [(0, 0, 2.0), (1, 0, 1.0), (1, 1, 2.0), (2, 1, 1.0), (2, 2, 2.0)];
/// let mut x = [[3.0, 6.0], [4.0, 8.0], [3.0, 6.0]]; // two right-hand sides
/// Envelope::new(3, &entries).unwrap().solve(&mut x);
/// assert!(x.iter().all(|[a, b]| (a - 1.0).abs() < 1e-14 && (b - 2.0).abs() < 1e-14));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope {
    rows: Vec<Row>,
    /// Of all rows, each from its first column to the one before the diagonal.
    entries: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq)]
struct Row {
    first: usize,
    /// Where its entries begin among those of all rows.
    at: usize,
    /// Of `L`.
    diagonal: f64,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Envelope {
    /// The factor of the symmetric matrix of size `n` with these entries up to the diagonal (row, column, value; what
    /// is there more than once is added up); `None` when it is not positive definite.
    pub fn new(n: usize, of_matrix: &[(usize, usize, f64)]) -> Option<Self> {
        let mut rows: Vec<Row> = (0..n).map(|k| Row { first: k, at: 0, diagonal: 0.0 }).collect();
        for &(row, column, _) in of_matrix {
            rows[row].first = rows[row].first.min(column);
        }
        let mut length = 0;
        for (k, row) in rows.iter_mut().enumerate() {
            row.at = length;
            length += k - row.first;
        }
        let mut entries = vec![0.0; length];
        for &(row, column, value) in of_matrix {
            let Row { first, at, diagonal } = &mut rows[row];
            match column == row {
                true => *diagonal += value,
                false => entries[*at + column - *first] += value,
            }
        }
        for k in 0..n {
            let Row { first, at, diagonal: own } = rows[k];
            let (known, rest) = entries.split_at_mut(at);
            let entries = &mut rest[..k - first];
            for column in first..k {
                let other = &rows[column];
                let from = first.max(other.first);
                let of_other = &known[other.at + from - other.first..other.at + column - other.first];
                let sum = dot(&entries[from - first..column - first], of_other);
                entries[column - first] = (entries[column - first] - sum) / other.diagonal;
            }
            let pivot = own - dot(entries, entries);
            if pivot.is_nan() || pivot <= 1e-12 * own.abs() {
                return None;
            }
            rows[k].diagonal = pivot.sqrt();
        }
        Some(Self { rows, entries })
    }

    /// Replaces each of some right-hand sides `b` beside each other by `A^-1 b`; each has the bits that it has alone.
    ///
    /// # Panics
    /// When `b` has another length.
    pub fn solve<const N: usize>(&self, b: &mut [[f64; N]]) {
        assert_eq!(b.len(), self.rows.len(), "one number for each unknown");
        solve(Isa::detect(), self, b);
    }
}

multiversioned! {
    fn solve[const N: usize][N](envelope: &Envelope, b: &mut [[f64; N]]) => solve_body
}

#[inline(always)]
fn solve_body<const FMA: bool, const N: usize>(envelope: &Envelope, b: &mut [[f64; N]]) {
    let entries = |k: usize, row: &Row| &envelope.entries[row.at..row.at + k - row.first];
    for (k, row) in envelope.rows.iter().enumerate() {
        let (before, own) = b.split_at_mut(k);
        let mut known = [0.0; N];
        for (l, b) in entries(k, row).iter().zip(&before[row.first..]) {
            (0..N).for_each(|c| known[c] += l * b[c]);
        }
        (0..N).for_each(|c| own[0][c] = (own[0][c] - known[c]) / row.diagonal);
    }
    for (k, row) in envelope.rows.iter().enumerate().rev() {
        let (before, own) = b.split_at_mut(k);
        (0..N).for_each(|c| own[0][c] /= row.diagonal);
        for (l, b) in entries(k, row).iter().zip(&mut before[row.first..]) {
            (0..N).for_each(|c| b[c] -= l * own[0][c]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_solution_of_a_matrix_with_gaps_gives_its_right_hand_side_back() {
        // Diagonally dominant, with entries up to five columns away.
        let entry = |i: usize, j: usize| match i.abs_diff(j) {
            0 => 9.0 + i as f64,
            1 | 5 => 1.0 + 0.1 * (i + j) as f64,
            _ => 0.0,
        };
        let n = 23;
        let entries: Vec<(usize, usize, f64)> =
            (0..n).flat_map(|i| (0..=i).map(move |j| (i, j, entry(i, j)))).filter(|(.., v)| *v != 0.0).collect();
        let wanted: Vec<[f64; 3]> = (0..n).map(|k| [7, 5, 3].map(|c| ((c * k) as f64).sin())).collect();
        let mut x = wanted.clone();
        let factor = Envelope::new(n, &entries).unwrap();
        factor.solve(&mut x);
        for c in 0..3 {
            for (i, wanted) in wanted.iter().enumerate() {
                let found: f64 = (0..n).map(|j| entry(i, j) * x[j][c]).sum();
                assert!((found - wanted[c]).abs() < 1e-13, "{i}: {found} for {wanted:?}"); // some hundred roundings of numbers near 10
            }
            let mut alone: Vec<[f64; 1]> = wanted.iter().map(|b| [b[c]]).collect();
            factor.solve(&mut alone);
            assert!(alone.iter().zip(&x).all(|([alone], x)| alone == &x[c]), "the same bits as beside others");
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        assert_eq!(Envelope::new(2, &[(0, 0, 1.0), (1, 0, 2.0), (1, 1, 1.0)]), None);
        assert_eq!(Envelope::new(1, &[(0, 0, 0.0)]), None);
    }
}
