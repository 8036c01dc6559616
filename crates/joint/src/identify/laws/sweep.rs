//! One parameter prescribed at several values, the others fitted: the paper's Table 2.

use crate::identify::{ConstantKind, Fit, FitError, FitOptions, Problem, fit};
use crate::io::case::Intervals;
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
/// When the watch of `problem` ends it, fits that go on end at their best points ([`Fit::cut_short`]), and values whose
/// fit has no point yet have no row.
///
/// # Errors
/// See [`FitError`]. Not converging is an outcome.
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
        let ended = || problem.watch.ended().is_some();
        if ended() {
            return Ok(None);
        }
        match fit(&problem.with_unknowns(unknowns), options) {
            Ok(fit) => Ok(Some(SweepRow { value, fit })),
            // A forward run that is broken off looks like one without a solution.
            Err(_) if ended() => Ok(None),
            Err(error) => Err(error),
        }
    };
    let rows: Vec<Option<SweepRow>> = values.par_iter().map(row).collect::<Result<_, FitError>>()?;
    Ok(rows.into_iter().flatten().collect())
}
