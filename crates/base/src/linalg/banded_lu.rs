//! LU factor of a banded matrix, with row exchanges: the fastest there is for long strips.

use super::pivots::{PivotSigns, Singular};
use super::sparse::SparseMatrix;
use crate::isa::{Isa, multiversioned};

/// A pivot below this share of the largest entry of its column is exchanged. Of a finite-element matrix that is
/// nearly positive definite hardly any is, and the band stays narrow.
const PIVOT_SHARE: f64 = 0.1;

/// Numbers that are worked on side by side. What lies beyond the end of a row or of a column is zero, and counted in up
/// to the next multiple: no tail is left to go through one by one.
const LANES: usize = 8;

/// Lanes of the pivot's row that are held in registers while all rows below are gone through.
const HELD: usize = 4;

/// The factor of a matrix whose entries lie within a half bandwidth of the diagonal.
#[derive(Debug, Clone)]
pub struct BandedLu {
    band: Band,
    isa: Isa,
    /// Row by row, `band.width()` entries from column `i - half` on: after the elimination the upper triangle.
    rows: Vec<f64>,
    /// Column by column, `band.height()` entries: the multipliers of the `half` rows below.
    lower: Vec<f64>,
    /// The row that was exchanged with each.
    exchanged: Vec<u32>,
    /// Last column in use of each row of the upper triangle.
    ends: Vec<u32>,
    /// Entries of a row that are not zero any more, at most: those beyond belong to exchanges.
    used: usize,
}

#[derive(Debug, Clone, Copy)]
struct Band {
    n: usize,
    half: usize,
}

impl Band {
    /// Room per row: exchanges lengthen a row by as much as the other may lie below it.
    fn width(self) -> usize {
        3 * self.half + 1 + LANES
    }

    /// Room per column of multipliers.
    fn height(self) -> usize {
        self.half.next_multiple_of(LANES)
    }

    /// Room for a right-hand side: zeros behind it.
    fn room(self) -> usize {
        self.n + 2 * self.half + LANES
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
            lower: vec![0.0; n * band.height()],
            exchanged: vec![0; n],
            ends: vec![0; n],
            used: 0,
        }
    }

    /// Number of values (8 bytes each) of a factor of such matrices.
    pub fn n_values(n: usize, half: usize) -> usize {
        let band = Band { n, half };
        n * (band.width() + band.height())
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
        self.rows.chunks_exact_mut(width).for_each(|row| row[..self.used].fill(0.0));
        for column in 0..n {
            for (&row, value) in pattern.column(column).iter().zip(&matrix.values()[pattern.range(column)]) {
                let row = row as usize;
                assert!(row.abs_diff(column) <= half, "an entry outside the band");
                self.rows[row * width + column + half - row] = *value;
            }
        }
        let failed =
            eliminate(self.isa, self.band, &mut self.rows, &mut self.lower, &mut self.exchanged, &mut self.ends);
        let longest = (0..n).map(|k| (self.ends[k] as usize).saturating_sub(k)).max();
        self.used = half + 1 + half.max(longest.unwrap_or(0)).next_multiple_of(LANES);
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
        let (n, each) = (self.band.n.max(1), self.band.room());
        let mut room = vec![0.0; rhs.len() / n * each];
        for (room, column) in room.chunks_exact_mut(each).zip(rhs.chunks_exact(n)) {
            room[..n].copy_from_slice(column);
        }
        substitute(self.isa, self.band, &self.rows, &self.lower, &self.exchanged, &self.ends, &mut room);
        for (room, column) in room.chunks_exact(each).zip(rhs.chunks_exact_mut(n)) {
            column.copy_from_slice(&room[..n]);
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
    /// Forward and backward substitution for right-hand sides with [`Band::room`] each.
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
        // Column k in row i stands at k + half - i. From row to row is far: it is fetched once.
        let own = rows[k * width + half];
        let (mut pivot, mut largest) = (k, own.abs());
        let multipliers = &mut lower[k * band.height()..][..last - k];
        for (i, multiplier) in (k + 1..=last).zip(multipliers.iter_mut()) {
            *multiplier = rows[i * width + k + half - i];
            if multiplier.abs() > largest {
                (pivot, largest) = (i, multiplier.abs());
            }
        }
        if !(largest > 0.0 && largest.is_finite()) {
            return Some(k);
        }
        if own.abs() >= PIVOT_SHARE * largest {
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
            multipliers[pivot - k - 1] = own;
        }
        let inverse = 1.0 / row_k[0];
        multipliers.iter_mut().for_each(|multiplier| *multiplier *= inverse);
        // Beyond its end the pivot's row is zero.
        let row_k = &above[k * width + half + 1..][..(end - k).next_multiple_of(LANES)];
        for (at, pivots) in row_k.chunks(HELD * LANES).enumerate() {
            let below = &mut below[at * HELD * LANES..];
            match pivots.len() / LANES {
                1 => take_off::<FMA, 1>(band, pivots, multipliers, below),
                2 => take_off::<FMA, 2>(band, pivots, multipliers, below),
                3 => take_off::<FMA, 3>(band, pivots, multipliers, below),
                _ => take_off::<FMA, HELD>(band, pivots, multipliers, below),
            }
        }
    }
    None
}

/// Takes a part of the pivot's row off the rows below, each as often as its multiplier says.
#[inline(always)]
fn take_off<const FMA: bool, const N: usize>(band: Band, pivots: &[f64], multipliers: &[f64], below: &mut [f64]) {
    let (Band { half, .. }, width) = (band, band.width());
    let mut held = [[0.0; LANES]; N];
    held.copy_from_slice(&pivots.as_chunks().0[..N]);
    for (i, &multiplier) in multipliers.iter().enumerate() {
        if multiplier == 0.0 {
            continue;
        }
        let entries = &mut below[i * width + half - i..].as_chunks_mut::<LANES>().0[..N];
        for part in 0..N {
            for lane in 0..LANES {
                entries[part][lane] = mul_add::<FMA>(-multiplier, held[part][lane], entries[part][lane]);
            }
        }
    }
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
    // Each unknown waits for the one before it: of several right-hand sides those of others are gone on with meanwhile.
    for k in 0..n {
        let multipliers = lower[k * band.height()..][..band.height()].as_chunks::<LANES>().0;
        for rhs in rhs.chunks_exact_mut(band.room()) {
            rhs.swap(k, exchanged[k] as usize);
            let factor = -rhs[k];
            let below = &mut rhs[k + 1..].as_chunks_mut::<LANES>().0[..multipliers.len()];
            for part in 0..multipliers.len() {
                for lane in 0..LANES {
                    below[part][lane] = mul_add::<FMA>(factor, multipliers[part][lane], below[part][lane]);
                }
            }
        }
    }
    for k in (0..n).rev() {
        let pivot = rows[k * width + half];
        let row = rows[k * width + half + 1..].as_chunks::<LANES>().0;
        let row = &row[..(ends[k] as usize - k).div_ceil(LANES)];
        for rhs in rhs.chunks_exact_mut(band.room()) {
            // Sums side by side: a single chain would wait for each addition.
            let mut sums = [0.0; LANES];
            let known = &rhs[k + 1..].as_chunks::<LANES>().0[..row.len()];
            for part in 0..row.len() {
                for lane in 0..LANES {
                    sums[lane] = mul_add::<FMA>(row[part][lane], known[part][lane], sums[lane]);
                }
            }
            let [a, b, c, d] = std::array::from_fn(|lane| sums[lane] + sums[lane + LANES / 2]);
            rhs[k] = (rhs[k] - ((a + c) + (b + d))) / pivot;
        }
    }
}
