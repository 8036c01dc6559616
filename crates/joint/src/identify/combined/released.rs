//! The prescribed parameters of the law of several tests, tried once as unknowns.

use super::known::Known;
use super::search::{Searched, TestWeights, run};
use crate::identify::doubt::released::Trial;
use crate::identify::{Evaluation, FitError, Problem, Released};

/// The trial from where the fit of `tests` under `weights` ended with the objective `omega`; `None` where nothing is
/// prescribed, or the law allows no other values. Errors: a tangent without inverse.
pub(super) fn release(
    tests: &[Searched<'_>],
    weights: &[TestWeights],
    evaluation: &Evaluation,
    omega: f64,
) -> Result<Option<Released>, FitError> {
    let n_data: usize = tests.iter().map(|test| test.problem.n_data()).sum();
    let Some(trial) = Trial::new(&tests[0].problem.unknowns, &evaluation.x, n_data)? else { return Ok(None) };
    let of_all = tests.iter().map(|test| Some(test.problem.with_unknowns(trial.unknowns(&test.problem.unknowns)?)));
    let Some(problems) = of_all.collect::<Option<Vec<Problem<'_>>>>() else { return Ok(None) };
    let free: Vec<Searched<'_>> =
        problems.iter().zip(tests).map(|(problem, test)| Searched { problem, ..*test }).collect();
    let unknowns = &problems[0].unknowns;
    let end = run(&free, weights, &unknowns.start(), &Trial::region());
    let Some(local) = &end.local else { return Ok(None) };
    let x = unknowns.unscaled(&end.z);
    let slopes = unknowns.slopes(&x);
    let led = Known::at(&free, weights, &end.z).ok().and_then(|known| known.led);
    let std = |k: usize| {
        let covariance = &led.as_ref()?.statistics[0].covariance;
        Some(slopes[k] * covariance[(k, k)].max(0.0).sqrt())
    };
    Ok(Some(trial.released(end.status, &x, std, (omega - local.omega).max(0.0))))
}
