//! What one part of the data tells by itself: standard uncertainties from its own information.

use crate::linalg::Dense;

/// Eigenvalues of the normal matrix, made free of scales, below this share of the largest tell nothing.
const NOTHING: f64 = 1e-11;
/// Share of a parameter in the directions of which nothing is told, above which it is not told either.
const IN_NOTHING: f64 = 1e-8;

/// A symmetric matrix made free of scales, with what it says nothing of taken out.
struct Told {
    /// Square roots of the diagonal; zero where nothing is seen.
    scale: Vec<f64>,
    values: Vec<f64>,
    vectors: Dense,
    /// Places of the eigenvalues that tell something.
    told: Vec<usize>,
}

impl Told {
    fn new(h: &Dense) -> Option<Self> {
        let n = h.n_rows();
        let scale: Vec<f64> = (0..n).map(|k| h[(k, k)].max(0.0).sqrt()).collect();
        let largest = scale.iter().fold(0.0_f64, |most, s| most.max(*s));
        let scale: Vec<f64> = scale.iter().map(|&s| if s > NOTHING * largest { s } else { 0.0 }).collect();
        let (values, vectors) = free_of(&scale, h).symmetric_eigen()?;
        let most = values.last().copied().unwrap_or(0.0);
        let told = (0..n).filter(|&k| values[k] > NOTHING * most).collect();
        Some(Self { scale, values, vectors, told })
    }

    /// The inverse of the scaled matrix where it tells something.
    fn inverse(&self) -> Dense {
        let n = self.scale.len();
        let term = |k: usize, r: usize, c: usize| self.vectors[(r, k)] * self.vectors[(c, k)] / self.values[k];
        Dense::from_fn(n, n, |r, c| self.told.iter().map(|&k| term(k, r, c)).sum::<f64>())
    }

    /// Whether unknown `j` is told by itself.
    fn tells(&self, j: usize) -> bool {
        let nothing = (0..self.scale.len()).filter(|k| !self.told.contains(k));
        let share: f64 = nothing.map(|k| self.vectors[(j, k)] * self.vectors[(j, k)]).sum();
        self.scale[j] > 0.0 && share < IN_NOTHING
    }
}

/// A matrix by the scales of its rows and columns; zero where there is none.
fn free_of(scale: &[f64], m: &Dense) -> Dense {
    let n = scale.len();
    let entry = |r: usize, c: usize| {
        let scale = scale[r] * scale[c];
        if scale > 0.0 { m[(r, c)] / scale } else { 0.0 }
    };
    Dense::from_fn(n, n, entry)
}

/// The inverse of the normal matrix `h` in the directions that it tells something of, and their number; `None` when it
/// holds a number that is not finite.
pub(super) fn pseudo_inverse(h: &Dense) -> Option<(Dense, usize)> {
    let told = Told::new(h)?;
    let (inverse, scale) = (told.inverse(), &told.scale);
    let entry = |r: usize, c: usize| {
        let scale = scale[r] * scale[c];
        if scale > 0.0 { inverse[(r, c)] / scale } else { 0.0 }
    };
    Some((Dense::from_fn(scale.len(), scale.len(), entry), told.told.len()))
}

/// Standard uncertainty of each scaled unknown under the normal matrix `h = J^T W J`, whose gradient has the covariance
/// `spread` (`h` itself for weights that are the inverse covariance); `None` of an unknown of which these data say
/// nothing.
pub fn stds_of_information(h: &Dense, spread: &Dense) -> Vec<Option<f64>> {
    let n = h.n_rows();
    let Some(told) = Told::new(h) else { return vec![None; n] };
    let inverse = told.inverse();
    let covariance = inverse.times(&free_of(&told.scale, spread)).times(&inverse);
    let std = |j: usize| told.tells(j).then(|| covariance[(j, j)].max(0.0).sqrt() / told.scale[j]);
    (0..n).map(std).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_part_says_nothing_of_has_no_uncertainty_and_what_it_does_has_that_of_the_inverse() {
        // Unknowns of scales 1 and 1e3, correlated; the third is not seen at all.
        let h = Dense::from_fn(3, 3, |r, c| [[4.0, 1e3, 0.0], [1e3, 1e6, 0.0], [0.0; 3]][r][c]);
        let found = stds_of_information(&h, &h);
        // [[4, 1], [1, 1]]^-1 = [[1, -1], [-1, 4]] / 3.
        assert!((found[0].unwrap() - (1.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((found[1].unwrap() - 1e-3 * (4.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!(found[2], None);
        // Only the sum of two is told: neither of them is.
        let h = Dense::from_fn(2, 2, |_, _| 2.0);
        assert_eq!(stds_of_information(&h, &h), [None, None]);
    }
}
