//! The fit: starts, weights, end, and what is known of the result.

use super::constants::{Constant, ConstantEffect};
use super::derived::{Derived, derived};
use super::discretisation::Discretisation;
use super::noise::Noise;
use super::objective::{Evaluation, Problem};
use super::statistics::Statistics;
use super::trust_region::{End, FitStatus, Iteration, TrustRegionOptions, minimise};
use super::unknowns::Unknowns;
use super::verdict::{Verdict, verdict};
use super::weights::{InverseCovariance, WeightKind, Weights};
use super::{FitError, cone_step::StepRegion, cone_step::cone_step};
use crate::linalg::{Dense, NotPositiveDefinite};
use crate::mechanics::cohesive::Parameter;
use crate::mechanics::{BoundaryHistory, Solution};
use rayon::prelude::*;

/// 97.5 % of a normal distribution lie below this many standard deviations.
pub const NORMAL_95: f64 = 1.959963984540054;

/// How to fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// The weights.
    pub weights: WeightKind,
    /// Whether the prescribed displacements are unknowns too, with their covariance; for covariance weights.
    pub estimate_boundary: bool,
    /// Further starts beside that of the unknowns.
    pub starts: Vec<Vec<f64>>,
    /// The iteration.
    pub region: TrustRegionOptions,
    /// Model constants that are not known exactly.
    pub constants: Vec<Constant>,
    /// What becomes of the effect of the element size.
    pub discretisation: Discretisation,
}

impl Default for FitOptions {
    fn default() -> Self {
        let region = TrustRegionOptions::default();
        Self {
            weights: WeightKind::Paper,
            estimate_boundary: false,
            starts: Vec::new(),
            region,
            constants: Vec::new(),
            discretisation: Discretisation::Stated,
        }
    }
}

/// One parameter that was fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// The parameter.
    pub parameter: Parameter,
    /// Its value.
    pub value: f64,
    /// Its standard uncertainty, from noise and uncertain constants; `None` when the data do not give one.
    pub std: Option<f64>,
    /// Its change if the elements were half as large.
    pub discretisation: Option<f64>,
    /// 95 % interval, with the change by the element size as one more standard uncertainty where that was asked for.
    pub interval95: Option<[f64; 2]>,
    /// Where the fit started.
    pub start: f64,
    /// The bounds.
    pub bounds: [f64; 2],
    /// Whether it ended on one of them.
    pub at_bound: bool,
}

/// A quantity with its standard uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedQuantity {
    /// The quantity.
    pub quantity: Derived,
    /// Its standard uncertainty.
    pub std: Option<f64>,
    /// Its change if the elements were half as large.
    pub discretisation: Option<f64>,
    /// 95 % interval, as that of a parameter.
    pub interval95: Option<[f64; 2]>,
}

/// Where one start led.
#[derive(Debug, Clone, PartialEq)]
pub struct StartEnd {
    /// The start.
    pub start: Vec<f64>,
    /// The end.
    pub end: Vec<f64>,
    /// The objective there, under the weights of the first stage.
    pub omega: Option<f64>,
    /// How it ended.
    pub status: FitStatus,
    /// Evaluations.
    pub evaluations: usize,
    /// Evaluations in which the forward run was rescued.
    pub rescued: usize,
    /// Largest distance of a scaled unknown from the best end.
    pub distance: f64,
}

/// The result.
#[derive(Debug)]
pub struct Fit {
    /// The parameters that were fitted.
    pub parameters: Vec<FittedParameter>,
    /// The values of all parameters of the law.
    pub values: Vec<f64>,
    /// What follows from them.
    pub derived: Vec<FittedQuantity>,
    /// Covariance of the parameters, noise and uncertain constants together.
    pub covariance: Option<Dense>,
    /// Their correlation.
    pub correlation: Option<Dense>,
    /// Singular values of the weighted Jacobian by the scaled unknowns, falling.
    pub singular_values: Vec<f64>,
    /// The objective.
    pub omega: f64,
    /// How it ended.
    pub status: FitStatus,
    /// In words.
    pub reason: String,
    /// Evaluations of the start that was taken, all stages.
    pub evaluations: usize,
    /// Those in which the forward run was rescued.
    pub rescued: usize,
    /// Every evaluation, in parameters, with the objective of its stage and the trust radius.
    pub history: Vec<Iteration>,
    /// All starts.
    pub starts: Vec<StartEnd>,
    /// The verdict on identifiability; `None` without covariance.
    pub verdict: Option<Verdict>,
    /// What noise does; `None` without covariance.
    pub statistics: Option<Statistics>,
    /// What each uncertain constant does to the parameters.
    pub constants: Vec<ConstantEffect>,
    /// The objective's ingredients at the end.
    pub evaluation: Evaluation,
    /// The prescribed displacements of the end: as measured, or as estimated.
    pub boundary: BoundaryHistory,
    /// Largest correction of a prescribed displacement, mm; where they are estimated.
    pub largest_correction: Option<f64>,
}

impl Fit {
    /// The forward run at the end.
    pub fn solution(&self) -> &Solution {
        &self.evaluation.solution
    }

    /// 95 % interval of a value with this standard uncertainty.
    pub fn interval95(value: f64, std: f64) -> [f64; 2] {
        [value - NORMAL_95 * std, value + NORMAL_95 * std]
    }

    /// Condition number of the scaled Jacobian.
    pub fn condition(&self) -> f64 {
        match (self.singular_values.first(), self.singular_values.last()) {
            (Some(most), Some(least)) if *least > 0.0 => most / least,
            _ => f64::INFINITY,
        }
    }
}

/// Most fits under weights that are made anew. What new weights change falls by a factor of 100 from one to the next.
const REWEIGHTINGS: usize = 5;
/// Scaled step at which a fit ends whose weights are made anew afterwards; when new weights change less, the next are the last.
const COARSE: f64 = 1e-4;
/// Linearisations when the boundary is estimated.
const BOUNDARY_STEPS: usize = 40;
/// With an estimated boundary the fit ends when the steps of all parameters are twice in a row below this share of their
/// standard uncertainty. The kink of the law at zero opening lets Gauss-Newton on thousands of unknowns converge slowly only.
const BOUNDARY_SHARE: f64 = 1e-2;
/// Share of the decrease along the step that a trial has to reach (Armijo).
const ENOUGH: f64 = 1e-4;
/// Shortest part of a step that is tried.
const SHORTEST: f64 = 1e-3;
/// Stands in for the standard deviation of the noise (mm) where steps are compared with it and it is not known.
const UNKNOWN_SIGMA: f64 = 1e-4;

/// What a stage hands to the next.
struct Stage {
    z: Vec<f64>,
    status: FitStatus,
    reason: String,
    evaluations: usize,
    rescued: usize,
    history: Vec<Iteration>,
}

impl Stage {
    fn add(&mut self, end: End) {
        self.rescued += end.rescued();
        self.evaluations += end.evaluations;
        (self.z, self.status, self.reason) = (end.z, end.status, end.reason);
        self.history.extend(end.history);
    }
}

/// Fits the unknowns of `problem`.
///
/// # Errors
/// See [`FitError`]. Not converging is an outcome.
pub fn fit(problem: &Problem<'_>, options: &FitOptions) -> Result<Fit, FitError> {
    let unknowns = &problem.unknowns;
    let measured = &problem.joint.boundary;
    let noisy_boundary = !problem.observation.prescribed.is_empty();
    let mut weights = match options.weights {
        // Without boundary noise the inverse covariance does not depend on the parameters.
        WeightKind::Covariance if !noisy_boundary => {
            let n = problem.observation.instants.len();
            Weights::Inverse(InverseCovariance::new(&problem.noise, n, Vec::new()).map_err(no_texture)?)
        }
        kind => problem.diagonal_weights(kind),
    };
    let starts: Vec<Vec<f64>> = std::iter::once(unknowns.start()).chain(options.starts.iter().cloned()).collect();
    let weighted_again = options.weights == WeightKind::Covariance && noisy_boundary;
    let region = match weighted_again && starts.len() == 1 {
        true => TrustRegionOptions { step_tolerance: COARSE, ..options.region },
        false => options.region,
    };
    let ends: Vec<End> =
        starts.par_iter().map(|start| run(problem, measured, &weights, start, None, &region)).collect();
    let (best, starts) = compare(unknowns, &starts, &ends);
    let first = ends.into_iter().nth(best).expect("the best of the ends");
    if first.local.is_none() {
        return Err(FitError::NoStart { start: describe(unknowns, &unknowns.start()), reason: first.reason });
    }
    let nothing = (FitStatus::Stalled, String::new());
    let (status, reason) = nothing;
    let mut stage = Stage { z: Vec::new(), status, reason, evaluations: 0, rescued: 0, history: Vec::new() };
    stage.add(first);

    let mut boundary = measured.clone();
    let mut largest_correction = None;
    if weighted_again && stage.status == FitStatus::Converged {
        if options.estimate_boundary {
            let (corrected, largest) = estimate_boundary(problem, &mut stage, options)?;
            largest_correction = Some(largest);
            boundary = corrected;
            weights = full_weights(problem, &at(problem, &stage.z, &boundary)?)?;
        } else {
            weights = reweight(problem, &mut stage, options)?;
        }
    }

    let evaluation = at(problem, &stage.z, &boundary)?;
    let local = evaluation.local(&weights, &problem.noise);
    let statistics = Statistics::new(problem, &evaluation, &weights)?;
    let x = evaluation.x.clone();
    let slopes = unknowns.slopes(&x);
    let n = x.len();
    let mut constants = Vec::new();
    let covariance = match &statistics {
        None => None,
        Some(statistics) => {
            constants = problem.constant_effects(&evaluation, statistics, &options.constants, &boundary)?;
            let mut scaled = statistics.covariance.clone();
            for effect in &constants {
                let shift = Dense::from_fn(n, 1, |r, _| effect.scaled[r]);
                scaled.add(1.0, &shift.times(&Dense::from_fn(1, n, |_, c| effect.scaled[c])));
            }
            Some(Dense::from_fn(n, n, |r, c| slopes[r] * scaled[(r, c)] * slopes[c]))
        }
    };
    let std = |k: usize| covariance.as_ref().map(|c| c[(k, k)].max(0.0).sqrt());
    let by_refinement: Option<Vec<f64>> = match (&statistics, options.discretisation) {
        (_, Discretisation::Off) | (None, _) => None,
        (Some(statistics), _) => problem
            .refinement_shift(&evaluation, statistics, &boundary)
            .map(|shift| shift.iter().zip(&slopes).map(|(z, slope)| z * slope).collect()),
    };
    let interval = |value: f64, std: Option<f64>, discretisation: Option<f64>| {
        let more = discretisation.filter(|_| options.discretisation == Discretisation::Included).unwrap_or(0.0);
        std.map(|std| Fit::interval95(value, std.hypot(more)))
    };
    let correlation = covariance.as_ref().map(|covariance| correlation_of(covariance, statistics.as_ref()));
    let at_bound = |k: usize| {
        let [low, high] = unknowns.list()[k].bounds;
        x[k] <= low * (1.0 + 1e-9) || x[k] >= high * (1.0 - 1e-9)
    };
    let parameters: Vec<FittedParameter> = (unknowns.list().iter().enumerate())
        .map(|(k, unknown)| {
            let (std, discretisation) = (std(k), by_refinement.as_ref().map(|change| change[k]));
            FittedParameter {
                parameter: unknown.parameter,
                value: x[k],
                std,
                discretisation,
                interval95: interval(x[k], std, discretisation),
                start: unknown.start,
                bounds: unknown.bounds,
                at_bound: at_bound(k),
            }
        })
        .collect();
    let eigen = local.h.symmetric_eigen().ok_or(FitError::NotFinite)?;
    let singular_values: Vec<f64> = eigen.0.iter().rev().map(|v| v.max(0.0).sqrt()).collect();
    let verdict = correlation.as_ref().map(|correlation| {
        let names: Vec<&str> = parameters.iter().map(|p| p.parameter.name).collect();
        let relative: Vec<f64> = parameters.iter().map(|p| p.std.unwrap_or(0.0) / p.value.abs()).collect();
        verdict(&names, &relative, correlation, &eigen)
    });
    let mut history = stage.history;
    history.iter_mut().for_each(|iteration| iteration.z = unknowns.unscaled(&iteration.z));
    let law = unknowns.law_at(&x)?;
    Ok(Fit {
        derived: with_uncertainty(unknowns, &x, covariance.as_ref(), by_refinement.as_deref(), interval),
        parameters,
        values: law.values(),
        covariance,
        correlation,
        singular_values,
        omega: local.omega,
        status: stage.status,
        reason: stage.reason,
        evaluations: stage.evaluations,
        rescued: stage.rescued,
        history,
        starts,
        verdict,
        statistics,
        constants,
        evaluation,
        boundary,
        largest_correction,
    })
}

/// The parameters after one Gauss-Newton step from `x` under the weights of kind `weights`, the boundary as measured: where a
/// fit near `x` ends, to first order.
///
/// # Errors
/// See [`FitError`].
pub fn first_order(problem: &Problem<'_>, weights: WeightKind, x: &[f64]) -> Result<Vec<f64>, FitError> {
    let evaluation = problem.evaluate(x, &problem.joint.boundary)?.ok_or(FitError::Lost)?;
    let weights = match weights {
        WeightKind::Covariance => full_weights(problem, &evaluation)?,
        kind => problem.diagonal_weights(kind),
    };
    let local = evaluation.local(&weights, &problem.noise);
    let factor = local.h.cholesky().map_err(|_| FitError::NotFinite)?;
    let step = factor.solve(&Dense::from_fn(local.b.len(), 1, |k, _| local.b[k]));
    let z = problem.unknowns.scaled(x);
    Ok(problem.unknowns.unscaled(&z.iter().zip(step.column(0)).map(|(z, s)| z + s).collect::<Vec<_>>()))
}

fn no_texture(fault: NotPositiveDefinite) -> FitError {
    FitError::Covariance { row: fault.node }
}

fn describe(unknowns: &Unknowns, x: &[f64]) -> String {
    let of = |(unknown, x): (&super::unknowns::Unknown, &f64)| format!("{} = {x}", unknown.parameter.name);
    unknowns.list().iter().zip(x).map(of).collect::<Vec<_>>().join(", ")
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}

/// One start under fixed weights; `known` is what is known there.
fn run(
    problem: &Problem<'_>,
    boundary: &BoundaryHistory,
    weights: &Weights,
    start: &[f64],
    mut known: Option<Evaluation>,
    region: &TrustRegionOptions,
) -> End {
    let unknowns = &problem.unknowns;
    let [lower, upper] = unknowns.scaled_bounds();
    minimise(&unknowns.scaled(start), [&lower, &upper], region, |z| {
        let evaluation = match known.take() {
            Some(evaluation) => evaluation,
            None => problem.evaluate(&unknowns.unscaled(z), boundary).ok().flatten()?,
        };
        Some(evaluation.local(weights, &problem.noise)).filter(|local| local.omega.is_finite())
    })
}

/// The end to go on from: the lowest objective, converged ones first; and how the others compare with it.
fn compare(unknowns: &Unknowns, starts: &[Vec<f64>], ends: &[End]) -> (usize, Vec<StartEnd>) {
    let omega = |end: &End| end.local.as_ref().map_or(f64::INFINITY, |local| local.omega);
    let better = |a: usize, b: usize| {
        let key = |k: usize| (ends[k].status != FitStatus::Converged, omega(&ends[k]));
        // Ends that agree are one: the first of them is taken, whatever their last bits say.
        let same = ends[a].status == ends[b].status && distance(&ends[a].z, &ends[b].z) < 1e-7;
        !same && key(b) < key(a)
    };
    let best = (1..ends.len()).fold(0, |best, k| if better(best, k) { k } else { best });
    let of = |(start, end): (&Vec<f64>, &End)| StartEnd {
        start: start.clone(),
        end: unknowns.unscaled(&end.z),
        omega: end.local.as_ref().map(|local| local.omega),
        status: end.status,
        evaluations: end.evaluations,
        rescued: end.rescued(),
        distance: distance(&end.z, &ends[best].z),
    };
    (best, starts.iter().zip(ends).map(of).collect())
}

/// The ingredients at `z`, where there must be a solution: it was reached before.
fn at(problem: &Problem<'_>, z: &[f64], boundary: &BoundaryHistory) -> Result<Evaluation, FitError> {
    problem.evaluate(&problem.unknowns.unscaled(z), boundary)?.ok_or(FitError::Lost)
}

fn full_weights(problem: &Problem<'_>, evaluation: &Evaluation) -> Result<Weights, FitError> {
    let by_boundary = problem.by_boundary(evaluation)?;
    let n = problem.observation.instants.len();
    Ok(Weights::Inverse(InverseCovariance::new(&problem.noise, n, by_boundary).map_err(no_texture)?))
}

/// Fits under the inverse covariance made at the end of the fit before, until the parameters stand still; gives the weights.
fn reweight(problem: &Problem<'_>, stage: &mut Stage, options: &FitOptions) -> Result<Weights, FitError> {
    let measured = &problem.joint.boundary;
    let (mut coarse, mut round) = (true, 0);
    loop {
        round += 1;
        let evaluation = at(problem, &stage.z, measured)?;
        let weights = full_weights(problem, &evaluation)?;
        let step_tolerance = if coarse { COARSE } else { options.region.step_tolerance };
        let region = TrustRegionOptions { first_radius: 0.1, step_tolerance, ..options.region };
        let before = stage.z.clone();
        let start = evaluation.x.clone();
        stage.add(run(problem, measured, &weights, &start, Some(evaluation), &region));
        if !coarse || stage.status != FitStatus::Converged {
            return Ok(weights);
        }
        coarse = round < REWEIGHTINGS && distance(&before, &stage.z) > COARSE;
    }
}

/// Gauss-Newton on parameters and prescribed displacements together, the latter eliminated instant by instant. Gives the
/// displacements and their largest correction (mm).
fn estimate_boundary(
    problem: &Problem<'_>,
    stage: &mut Stage,
    options: &FitOptions,
) -> Result<(BoundaryHistory, f64), FitError> {
    let (joint, unknowns, observation) = (problem.joint, &problem.unknowns, &problem.observation);
    let prescribed = &joint.measured.prescribed;
    let given = problem.prescribed_as_measured();
    let mut corrections: Vec<Vec<f64>> = vec![vec![0.0; 2 * prescribed.len()]; observation.instants.len()];
    let [lower, upper] = unknowns.scaled_bounds();
    let boundary_of = |corrections: &[Vec<f64>]| {
        let mut values = given.clone();
        for (observed, correction) in observation.instants.iter().zip(corrections) {
            for (u, d) in values[observed.index].iter_mut().zip(correction.as_chunks::<2>().0) {
                *u = [u[0] + d[0], u[1] + d[1]];
            }
        }
        joint.measured.boundary(values)
    };
    let whole = InverseCovariance::new(&problem.noise, observation.instants.len(), Vec::new()).map_err(no_texture)?;
    let whole = Weights::Inverse(whole);
    // The corrections are residuals of the prescribed rows.
    let objective = |evaluation: &Evaluation| square(&whole, &problem.noise, &evaluation.residual());
    let largest = |list: &[Vec<f64>]| list.iter().flatten().fold(0.0_f64, |most, d| most.max(d.abs()));
    // While sigma is not known, the normal matrix lacks its square.
    let missing = problem.noise.sigma.map_or(UNKNOWN_SIGMA, |_| 1.0);
    let mut boundary = boundary_of(&corrections).map_err(FitError::Boundary)?;
    let mut evaluation = at(problem, &stage.z, &boundary)?;
    let mut omega = objective(&evaluation);
    let mut small_steps = 0;
    let mut share = f64::INFINITY;
    for _ in 0..BOUNDARY_STEPS {
        let weights = full_weights(problem, &evaluation)?;
        let Weights::Inverse(inverse) = &weights else { return Err(FitError::Lost) };
        let local = evaluation.local(&weights, &problem.noise);
        let below: Vec<f64> = lower.iter().zip(&stage.z).map(|(l, z)| (l - z).min(0.0)).collect();
        let above: Vec<f64> = upper.iter().zip(&stage.z).map(|(u, z)| (u - z).max(0.0)).collect();
        let region = StepRegion { lower: &below, upper: &above, radius: options.region.max_radius };
        let Some(s) = cone_step(&local.h, &local.b, &region) else { return Err(FitError::NotFinite) };
        share = share_of_std(&local.h, &s).map_or(f64::INFINITY, |share| share / missing);
        // The rest after the step: what the corrections of the boundary have to explain.
        let rest: Vec<Dense> = (evaluation.blocks.iter())
            .map(|block| {
                let left =
                    |r: usize, _: usize| block[(r, 0)] - (0..s.len()).map(|k| block[(r, k + 1)] * s[k]).sum::<f64>();
                Dense::from_fn(block.n_rows(), 1, left)
            })
            .collect();
        let more = inverse.boundary_corrections(&problem.noise.precision, &rest);
        let slope = 2.0 * (square(&weights, &problem.noise, &rest) - omega);
        // The kink of the law at zero opening makes the full step too long now and then.
        let mut length = 1.0;
        let moved = loop {
            let of = |k: usize| (stage.z[k] + length * s[k]).clamp(lower[k], upper[k]);
            let z: Vec<f64> = (0..s.len()).map(of).collect();
            let next = |(c, m): (&Vec<f64>, &Vec<f64>)| c.iter().zip(m).map(|(c, m)| c + length * m).collect();
            let trial_corrections: Vec<Vec<f64>> = corrections.iter().zip(&more).map(next).collect();
            let trial_boundary = boundary_of(&trial_corrections).map_err(FitError::Boundary)?;
            let trial = problem.evaluate(&problem.unknowns.unscaled(&z), &trial_boundary)?;
            stage.evaluations += 1;
            let trial_omega = trial.as_ref().map(objective);
            let accepted = trial_omega.is_some_and(|trial| trial <= omega + ENOUGH * length * slope);
            let rescued = trial.as_ref().is_some_and(|trial| trial.rescued);
            stage.rescued += usize::from(rescued);
            stage.history.push(Iteration { z: z.clone(), omega: trial_omega, radius: length, accepted, rescued });
            match (trial, trial_omega) {
                (Some(trial), Some(trial_omega)) if accepted => {
                    (stage.z, corrections, boundary, evaluation, omega) =
                        (z, trial_corrections, trial_boundary, trial, trial_omega);
                    break true;
                }
                _ if length < SHORTEST => break false,
                _ => length *= 0.5,
            }
        };
        // Nothing below: the objective has no lower neighbour that its digits tell apart.
        small_steps = if share < BOUNDARY_SHARE { small_steps + 1 } else { 0 };
        if small_steps > 1 || (share < BOUNDARY_SHARE && !moved) {
            stage.reason = format!("steps are {share:.1e} of the uncertainty, boundary displacements estimated");
            return Ok((boundary, largest(&corrections)));
        }
        if !moved {
            stage.status = FitStatus::Stalled;
            stage.reason = format!(
                "no step along the last direction ({share:.1e} of the uncertainty) lowers the objective, boundary \
                 displacements estimated"
            );
            return Ok((boundary, largest(&corrections)));
        }
    }
    stage.status = FitStatus::EvaluationLimit;
    stage.reason =
        format!("with estimated boundary displacements the last step was still {share:.1e} of the uncertainty");
    Ok((boundary, largest(&corrections)))
}

/// `r^T W r`.
fn square(weights: &Weights, noise: &Noise, r: &[Dense]) -> f64 {
    r.iter().zip(&weights.times(noise, r)).map(|(r, wr)| r.transposed_times(wr)[(0, 0)]).sum()
}

/// The largest component of the step `s` as a share of the standard uncertainty that the normal matrix `h` stands for.
fn share_of_std(h: &Dense, s: &[f64]) -> Option<f64> {
    let covariance = h.cholesky().ok()?.solve(&Dense::from_fn(s.len(), s.len(), |r, c| f64::from(u8::from(r == c))));
    let share = |k: usize| s[k].abs() / covariance[(k, k)].sqrt();
    Some((0..s.len()).map(share).fold(0.0, f64::max))
}

/// Correlation of the parameters. Without any noise (no variance at all) that which noise would give.
fn correlation_of(covariance: &Dense, statistics: Option<&Statistics>) -> Dense {
    let n = covariance.n_rows();
    let silent = (0..n).any(|k| covariance[(k, k)] <= 0.0 || covariance[(k, k)].is_nan());
    let of = match statistics {
        Some(statistics) if silent => &statistics.a,
        _ => covariance,
    };
    let entry = |r: usize, c: usize| {
        let value = of[(r, c)] / (of[(r, r)] * of[(c, c)]).sqrt();
        if r == c { 1.0 } else { value.clamp(-1.0, 1.0) }
    };
    Dense::from_fn(n, n, entry)
}

/// Derived quantities at `x`, with the uncertainty that the covariance of the parameters gives them.
fn with_uncertainty(
    unknowns: &Unknowns,
    x: &[f64],
    covariance: Option<&Dense>,
    by_refinement: Option<&[f64]>,
    interval: impl Fn(f64, Option<f64>, Option<f64>) -> Option<[f64; 2]>,
) -> Vec<FittedQuantity> {
    let at = |x: &[f64]| unknowns.law_at(x).map(|law| derived(&*law)).unwrap_or_default();
    let slopes: Vec<Vec<f64>> = (0..x.len())
        .map(|k| {
            let h = 1e-6 * x[k].abs().max(1e-12);
            let moved = |h: f64| {
                let mut x = x.to_vec();
                x[k] += h;
                at(&x)
            };
            moved(h).iter().zip(moved(-h)).map(|(more, less)| (more.value - less.value) / (2.0 * h)).collect()
        })
        .collect();
    let slope = |k: usize, q: usize| slopes[k].get(q).copied().unwrap_or(0.0);
    let std = |q: usize| {
        let covariance = covariance?;
        let slope = |k: usize| slope(k, q);
        let n = x.len();
        let variance: f64 = (0..n).map(|r| (0..n).map(|c| slope(r) * covariance[(r, c)] * slope(c)).sum::<f64>()).sum();
        Some(variance.max(0.0).sqrt())
    };
    let of = |(q, quantity): (usize, Derived)| {
        let discretisation =
            by_refinement.map(|change| change.iter().enumerate().map(|(k, change)| slope(k, q) * change).sum());
        let std = std(q);
        FittedQuantity { quantity, std, discretisation, interval95: interval(quantity.value, std, discretisation) }
    };
    at(x).into_iter().enumerate().map(of).collect()
}
