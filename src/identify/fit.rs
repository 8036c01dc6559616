//! The fit: starts, weights, end, and what is known of the result.

use super::bootstrap::Base;
use super::budget::{Budget, Ingredients, budget};
use super::constants::{Constant, ConstantEffect};
use super::derived::Derived;
use super::discretisation::{Discretisation, Refinement};
use super::intervals::{IntervalBasis, Intervals, settle};
use super::misfit::Misfit;
use super::objective::{Evaluation, Problem};
use super::plausibility::{Implausible, implausible_result};
use super::released::Released;
use super::statistics::Statistics;
use super::trust_region::{End, FitStatus, Iteration, TrustRegionOptions, minimise};
use super::unknowns::Unknowns;
use super::verdict::{Grounds, Verdict};
use super::weights::{InverseCovariance, WeightKind, Weights};
use super::{FitError, estimated_boundary::estimate_boundary};
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
    /// Model constants; those that are not named are exact.
    pub constants: Vec<Constant>,
    /// What becomes of the effect of the element size.
    pub discretisation: Discretisation,
    /// Which intervals are wanted.
    pub intervals: Intervals,
    /// Draws of the bootstrap that goes with intervals of the profile likelihood; 0 for none, `None` for as many as are good.
    pub bootstrap: Option<usize>,
    /// Whether the result is doubted: tested for misfit, and prescribed parameters tried as unknowns. Fits that are parts of
    /// something larger (rows of a sweep, draws) do without.
    pub doubt: bool,
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
            intervals: Intervals::Auto,
            bootstrap: None,
            doubt: true,
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
    /// The part of the noise alone.
    pub std_noise: Option<f64>,
    /// Its change if the elements were half as large.
    pub discretisation: Option<f64>,
    /// 95 % interval: the root of the sum of all lines of the budget, extended by the bias, see [`super::interval95`]; `None`
    /// where it has not two ends.
    pub interval95: Option<[f64; 2]>,
    /// Its ends, each for itself: `None` where the data do not bound the parameter on that side.
    pub ends95: [Option<f64>; 2],
    /// What noise shifts the value by on the average (found less true), through kinks and plasticity; the interval is extended
    /// by it, the value is not moved. `None` where it was not looked for.
    pub bias: Option<f64>,
    /// Standard uncertainty of the bias; `None` where one pair of draws told it.
    pub bias_std: Option<f64>,
    /// Standard deviation of the bootstrap, to be held against `std`; `None` without one.
    pub std_bootstrap: Option<f64>,
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
    /// Its standard uncertainty, from noise and uncertain constants.
    pub std: Option<f64>,
    /// The part of the noise alone.
    pub std_noise: Option<f64>,
    /// Its change if the elements were half as large.
    pub discretisation: Option<f64>,
    /// 95 % interval, as that of a parameter.
    pub interval95: Option<[f64; 2]>,
    /// Its ends, each for itself.
    pub ends95: [Option<f64>; 2],
    /// What noise shifts it by on the average, as of a parameter.
    pub bias: Option<f64>,
}

impl FittedParameter {
    pub(super) fn set_ends(&mut self, ends: [Option<f64>; 2]) {
        (self.ends95, self.interval95) = (ends, both(ends));
    }
}

impl FittedQuantity {
    pub(super) fn set_ends(&mut self, ends: [Option<f64>; 2]) {
        (self.ends95, self.interval95) = (ends, both(ends));
    }
}

fn both(ends: [Option<f64>; 2]) -> Option<[f64; 2]> {
    Some([ends[0]?, ends[1]?])
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
    /// Whether the data contradict the model; `None` without covariance.
    pub misfit: Option<Misfit>,
    /// What the prescribed parameters of the law would be as unknowns; `None` where there are none.
    pub released: Option<Released>,
    /// What it all comes to.
    pub verdict: Verdict,
    /// What noise does; `None` without covariance.
    pub statistics: Option<Statistics>,
    /// What each uncertain constant does to the parameters.
    pub constants: Vec<ConstantEffect>,
    /// What noise, each constant and the size of the elements add to the intervals; no lines without covariance.
    pub budget: Budget,
    /// Values of the result that hardly anything has.
    pub implausible: Vec<Implausible>,
    /// What the intervals rest on: linear theory or the profile likelihood, and a bootstrap; `None` without covariance.
    pub intervals: Option<IntervalBasis>,
    /// What elements half as large would change; `None` where that was not asked for or could not be computed.
    pub refinement: Option<Refinement>,
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

    /// Standard uncertainty of a parameter relative to its value, with everything that its interval holds; infinite where that
    /// has not two ends.
    pub fn relative_std(parameter: &FittedParameter) -> f64 {
        let std = parameter.interval95.map_or(f64::INFINITY, |[low, high]| (high - low) / (2.0 * NORMAL_95));
        if parameter.value == 0.0 && std > 0.0 {
            f64::INFINITY
        } else {
            std / parameter.value.abs().max(f64::MIN_POSITIVE)
        }
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

/// What a stage hands to the next.
pub(super) struct Stage {
    pub z: Vec<f64>,
    pub status: FitStatus,
    pub reason: String,
    pub evaluations: usize,
    pub rescued: usize,
    pub history: Vec<Iteration>,
}

impl Stage {
    fn of(end: End) -> Self {
        let (rescued, End { z, status, reason, evaluations, history, .. }) = (end.rescued(), end);
        Self { z, status, reason, evaluations, rescued, history }
    }

    /// Number of the stage that comes after those in the history.
    pub fn next_number(&self) -> usize {
        self.history.last().map_or(1, |iteration| iteration.stage + 1)
    }

    fn add(&mut self, mut end: End) {
        let number = self.next_number();
        end.history.iter_mut().for_each(|iteration| iteration.stage = number);
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
    let mut stage = Stage::of(first);

    let mut boundary = measured.clone();
    let (mut largest_correction, mut known) = (None, None);
    if weighted_again && stage.status == FitStatus::Converged {
        if options.estimate_boundary {
            let end = estimate_boundary(problem, &mut stage, options)?;
            (boundary, weights) = (end.boundary, end.weights);
            (largest_correction, known) = (Some(end.largest_correction), Some(end.evaluation));
        } else {
            weights = reweight(problem, &mut stage, options)?;
        }
    }

    let evaluation = known.map_or_else(|| at(problem, &stage.z, &boundary), Ok)?;
    let local = evaluation.local(&weights, &problem.noise);
    let statistics = Statistics::new(problem, &evaluation, &weights)?;
    let x = evaluation.x.clone();
    let slopes = unknowns.slopes(&x);
    let constants = match &statistics {
        Some(statistics) => problem.constant_effects(&evaluation, statistics, &options.constants),
        None => Vec::new(),
    };
    let refined = match options.discretisation {
        Discretisation::Off => None,
        _ => problem.refined(&evaluation, &boundary),
    };
    let refinement = statistics.as_ref().zip(refined.as_ref()).map(|(statistics, refined)| Refinement {
        scaled: statistics.shift(&refined.change),
        jumps: refined.jumps.clone(),
        included: options.discretisation == Discretisation::Included,
    });
    let by_refinement: Option<Vec<f64>> =
        refinement.as_ref().map(|finer| finer.scaled.iter().zip(&slopes).map(|(z, slope)| z * slope).collect());
    let (budget, quantities, covariance) = budget(
        problem,
        &Ingredients {
            x: &x,
            statistics: statistics.as_ref(),
            constants: &options.constants,
            effects: &constants,
            by_refinement: by_refinement.as_deref(),
            discretisation: options.discretisation,
        },
    );
    let known = statistics.is_some();
    let correlation = covariance.as_ref().map(|covariance| correlation_of(covariance, statistics.as_ref()));
    let at_bound = |k: usize| {
        let [low, high] = unknowns.list()[k].bounds;
        x[k] <= low * (1.0 + 1e-9) || x[k] >= high * (1.0 - 1e-9)
    };
    let mut parameters: Vec<FittedParameter> = (unknowns.list().iter().enumerate())
        .map(|(k, unknown)| {
            let parts = budget.parameter(k);
            FittedParameter {
                parameter: unknown.parameter,
                value: x[k],
                std: known.then_some(parts.std),
                std_noise: known.then_some(parts.noise),
                discretisation: by_refinement.as_ref().map(|change| change[k]),
                interval95: None,
                ends95: [None; 2],
                bias: None,
                bias_std: None,
                std_bootstrap: None,
                start: unknown.start,
                bounds: unknown.bounds,
                at_bound: at_bound(k),
            }
        })
        .collect();
    let mut derived: Vec<FittedQuantity> = (quantities.into_iter().enumerate())
        .map(|(q, quantity)| {
            let parts = budget.quantity(q);
            FittedQuantity {
                quantity,
                std: known.then_some(parts.std),
                std_noise: known.then_some(parts.noise),
                discretisation: by_refinement.as_ref().and_then(|_| budget.lines.last()?.derived.get(q).copied()),
                interval95: None,
                ends95: [None; 2],
                bias: None,
            }
        })
        .collect();
    let intervals = statistics.as_ref().map(|statistics| {
        let follows_data = weighted_again;
        let (evaluation, weights, boundary) = (&evaluation, &weights, &boundary);
        let base = Base { problem, evaluation, statistics, weights, boundary, follows_data };
        settle(&base, options.intervals, options.bootstrap, &budget, &mut parameters, &mut derived)
    });
    let eigen = local.h.symmetric_eigen().ok_or(FitError::NotFinite)?;
    let singular_values: Vec<f64> = eigen.0.iter().rev().map(|v| v.max(0.0).sqrt()).collect();
    let change = refined.as_ref().map(|refined| refined.change.as_slice());
    let (misfit, released) = match &statistics {
        Some(statistics) if options.doubt => (
            Some(problem.misfit(&evaluation, &weights, statistics, change, &constants)?),
            problem.released(&evaluation, &weights, statistics, &boundary)?,
        ),
        _ => (None, None),
    };
    // Whether the data tell the parameters apart is a question to the noise: one wrong constant moves all of them together.
    let of_noise = statistics.as_ref().map(|statistics| correlation_of(&statistics.covariance, Some(statistics)));
    let verdict = match &of_noise {
        None => Verdict::singular(&parameters),
        Some(correlation) => {
            let prescribed =
                released.as_ref().map_or(Vec::new(), |released| problem.prescribed_std(released, &options.constants));
            let grounds = Grounds {
                correlation,
                misfit: misfit.as_ref(),
                released: released.as_ref(),
                released_std: &prescribed,
                intervals: intervals.as_ref(),
                noise_ratio: problem.noise.ratio,
                given: problem.given(),
            };
            Verdict::new(&parameters, &grounds)
        }
    };
    let mut history = stage.history;
    history.iter_mut().for_each(|iteration| iteration.z = unknowns.unscaled(&iteration.z));
    let law = unknowns.law_at(&x)?;
    Ok(Fit {
        derived,
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
        misfit,
        released,
        verdict,
        statistics,
        constants,
        budget,
        implausible: implausible_result(problem, &*law),
        intervals,
        refinement,
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

pub(super) fn no_texture(fault: NotPositiveDefinite) -> FitError {
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
pub(super) fn run(
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
pub(super) fn at(problem: &Problem<'_>, z: &[f64], boundary: &BoundaryHistory) -> Result<Evaluation, FitError> {
    problem.evaluate(&problem.unknowns.unscaled(z), boundary)?.ok_or(FitError::Lost)
}

pub(super) fn full_weights(problem: &Problem<'_>, evaluation: &Evaluation) -> Result<Weights, FitError> {
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
