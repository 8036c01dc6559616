//! LU factor of a banded matrix, with row exchanges: the fastest there is for long strips.

use super::pivots::{PivotSigns, Singular};
use super::sparse::SparseMatrix;
use crate::isa::{Isa, multiversioned};

/// A pivot below this share of the largest entry of its column is exchanged. Of a finite-element matrix that is
/// nearly positive definite hardly any is, and the band stays narrow.
const PIVOT_SHARE: f64 = 0.1;

/// The factor of a matrix whose entries lie within a half bandwidth of the diagonal.
#[derive(Debug, Clone)]
pub struct BandedLu {
    band: Band,
    isa: Isa,
    /// Row by row, `band.width()` entries from column `i - half` on: after the elimination the upper triangle.
    rows: Vec<f64>,
    /// Column by column, the multipliers of the `half` rows below.
    lower: Vec<f64>,
    /// The row that was exchanged with each.
    exchanged: Vec<u32>,
    /// Last column in use of each row of the upper triangle.
    ends: Vec<u32>,
}

/// Size of a band matrix.
#[derive(Debug, Clone, Copy)]
struct Band {
    n: usize,
    half: usize,
}

impl Band {
    /// Room per row: exchanges lengthen a row by as much as the other may lie below it.
    fn width(self) -> usize {
        3 * self.half + 1
    }
}

impl BandedLu {
    /// Room for the factor of matrices with `n` unknowns and entries up to `half` from the diagonal.
    pub fn new(n: usize, half: usize) -> Self {
        let band = Band { n, half };
        Self {
            band,
            isa: Isa::detect(),
            rows: vec![0.0; n * band.width()],
            lower: vec![0.0; n * half],
            exchanged: vec![0; n],
            ends: vec![0; n],
        }
    }

    /// Memory that it takes, bytes.
    pub fn bytes(&self) -> usize {
        8 * (self.rows.len() + self.lower.len() + self.exchanged.len())
    }

    /// Factorises `matrix`, in place of what was there.
    ///
    /// # Errors
    /// [`Singular`] with the unknown whose column has no pivot.
    ///
    /// # Panics
    /// When the matrix has another size or an entry outside the band.
    pub fn factor(&mut self, matrix: &SparseMatrix) -> Result<(), Singular> {
        let (Band { n, half }, width) = (self.band, self.band.width());
        let pattern = matrix.pattern();
        assert_eq!(pattern.n(), n, "the size of the matrix");
        self.rows.fill(0.0);
        for column in 0..n {
            for (&row, value) in pattern.column(column).iter().zip(&matrix.values()[pattern.range(column)]) {
                let row = row as usize;
                assert!(row.abs_diff(column) <= half, "an entry outside the band");
                self.rows[row * width + column + half - row] = *value;
            }
        }
        let failed =
            eliminate(self.isa, self.band, &mut self.rows, &mut self.lower, &mut self.exchanged, &mut self.ends);
        failed.map_or(Ok(()), |unknown| Err(Singular { unknown }))
    }

    /// The signs of the pivots of the last factor.
    pub fn pivots(&self) -> PivotSigns {
        let (half, width) = (self.band.half, self.band.width());
        let negative = (0..self.band.n).filter(|k| self.rows[k * width + half] < 0.0).count();
        let exchanged = (0..self.band.n).filter(|&k| self.exchanged[k] as usize != k).count();
        PivotSigns { negative, exchanged }
    }

    /// Solves in place for right-hand sides that follow one another in `rhs`, each of `n` numbers.
    ///
    /// # Panics
    /// When the length of `rhs` is no multiple of `n`.
    pub fn solve(&self, rhs: &mut [f64]) {
        assert_eq!(rhs.len() % self.band.n.max(1), 0, "the length of the right-hand sides");
        for column in rhs.chunks_exact_mut(self.band.n.max(1)) {
            substitute(self.isa, self.band, &self.rows, &self.lower, &self.exchanged, &self.ends, column);
        }
    }
}

multiversioned! {
    /// Eliminates column after column; gives the unknown without a pivot.
    fn eliminate [] [] (
        band: Band, rows: &mut [f64], lower: &mut [f64], exchanged: &mut [u32], ends: &mut [u32]
    ) -> Option<usize> => eliminate_body
}

multiversioned! {
    /// Forward and backward substitution for one right-hand side.
    fn substitute [] [] (
        band: Band, rows: &[f64], lower: &[f64], exchanged: &[u32], ends: &[u32], rhs: &mut [f64]
    ) => substitute_body
}

/// `a * b + c`, fused where the path has the instruction.
#[inline(always)]
fn mul_add<const FMA: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

#[inline(always)]
fn eliminate_body<const FMA: bool>(
    band: Band,
    rows: &mut [f64],
    lower: &mut [f64],
    exchanged: &mut [u32],
    ends: &mut [u32],
) -> Option<usize> {
    let (Band { n, half }, width) = (band, band.width());
    let mut end = 0;
    for k in 0..n {
        let last = (k + half).min(n - 1);
        // Column k in row i stands at k + half - i.
        let own = rows[k * width + half].abs();
        let (mut pivot, mut largest) = (k, own);
        for i in k + 1..=last {
            let size = rows[i * width + k + half - i].abs();
            if size > largest {
                (pivot, largest) = (i, size);
            }
        }
        if !(largest > 0.0 && largest.is_finite()) {
            return Some(k);
        }
        if own >= PIVOT_SHARE * largest {
            pivot = k;
        }
        exchanged[k] = pivot as u32;
        end = (pivot + half).min(n - 1).max(end);
        ends[k] = end as u32;
        let (above, below) = rows.split_at_mut((k + 1) * width);
        let row_k = &mut above[k * width + half..k * width + half + end - k + 1];
        if pivot != k {
            let start = (pivot - k - 1) * width + k + half - pivot;
            row_k.swap_with_slice(&mut below[start..start + end - k + 1]);
        }
        let inverse = 1.0 / row_k[0];
        let multipliers = &mut lower[k * half..k * half + last - k];
        for (i, multiplier) in (k + 1..=last).zip(multipliers) {
            let start = (i - k - 1) * width + k + half - i;
            let row = &mut below[start..start + end - k + 1];
            *multiplier = row[0] * inverse;
            if *multiplier != 0.0 {
                let factor = -*multiplier;
                for (entry, &of_pivot) in row[1..].iter_mut().zip(&row_k[1..]) {
                    *entry = mul_add::<FMA>(factor, of_pivot, *entry);
                }
            }
        }
    }
    None
}

#[inline(always)]
fn substitute_body<const FMA: bool>(
    band: Band,
    rows: &[f64],
    lower: &[f64],
    exchanged: &[u32],
    ends: &[u32],
    rhs: &mut [f64],
) {
    let (Band { n, half }, width) = (band, band.width());
    for k in 0..n {
        rhs.swap(k, exchanged[k] as usize);
        let last = (k + half).min(n - 1);
        let factor = -rhs[k];
        for (below, &multiplier) in rhs[k + 1..=last].iter_mut().zip(&lower[k * half..]) {
            *below = mul_add::<FMA>(factor, multiplier, *below);
        }
    }
    for k in (0..n).rev() {
        let end = ends[k] as usize;
        let row = &rows[k * width + half..k * width + half + end - k + 1];
        // Sums side by side: a single chain would wait for each addition.
        let mut sums = [0.0; 8];
        let (pairs, known) = (row[1..].chunks_exact(8), rhs[k + 1..=end].chunks_exact(8));
        let tail: f64 = pairs.remainder().iter().zip(known.remainder()).map(|(a, b)| a * b).sum();
        for (a, b) in pairs.zip(known) {
            for lane in 0..8 {
                sums[lane] = mul_add::<FMA>(a[lane], b[lane], sums[lane]);
            }
        }
        rhs[k] = (rhs[k] - (sums.iter().sum::<f64>() + tail)) / row[0];
    }
}
