//! Cholesky factor of a small sparse matrix, each row kept from its first entry to the diagonal.

/// The factor `L` of `A = L L^T`.
///
/// What a row of `A` has before its first entry stays zero in `L`, so that an order in which neighbours are near each
/// other keeps it small. Made for some hundred unknowns, solved for many right-hand sides.
///
/// ```
/// use quadrille::linalg::Envelope;
/// // A chain of three: 2 on the diagonal, 1 beside it.
/// let rows = vec![vec![(0, 2.0)], vec![(0, 1.0), (1, 2.0)], vec![(1, 1.0), (2, 2.0)]];
/// let mut x = vec![3.0, 4.0, 3.0];
/// Envelope::new(&rows).unwrap().solve(&mut x);
/// assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-14));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope {
    rows: Vec<Row>,
}

#[derive(Debug, Clone, PartialEq)]
struct Row {
    first: usize,
    /// From column `first` to the one before the diagonal.
    entries: Vec<f64>,
    /// Of `L`.
    diagonal: f64,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Envelope {
    /// The factor of the symmetric matrix with these rows, of which entries up to the diagonal are taken, each as its column
    /// and value; `None` when it is not positive definite.
    pub fn new(rows: &[Vec<(usize, f64)>]) -> Option<Self> {
        let mut factor: Vec<Row> = Vec::with_capacity(rows.len());
        for (k, row) in rows.iter().enumerate() {
            let lower = || row.iter().filter(|&&(column, _)| column < k);
            let first = lower().map(|&(column, _)| column).min().unwrap_or(k);
            let mut entries = vec![0.0; k - first];
            lower().for_each(|&(column, value)| entries[column - first] += value);
            for at in first..k {
                let other = &factor[at];
                let from = first.max(other.first);
                let known = dot(&entries[from - first..at - first], &other.entries[from - other.first..]);
                entries[at - first] = (entries[at - first] - known) / other.diagonal;
            }
            let own: f64 = row.iter().filter(|&&(column, _)| column == k).map(|&(_, value)| value).sum();
            let pivot = own - dot(&entries, &entries);
            if pivot.is_nan() || pivot <= 1e-12 * own.abs() {
                return None;
            }
            factor.push(Row { first, entries, diagonal: pivot.sqrt() });
        }
        Some(Self { rows: factor })
    }

    /// Replaces `b` by `A^-1 b`.
    ///
    /// # Panics
    /// When `b` has another length.
    pub fn solve(&self, b: &mut [f64]) {
        assert_eq!(b.len(), self.rows.len(), "one number for each unknown");
        for (k, row) in self.rows.iter().enumerate() {
            b[k] = (b[k] - dot(&row.entries, &b[row.first..k])) / row.diagonal;
        }
        for (k, row) in self.rows.iter().enumerate().rev() {
            b[k] /= row.diagonal;
            let x = b[k];
            b[row.first..k].iter_mut().zip(&row.entries).for_each(|(b, l)| *b -= l * x);
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
        let rows: Vec<Vec<(usize, f64)>> =
            (0..n).map(|i| (0..n).map(|j| (j, entry(i, j))).filter(|&(_, v)| v != 0.0).collect()).collect();
        let wanted: Vec<f64> = (0..n).map(|k| ((7 * k) as f64).sin()).collect();
        let mut x = wanted.clone();
        Envelope::new(&rows).unwrap().solve(&mut x);
        for (i, wanted) in wanted.iter().enumerate() {
            let found: f64 = (0..n).map(|j| entry(i, j) * x[j]).sum();
            assert!((found - wanted).abs() < 1e-13, "{i}: {found} for {wanted}"); // some hundred roundings of numbers near 10
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        assert_eq!(Envelope::new(&[vec![(0, 1.0)], vec![(0, 2.0), (1, 1.0)]]), None);
        assert_eq!(Envelope::new(&[vec![(0, 0.0)]]), None);
    }
}
