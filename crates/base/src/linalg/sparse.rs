//! Patterns of general sparse matrices, by compressed columns, and the values on them.

use super::blocks::{ascending_rows, by_key};
use std::sync::Arc;

/// Which entries of a square matrix may differ from zero: by columns, rows ascending in each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SparsePattern {
    column_starts: Vec<u32>,
    rows: Vec<u32>,
}

impl SparsePattern {
    /// The pattern of `n` unknowns, each coupled with itself and with those of its groups.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::linalg::SparsePattern;
    /// let chain = SparsePattern::from_groups(3, [[0, 1], [1, 2]].iter().map(|pair| pair.as_slice()));
    /// assert_eq!((chain.n(), chain.n_values(), chain.half_bandwidth()), (3, 7, 1));
    /// assert!(chain.place(0, 2).is_none());
    /// ```
    ///
    /// # Panics
    /// When a group names an unknown that does not exist.
    pub fn from_groups<'a>(n: usize, groups: impl Iterator<Item = &'a [u32]> + Clone) -> Self {
        let members = groups.clone().zip(0u32..).flat_map(|(group, number)| group.iter().map(move |&k| (k, number)));
        let (starts, of) = by_key(n, members);
        let groups: Vec<&[u32]> = groups.collect();
        let (column_starts, rows) = ascending_rows(n, 0, |k, column| {
            column.push(k as u32);
            for &group in &of[starts[k] as usize..starts[k + 1] as usize] {
                column.extend_from_slice(groups[group as usize]);
            }
        });
        Self { column_starts, rows }
    }

    /// Number of unknowns.
    pub fn n(&self) -> usize {
        self.column_starts.len() - 1
    }

    /// Number of entries.
    pub fn n_values(&self) -> usize {
        self.rows.len()
    }

    /// Rows of the entries of a column, ascending.
    pub fn column(&self, column: usize) -> &[u32] {
        &self.rows[self.range(column)]
    }

    /// Where the values of a column are.
    pub fn range(&self, column: usize) -> std::ops::Range<usize> {
        self.column_starts[column] as usize..self.column_starts[column + 1] as usize
    }

    /// Where the value of an entry is; `None` when it is always zero.
    pub fn place(&self, row: usize, column: usize) -> Option<usize> {
        let at = self.column(column).binary_search(&(row as u32)).ok()?;
        Some(self.range(column).start + at)
    }

    /// Largest distance of an entry from the diagonal.
    pub fn half_bandwidth(&self) -> usize {
        let reach = |k: usize| self.column(k).iter().map(|&row| (row as usize).abs_diff(k)).max().unwrap_or(0);
        (0..self.n()).map(reach).max().unwrap_or(0)
    }

    pub(super) fn parts(&self) -> (&[u32], &[u32]) {
        (&self.column_starts, &self.rows)
    }
}

/// A square sparse matrix.
#[derive(Debug, Clone)]
pub struct SparseMatrix {
    pattern: Arc<SparsePattern>,
    values: Vec<f64>,
}

impl SparseMatrix {
    /// The zero matrix on `pattern`.
    pub fn zero(pattern: &Arc<SparsePattern>) -> Self {
        Self { pattern: pattern.clone(), values: vec![0.0; pattern.n_values()] }
    }

    /// Its pattern.
    pub fn pattern(&self) -> &Arc<SparsePattern> {
        &self.pattern
    }

    /// Its values, in the order of [`SparsePattern::place`].
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Its values, to be written.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Where each entry's mirror image is, in the order of [`SparsePattern::place`]; `None` where one is not stored.
    pub fn mirror(&self) -> Option<Vec<u32>> {
        let of_column = |column: usize| self.pattern.column(column).iter().map(move |&row| (column, row as usize));
        let entries = (0..self.pattern.n()).flat_map(of_column);
        entries.map(|(column, row)| Some(self.pattern.place(column, row)? as u32)).collect()
    }

    /// Transposes it in place; `mirror` is its own [`SparseMatrix::mirror`].
    pub fn transpose(&mut self, mirror: &[u32]) {
        for (at, &other) in mirror.iter().enumerate() {
            // Each pair once.
            if at < other as usize {
                self.values.swap(at, other as usize);
            }
        }
    }

    /// `matrix vector`.
    pub fn times(&self, vector: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; vector.len()];
        for (column, &factor) in vector.iter().enumerate() {
            for at in self.pattern.range(column) {
                product[self.pattern.rows[at] as usize] += self.values[at] * factor;
            }
        }
        product
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transpose_has_each_entry_at_its_mirror_image() {
        let groups: [&[u32]; 3] = [&[0, 1, 3], &[1, 2], &[3, 2]];
        let pattern = Arc::new(SparsePattern::from_groups(4, groups.into_iter()));
        let mut matrix = SparseMatrix::zero(&pattern);
        (1..).zip(matrix.values_mut()).for_each(|(k, value)| *value = f64::from(k));
        let before = matrix.clone();
        matrix.transpose(&before.mirror().unwrap());
        let at = |matrix: &SparseMatrix, row, column| pattern.place(row, column).map(|at| matrix.values()[at]);
        for row in 0..4 {
            for column in 0..4 {
                assert_eq!(at(&matrix, row, column), at(&before, column, row));
            }
        }
    }
}
