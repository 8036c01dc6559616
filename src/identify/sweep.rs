//! One parameter prescribed at several values, the others fitted: the paper's Table 2.

use super::FitError;
use super::constants::ConstantKind;
use super::fit::{Fit, fit};
use super::objective::Problem;
use super::options::{FitOptions, Intervals};
use rayon::prelude::*;

/// The fit at one prescribed value.
#[derive(Debug)]
pub struct SweepRow {
    /// The prescribed value.
    pub value: f64,
    /// The fit of the others.
    pub fit: Fit,
}

/// Fits the unknowns with parameter `index` of the law prescribed at each of `values`.
///
/// # Errors
/// See [`FitError`].
pub fn sweep(
    problem: &Problem<'_>,
    options: &FitOptions,
    index: usize,
    values: &[f64],
) -> Result<Vec<SweepRow>, FitError> {
    // The values are chosen, not known: their uncertainty is no part of a row.
    let chosen = ConstantKind::Law { index };
    let constants = options.constants.iter().filter(|constant| constant.kind != chosen).cloned().collect();
    let options = &FitOptions { constants, doubt: false, intervals: Intervals::Linear, ..options.clone() };
    let row = |&value: &f64| {
        let unknowns = problem.unknowns.with_prescribed(index, value)?;
        Ok(SweepRow { value, fit: fit(&problem.with_unknowns(unknowns), options)? })
    };
    values.par_iter().map(row).collect()
}
