//! The fit: starts, weights, end, and what is known of the result.

use super::axes::Axes;
use super::bootstrap::Base;
use super::budget::{Budget, Ingredients, budget, interval95};
use super::constants::{ConstantEffect, ConstantKind};
use super::discretisation::Refinement;
use super::far_starts::{further_start, other_minima, several_minima};
use super::fitted::{FittedParameter, FittedQuantity, StartEnd};
use super::intervals::{IntervalBasis, settle};
use super::misfit::Misfit;
use super::objective::{Evaluation, Problem};
use super::options::{FitOptions, RotationCheck};
use super::plausibility::{Implausible, implausible_result};
use super::released::Released;
use super::released_width::ReleasedWidth;
use super::rotations::Rotations;
use super::stage::{COARSE, Stage, at, distance, full_weights, no_texture, reweight, run};
use super::statistics::Statistics;
use super::trust_region::{End, FitStatus, Iteration, TrustRegionOptions};
use super::unknowns::Unknowns;
use super::verdict::{Grounds, LARGEST_STD, Verdict, curve_alone};
use super::watch::Ended;
use super::weights::{InverseCovariance, Weights};
use super::{FitError, estimated_boundary::estimate_boundary};
use crate::io::case::{Discretisation, Intervals, WeightKind};
use crate::linalg::Dense;
use crate::mechanics::cohesive::{CohesiveLaw, LawLimit};
use crate::mechanics::{BoundaryHistory, Solution};
use rayon::prelude::*;

/// Distance of a limit of the law below which the fit has run against it.
const NEAR_LIMIT: f64 = 1e-4;

/// Times that a lower minimum is gone on from, plus one.
const LOOKS: usize = 4;
/// How much lower another minimum has to be, relative to the objective.
const LOWER: f64 = 1e-6;

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
    /// What the width of the specimen would be as an unknown; `None` without a load cell in the fit.
    pub width: Option<ReleasedWidth>,
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
    /// What finite rotations would change; `None` where they are finite, and where that was not asked for.
    pub rotations: Option<Rotations>,
    /// The objective's ingredients at the end.
    pub evaluation: Evaluation,
    /// The prescribed displacements of the end: as measured, or as estimated.
    pub boundary: BoundaryHistory,
    /// Largest correction of a prescribed displacement, mm; where they are estimated.
    pub largest_correction: Option<f64>,
    /// What ended the fit from outside, and what it is therefore without; `None` where nothing did.
    pub cut_short: Option<CutShort>,
    /// How far the objective allows to go, of a law with [several minima](CohesiveLaw::has_own_minima).
    pub(super) axes: Option<Axes>,
}

/// A fit that its limit of time, or a wish to stop, ended.
#[derive(Debug, Clone, PartialEq)]
pub struct CutShort {
    /// Which of them.
    pub ended: Ended,
    /// What was not computed.
    pub missing: Vec<&'static str>,
}

impl CutShort {
    /// In words.
    pub fn text(&self) -> String {
        let missing = match self.missing.as_slice() {
            [] => String::new(),
            list => format!("; not computed: {}", list.join(", ")),
        };
        format!("{}{missing}", self.ended.reason())
    }
}

impl Fit {
    /// The forward run at the end.
    pub fn solution(&self) -> &Solution {
        &self.evaluation.solution
    }

    /// Condition number of the scaled Jacobian.
    pub fn condition(&self) -> f64 {
        match (self.singular_values.first(), self.singular_values.last()) {
            (Some(most), Some(least)) if *least > 0.0 => most / least,
            _ => f64::INFINITY,
        }
    }
}

/// Fits the unknowns of `problem`.
///
/// # Errors
/// See [`FitError`]. Not converging is an outcome.
pub fn fit(problem: &Problem<'_>, options: &FitOptions) -> Result<Fit, FitError> {
    let looks = if options.doubt && options.other_minima && options.intervals != Intervals::Linear { LOOKS } else { 0 };
    fit_looking(problem, options, looks)
}

/// Fits them, and goes on from a lower minimum `looks` times, 0 for never looking for one.
fn fit_looking(problem: &Problem<'_>, options: &FitOptions, looks: usize) -> Result<Fit, FitError> {
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
            weights = reweight(problem, &mut stage, &options.region)?;
        }
    }

    let evaluation = known.map_or_else(|| at(problem, &stage.z, &boundary), Ok)?;
    let local = evaluation.local(&weights, &problem.noise);
    let statistics = Statistics::new(problem, &evaluation, &weights)?;
    let all_data = || matches!(weights, Weights::Inverse(_)).then_some(problem.observation.n_data() as f64);
    let expected = statistics.as_ref().map(|statistics| statistics.expected_omega).or_else(all_data);
    if let Some(start) = further_start(problem, options, &weights, (stage.status, local.omega, expected)) {
        let options = FitOptions { starts: vec![unknowns.start()], ..options.clone() };
        let mut found = fit_looking(&problem.with_unknowns(unknowns.starting_at(&start)?), &options, looks)?;
        found.parameters.iter_mut().zip(unknowns.list()).for_each(|(p, unknown)| p.start = unknown.start);
        return Ok(found);
    }
    let is_end = looks > 0 && stage.status == FitStatus::Converged && statistics.is_some();
    let minima = match is_end && unknowns.law().has_own_minima() {
        true => {
            problem.watch.begins("other minima");
            other_minima(problem, options, &weights, &boundary, &stage.z)
        }
        false => Vec::new(),
    };
    if let Some((lower, omega)) = minima.first()
        && *omega < local.omega * (1.0 - LOWER)
        && looks > 1
    {
        let there = problem.with_unknowns(unknowns.starting_at(&unknowns.unscaled(lower))?);
        let options = FitOptions { starts: vec![unknowns.start()], ..options.clone() };
        if let Ok(mut found) = fit_looking(&there, &options, looks - 1)
            && found.status == FitStatus::Converged
            && found.omega < local.omega
        {
            found.parameters.iter_mut().zip(unknowns.list()).for_each(|(p, unknown)| p.start = unknown.start);
            return Ok(found);
        }
    }
    let x = evaluation.x.clone();
    let slopes = unknowns.slopes(&x);
    let constants = match &statistics {
        Some(statistics) => problem.constant_effects(&evaluation, statistics, &options.constants),
        None => Vec::new(),
    };
    let watch = &problem.watch;
    let mut missing = Vec::new();
    watch.begins("element size");
    let refined = match options.discretisation {
        Discretisation::Off => None,
        _ => problem.refined(&evaluation, &boundary),
    };
    if options.discretisation != Discretisation::Off && refined.is_none() && watch.ended().is_some() {
        missing.push("the effect of the element size");
    }
    let refinement = statistics.as_ref().zip(refined.as_ref()).map(|(statistics, refined)| Refinement {
        scaled: statistics.shift(&refined.change),
        jumps: refined.jumps.clone(),
        included: options.discretisation == Discretisation::Included,
    });
    let rotations = match &statistics {
        Some(statistics)
            if options.doubt
                && options.rotations != RotationCheck::Off
                && problem.is_small()
                && watch.ended().is_none() =>
        {
            watch.begins("finite rotations");
            let turned = problem.turned(&evaluation, &boundary);
            Some(Rotations::new(turned.map(|change| statistics.shift(&change)), &slopes))
        }
        _ => None,
    }
    .filter(|rotations| rotations.change.is_some() || watch.ended().is_none());
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
    watch.begins("intervals");
    let intervals = statistics.as_ref().map(|statistics| {
        let follows_data = weighted_again;
        let (evaluation, weights, boundary) = (&evaluation, &weights, &boundary);
        let base = Base { problem, evaluation, statistics, weights, boundary, follows_data };
        let mut settled = |wanted| settle(&base, wanted, options.bootstrap, &budget, &mut parameters, &mut derived);
        let wanted = if watch.ended().is_some() { Intervals::Linear } else { options.intervals };
        let basis = settled(wanted);
        // What was computed in part says that fits fail, which is not what happened.
        let basis = if watch.ended().is_some() { settled(Intervals::Linear) } else { basis };
        if options.intervals != Intervals::Linear && watch.ended().is_some() {
            missing.push("whether linear intervals are good enough");
        }
        basis
    });
    // What the objective allows about every minimum, of a law with several.
    let axes = match &statistics {
        Some(statistics) if is_end && unknowns.law().has_own_minima() && watch.ended().is_none() => {
            Axes::new(problem, (&evaluation, &boundary), statistics, options, &minima)?
        }
        _ => None,
    };
    if let Some(axes) = &axes {
        hold(axes, unknowns, &budget, &mut parameters, &mut derived);
    }
    let eigen = local.h.symmetric_eigen().ok_or(FitError::NotFinite)?;
    let singular_values: Vec<f64> = eigen.0.iter().rev().map(|v| v.max(0.0).sqrt()).collect();
    let change = refined.as_ref().map(|refined| refined.change.as_slice());
    let (misfit, released) = match &statistics {
        // Of a point that is no minimum they would tell that.
        Some(statistics) if options.doubt && !stage.status.cut_short() => {
            watch.begins("misfit");
            let misfit = problem.misfit(&evaluation, &weights, statistics, change, &constants)?;
            watch.begins("prescribed parameters as unknowns");
            let released = match options.release {
                true => problem.released(&evaluation, &weights, statistics, &boundary)?,
                false => None,
            };
            let ended = options.release && watch.ended().is_some();
            missing.extend(ended.then_some("what the prescribed parameters would be as unknowns"));
            (Some(misfit), released.filter(|_| !ended))
        }
        Some(_) if options.doubt => {
            missing.push("the misfit test");
            (None, None)
        }
        _ => (None, None),
    };
    let width_std = options.constants.iter().find(|constant| constant.kind == ConstantKind::Width);
    let width_std = width_std.map_or(0.0, |constant| constant.std);
    let width =
        misfit.as_ref().and_then(|_| problem.width_as_unknown(&evaluation, &weights, change, &constants, width_std));
    let cut_short = watch.ended().map(|ended| CutShort { ended, missing });
    let unfinished = unfinished(stage.status, cut_short.as_ref(), unknowns, &x);
    // Whether the data tell the parameters apart is a question to the noise: one wrong constant moves all of them together.
    let of_noise = statistics.as_ref().map(|statistics| correlation_of(&statistics.covariance, Some(statistics)));
    let noise = statistics.as_ref().map(|statistics| &statistics.covariance);
    let missing = if options.doubt { problem.missing_mode(&evaluation, &local.h, noise, LARGEST_STD) } else { None };
    let verdict = match &of_noise {
        None => Verdict::singular(&parameters, unfinished, missing.as_ref()),
        Some(correlation) => {
            let prescribed =
                released.as_ref().map_or(Vec::new(), |released| problem.prescribed_std(released, &options.constants));
            let grounds = Grounds {
                correlation,
                misfit: misfit.as_ref(),
                released: released.as_ref(),
                width: width.as_ref(),
                released_std: &prescribed,
                intervals: intervals.as_ref(),
                noise_ratio: problem.noise.ratio,
                given: problem.given(),
                unfinished,
                missing,
            };
            Verdict::new(&parameters, &grounds)
        }
    };
    let judged = rotations.as_ref().filter(|_| options.rotations == RotationCheck::Judged);
    let mut verdict = verdict.with_rotations(judged, &parameters);
    if problem.observation.nodes.is_empty() && statistics.is_some() {
        verdict.sentences.push(curve_alone(&parameters, &derived));
    }
    if let Some(others) = axes.as_ref().map(Axes::n_others).filter(|others| *others > 0) {
        verdict.sentences.push(several_minima(unknowns.law().name(), others));
    }
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
        width,
        verdict,
        statistics,
        constants,
        budget,
        implausible: implausible_result(problem, &*law),
        intervals,
        refinement,
        rotations,
        evaluation,
        boundary,
        largest_correction,
        cut_short,
        axes,
    })
}

/// Widens the intervals to what the objective allows about every minimum, constants and bias as before.
fn hold(
    axes: &Axes,
    unknowns: &Unknowns,
    budget: &Budget,
    parameters: &mut [FittedParameter],
    derived: &mut [FittedQuantity],
) {
    let ends = |value: f64, bias: Option<f64>, others: f64, here: [Option<f64>; 2], allowed: Vec<f64>| {
        let reach = |sign: f64| allowed.iter().map(|there| sign * (there - value)).fold(0.0, f64::max);
        let wider = interval95(value, [Some(reach(-1.0)), Some(reach(1.0))], bias.unwrap_or(0.0), others);
        let outer = |side: usize, of: fn(f64, f64) -> f64| here[side].zip(wider[side]).map(|(a, b)| of(a, b));
        [outer(0, f64::min), outer(1, f64::max)]
    };
    for (k, p) in parameters.iter_mut().enumerate() {
        let index = unknowns.list()[k].index;
        let allowed = axes.allowed().iter().map(|law| law.values()[index]).collect();
        p.set_ends(ends(p.value, p.bias, budget.parameter(k).others, p.ends95, allowed));
    }
    for (k, q) in derived.iter_mut().enumerate() {
        let value = |law: &dyn CohesiveLaw| super::derived(law).get(k).map(|quantity| quantity.value);
        let allowed = axes.allowed().iter().filter_map(|law| value(&**law)).collect();
        q.set_ends(ends(q.quantity.value, q.bias, budget.quantity(k).others, q.ends95, allowed));
    }
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

/// Why a fit is not at its end, a sentence each.
pub(super) fn unfinished(
    status: FitStatus,
    cut_short: Option<&CutShort>,
    unknowns: &Unknowns,
    x: &[f64],
) -> Vec<String> {
    let mut reasons = match (status, cut_short) {
        (FitStatus::Converged, None) => Vec::new(),
        (FitStatus::Converged, Some(cut)) => vec![format!("the fit converged, but {}", cut.text())],
        (_, Some(cut)) => vec![format!("the fit did not converge: {}; the values are the best so far", cut.text())],
        (status, None) => {
            vec![format!("the fit did not converge ({}): the values are the best so far", status.name())]
        }
    };
    reasons.extend(at_limits(unknowns, x));
    reasons
}

/// What the law does not allow beyond `x`, where the fit has run against it, a sentence each.
fn at_limits(unknowns: &Unknowns, x: &[f64]) -> Vec<String> {
    let near = |limit: &LawLimit| limit.distance < NEAR_LIMIT;
    let in_words = |limit: LawLimit| {
        format!(
            "the fit ended at a limit of the law '{}' ({}), where its intervals mean little; prescribe a parameter \
             or take another law",
            unknowns.law().name(),
            limit.what
        )
    };
    unknowns.limits(x).into_iter().filter(near).map(in_words).collect()
}

pub(super) fn describe(unknowns: &Unknowns, x: &[f64]) -> String {
    let named = |(unknown, x): (&super::unknowns::Unknown, &f64)| format!("{} = {x}", unknown.parameter.name);
    unknowns.list().iter().zip(x).map(named).collect::<Vec<_>>().join(", ")
}

/// The end to go on from: the lowest objective, converged ones first; and how the others compare with it.
pub(super) fn compare(unknowns: &Unknowns, starts: &[Vec<f64>], ends: &[End]) -> (usize, Vec<StartEnd>) {
    let omega = |end: &End| end.local.as_ref().map_or(f64::INFINITY, |local| local.omega);
    let better = |a: usize, b: usize| {
        let key = |k: usize| (ends[k].status != FitStatus::Converged, omega(&ends[k]));
        // Ends that agree are one: the first of them is taken, whatever their last bits say.
        let same = ends[a].status == ends[b].status && distance(&ends[a].z, &ends[b].z) < 1e-7;
        !same && key(b) < key(a)
    };
    let best = (1..ends.len()).fold(0, |best, k| if better(best, k) { k } else { best });
    let end_of = |(start, end): (&Vec<f64>, &End)| StartEnd {
        start: start.clone(),
        end: unknowns.unscaled(&end.z),
        omega: end.local.as_ref().map(|local| local.omega),
        status: end.status,
        evaluations: end.evaluations,
        rescued: end.rescued(),
        distance: distance(&end.z, &ends[best].z),
    };
    (best, starts.iter().zip(ends).map(end_of).collect())
}

/// Correlation of the parameters. Without any noise (no variance at all) that which noise would give.
pub(super) fn correlation_of(covariance: &Dense, statistics: Option<&Statistics>) -> Dense {
    let n = covariance.n_rows();
    let silent = (0..n).any(|k| covariance[(k, k)] <= 0.0 || covariance[(k, k)].is_nan());
    let matrix = match statistics {
        Some(statistics) if silent => &statistics.a,
        _ => covariance,
    };
    let entry = |r: usize, c: usize| {
        let value = matrix[(r, c)] / (matrix[(r, r)] * matrix[(c, c)]).sqrt();
        if r == c { 1.0 } else { value.clamp(-1.0, 1.0) }
    };
    Dense::from_fn(n, n, entry)
}
