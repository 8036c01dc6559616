//! Further starts of a fit that ended where it hardly can be right: a joint that is torn apart at once, or not at all,
//! has minima of its own.

use crate::identify::solve::stage::run;
use crate::identify::{End, FitOptions, FitStatus, Problem, TrustRegionOptions, Unknown, Unknowns, Weights};
use crate::mechanics::BoundaryHistory;
use rayon::prelude::*;

/// The objective by its expectation above which the end of a fit is doubted: residuals of twice the noise.
const DOUBTFUL: f64 = 4.0;
/// Factors of all tractions and of all jumps, from the start of the fit on.
const FACTORS: [[f64; 2]; 6] =
    [[3.0, 1.0], [1.0 / 3.0, 1.0], [1.0, 3.0], [1.0, 1.0 / 3.0], [3.0, 1.0 / 3.0], [1.0 / 3.0, 3.0]];
/// Evaluations that each of them may take before they are compared.
const EVALUATIONS: usize = 12;

/// Where a fit does better that ended so, with the objective `omega` under `weights` where the noise is `expected` to
/// leave another: on the way from laws with a third and three times the tractions and jumps of its start. `None` where
/// it needs none (it came to its end, with a residual that noise may leave), the user chose starts, or none of them
/// leads lower.
pub(crate) fn further_start(
    problem: &Problem<'_>,
    options: &FitOptions,
    weights: &Weights,
    (status, omega, expected): (FitStatus, f64, Option<f64>),
) -> Option<Vec<f64>> {
    // Of a noise that is not known the expectation is the objective itself.
    let misfit = problem.noise.sigma.is_some() && expected.is_some_and(|expected| omega > DOUBTFUL * expected);
    let wanted = options.doubt && options.starts.is_empty() && !status.cut_short();
    // A law that is compared with others has more starts than one anyway.
    let stalled = status == FitStatus::Stalled && options.region.standstill == 0.0;
    if !wanted || !(misfit || stalled) || problem.watch.ended().is_some() {
        return None;
    }
    let start = problem.unknowns.start();
    let region = TrustRegionOptions { max_evaluations: EVALUATIONS, ..options.region };
    let boundary = &problem.border.boundary;
    let tried: Vec<End> = FACTORS
        .par_iter()
        .filter_map(|factors| {
            let start = scaled_law(&problem.unknowns, &start, *factors);
            problem.unknowns.law_at(&start).ok()?;
            Some(run(problem, boundary, weights, &start, None, &region))
        })
        .collect();
    let omega_of = |end: &End| end.local.as_ref().map_or(f64::INFINITY, |local| local.omega);
    let best = tried.iter().min_by(|a, b| omega_of(a).total_cmp(&omega_of(b)))?;
    (omega_of(best) < omega).then(|| problem.unknowns.unscaled(&best.z))
}

/// Factors by which the parameters of a law with minima of its own that shape its corners (its stiffness, numbers
/// without unit) are off where another minimum is looked for; the second where the first is no law.
const SHAPE: [[f64; 2]; 2] = [[3.0, 1.7], [1.0 / 3.0, 1.0 / 1.7]];
/// Evaluations that the way to another minimum may take.
const TO_MINIMUM: usize = 30;
/// Scaled distance below which two minima are one.
const ONE: f64 = 0.05;

/// Where else the objective has a minimum, in scaled unknowns with its value, of a law with
/// [minima of its own](crate::mechanics::cohesive::CohesiveLaw::has_own_minima) fitted at the scaled unknowns `z`; the
/// lowest first. None of other laws.
pub(crate) fn other_minima(
    problem: &Problem<'_>,
    options: &FitOptions,
    weights: &Weights,
    boundary: &BoundaryHistory,
    z: &[f64],
) -> Vec<(Vec<f64>, f64)> {
    let unknowns = &problem.unknowns;
    if !unknowns.law().has_own_minima() || problem.watch.ended().is_some() {
        return Vec::new();
    }
    let x = unknowns.unscaled(z);
    let start = |k: usize, factors: &[f64; 2]| {
        factors.iter().find_map(|factor| {
            let mut there = x.clone();
            let [lower, upper] = unknowns.list()[k].bounds;
            there[k] = (factor * x[k]).clamp(lower, upper);
            (there[k] != x[k] && unknowns.law_at(&there).is_ok()).then_some(there)
        })
    };
    let shapes = (0..x.len()).filter(|&k| ["MPa/mm", "1"].contains(&unknowns.list()[k].parameter.unit));
    let starts: Vec<Vec<f64>> =
        shapes.flat_map(|k| SHAPE.iter().filter_map(move |factors| start(k, factors))).collect();
    let region = TrustRegionOptions { max_evaluations: TO_MINIMUM, ..options.region };
    let ends: Vec<End> = starts.par_iter().map(|start| run(problem, boundary, weights, start, None, &region)).collect();
    let mut found: Vec<(Vec<f64>, f64)> = (ends.into_iter())
        .filter(|end| end.status == FitStatus::Converged)
        .filter_map(|end| Some((end.z, end.local?.omega)))
        .collect();
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > ONE);
    let mut minima: Vec<(Vec<f64>, f64)> = Vec::new();
    for (there, omega) in found {
        if apart(&there, z) && minima.iter().all(|(other, _)| apart(&there, other)) {
            minima.push((there, omega));
        }
    }
    minima
}

/// The unknowns at `x` with all tractions of the law times the first factor and all jumps times the second, within
/// their bounds.
fn scaled_law(unknowns: &Unknowns, x: &[f64], [traction, jump]: [f64; 2]) -> Vec<f64> {
    let value = |(unknown, x): (&Unknown, &f64)| {
        let factor = match unknown.parameter.unit {
            "MPa" => traction,
            "mm" => jump,
            "N/mm" => traction * jump,
            "MPa/mm" => traction / jump,
            _ => 1.0,
        };
        (factor * x).clamp(unknown.bounds[0], unknown.bounds[1])
    };
    unknowns.list().iter().zip(x).map(value).collect()
}

/// What is to be said of a fit beside whose minimum `others` lie that the data allow too.
pub(crate) fn several_minima(law: &str, others: usize) -> String {
    format!(
        "the fit of {law} has {others} more {} that the data allow as well (corners of the law, parameters that stand for each other): \
         intervals and the bands of the law hold what the objective allows about each of them; standard uncertainties, correlations \
         and the bands along the joint belong to the lowest",
        if others == 1 { "minimum" } else { "minima" }
    )
}
