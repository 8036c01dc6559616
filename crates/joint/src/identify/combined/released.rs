//! The prescribed parameters of the law of several tests, tried once as unknowns.

use super::known::Known;
use super::search::{Searched, TestWeights, run};
use crate::identify::FitError;
use crate::identify::doubt::released::{EVALUATIONS, Released, ReleasedParameter, STEP, limit};
use crate::identify::objective::problem::{Evaluation, Problem};
use crate::identify::objective::unknowns::Unknowns;
use crate::identify::solve::trust_region::{FitStatus, TrustRegionOptions};

/// The trial from where the fit of `tests` under `weights` ended with the objective `omega`; `None` where nothing is
/// prescribed, or the law allows no other values.
///
/// # Errors
/// A tangent without inverse.
pub(super) fn release(
    tests: &[Searched<'_>],
    weights: &[TestWeights],
    evaluation: &Evaluation,
    omega: f64,
) -> Result<Option<Released>, FitError> {
    let unknowns = &tests[0].problem.unknowns;
    let law = unknowns.law_at(&evaluation.x)?;
    let values = law.values();
    let mut list: Vec<(usize, f64, Option<f64>, Option<f64>)> = (unknowns.list().iter().zip(&evaluation.x))
        .map(|(unknown, &x)| (unknown.index, x, Some(unknown.bounds[0]), Some(unknown.bounds[1])))
        .collect();
    let fitted = list.len();
    let prescribed: Vec<usize> =
        (0..values.len()).filter(|index| list.iter().all(|(fitted, ..)| fitted != index)).collect();
    list.extend(prescribed.iter().map(|&index| (index, values[index], None, None)));
    let n_data: usize = tests.iter().map(|test| test.problem.observation.n_data()).sum();
    if prescribed.is_empty() || n_data <= list.len() {
        return Ok(None);
    }
    let of_all = tests.iter().map(|test| Unknowns::new(&*law, &list).map(|all| test.problem.with_unknowns(all)));
    let Ok(problems) = of_all.collect::<Result<Vec<Problem<'_>>, _>>() else { return Ok(None) };
    let free: Vec<Searched<'_>> =
        problems.iter().zip(tests).map(|(problem, test)| Searched { problem, options: test.options }).collect();
    let region =
        TrustRegionOptions { step_tolerance: STEP, max_evaluations: EVALUATIONS, ..TrustRegionOptions::default() };
    let unknowns = &problems[0].unknowns;
    let end = run(&free, weights, unknowns, &unknowns.start(), &region);
    let Some(local) = &end.local else { return Ok(None) };
    let x = unknowns.unscaled(&end.z);
    let slopes = unknowns.slopes(&x);
    let led = Known::at(&free, weights, &end.z).ok().and_then(|known| known.led);
    let std = |k: usize| {
        let covariance = &led.as_ref()?.statistics[0].covariance;
        Some(slopes[k] * covariance[(k, k)].max(0.0).sqrt()).filter(|std| std.is_finite())
    };
    let parameters = (prescribed.iter().enumerate())
        .map(|(k, &index)| ReleasedParameter {
            name: law.parameters()[index].name,
            prescribed: values[index],
            value: x[fitted + k],
            std: std(fitted + k),
        })
        .collect();
    Ok(Some(Released {
        limit: limit(prescribed.len()),
        parameters,
        gain: (omega - local.omega).max(0.0),
        converged: end.status == FitStatus::Converged,
    }))
}
