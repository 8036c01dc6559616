//! The fit: starts, weights, end, and what is known of the result.

use crate::identify::doubt::verdict::curve_alone;
use crate::identify::objective::estimated_boundary::estimate_boundary;
use crate::identify::solve::far_starts::{further_start, several_minima};
use crate::identify::solve::stage::{at, distance, reweight, run};
use crate::identify::{
    Axes, Base, Budget, COARSE, ConstantEffect, ConstantKind, End, Ended, Evaluation, FitError, FitOptions, FitStatus,
    Fitted, FittedParameter, FittedQuantity, Grounds, Ingredients, IntervalBasis, Iteration, LARGEST_STD, Local,
    Misfit, Problem, Refined, Refinement, Released, ReleasedWidth, Rotations, Stage, StartEnd, Statistics,
    ThicknessAlong, TrustRegionOptions, Unknown, Unknowns, Verdict, Weights, assess, extrapolated, full_weights,
    furthest, implausible_result, interval95, other_minima, settle,
};
use crate::io::case::{Discretisation, Intervals, WeightKind};
use crate::linalg::Dense;
use crate::mechanics::cohesive::{CohesiveLaw, Jump, LawLimit};
use crate::mechanics::{BoundaryHistory, Solution};
use crate::remark::Remark;
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
    /// How far the joint went: the jump, over pairs and instants, on which the law has done the most work.
    pub furthest: Option<Jump>,
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
    /// The thickness along the joint as an unknown.
    pub along: Option<ThicknessAlong>,
    /// What it all comes to.
    pub verdict: Verdict,
    /// What noise does; `None` without covariance.
    pub statistics: Option<Statistics>,
    /// What each uncertain constant does to the parameters.
    pub constants: Vec<ConstantEffect>,
    /// What noise, each constant and the size of the elements add to the intervals; no lines without covariance.
    pub budget: Budget,
    /// Values of the result that hardly anything has.
    pub remarks: Vec<Remark>,
    /// What the intervals rest on: linear theory or the profile likelihood, and a bootstrap; `None` without
    /// covariance.
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
    pub(crate) axes: Option<Axes>,
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
    let end = Minimum::find(problem, options)?;
    if let Some(start) = end.further_start(problem, options) {
        return fit_from(problem, unknowns.starting_at(&start)?, options, looks);
    }
    let is_end = looks > 0 && end.stage.status == FitStatus::Converged && end.statistics.is_some();
    if !(is_end && unknowns.law().has_own_minima()) {
        return appraise(problem, options, end, None);
    }
    problem.watch.begins("other minima");
    let minima = other_minima(problem, options, &end.weights, &end.boundary, &end.stage.z);
    if let Some((lower, omega)) = minima.first()
        && *omega < end.local.omega * (1.0 - LOWER)
        && looks > 1
    {
        let there = unknowns.starting_at(&unknowns.unscaled(lower))?;
        if let Ok(fit) = fit_from(problem, there, options, looks - 1)
            && fit.status == FitStatus::Converged
            && fit.omega < end.local.omega
        {
            return Ok(fit);
        }
    }
    appraise(problem, options, end, Some(&minima))
}

/// Fits them from `there` on, as if the start of `problem` had led there.
fn fit_from(problem: &Problem<'_>, there: Unknowns, options: &FitOptions, looks: usize) -> Result<Fit, FitError> {
    let unknowns = &problem.unknowns;
    let options = FitOptions { starts: vec![unknowns.start()], direct: None, ..options.clone() };
    let mut fit = fit_looking(&problem.with_unknowns(there), &options, looks)?;
    fit.parameters.iter_mut().zip(unknowns.list()).for_each(|(p, unknown)| p.start = unknown.start);
    Ok(fit)
}

/// Where the search for the least objective ended, and what the objective is like there.
struct Minimum {
    stage: Stage,
    starts: Vec<StartEnd>,
    weights: Weights,
    /// Whether the weights (or the border) are made again from the data.
    follows_data: bool,
    boundary: BoundaryHistory,
    largest_correction: Option<f64>,
    evaluation: Evaluation,
    local: Local,
    statistics: Option<Statistics>,
}

impl Minimum {
    /// Searches from every start, and on from the best end under weights that are made there.
    fn find(problem: &Problem<'_>, options: &FitOptions) -> Result<Self, FitError> {
        let unknowns = &problem.unknowns;
        let measured = &problem.border.boundary;
        let noisy_boundary = !problem.observation.prescribed.is_empty();
        let mut weights = problem.first_weights(options.weights)?;
        let starts = options.starts_of(unknowns);
        let follows_data = options.weights == WeightKind::Covariance && noisy_boundary;
        let region = match follows_data && starts.len() == 1 {
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
        if follows_data && stage.status == FitStatus::Converged {
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
        Ok(Self { stage, starts, weights, follows_data, boundary, largest_correction, evaluation, local, statistics })
    }

    /// See [`further_start`].
    fn further_start(&self, problem: &Problem<'_>, options: &FitOptions) -> Option<Vec<f64>> {
        let all_data = || matches!(self.weights, Weights::Inverse(_)).then_some(problem.n_data() as f64);
        let expected = self.statistics.as_ref().map(|statistics| statistics.expected_omega).or_else(all_data);
        further_start(problem, options, &self.weights, (self.stage.status, self.local.omega, expected))
    }
}

/// Finds what is known of a result, one thing after the other, until something ends the fit from outside.
struct Appraisal<'a> {
    problem: &'a Problem<'a>,
    options: &'a FitOptions,
    end: &'a Minimum,
    /// What that left out.
    missing: Vec<&'static str>,
    /// How far the joint went.
    furthest: Option<Jump>,
}

/// Whether the data contradict the model, as far as that is tested.
#[derive(Default)]
struct Doubts {
    misfit: Option<Misfit>,
    released: Option<Released>,
    width: Option<ReleasedWidth>,
    along: Option<ThicknessAlong>,
}

impl Appraisal<'_> {
    /// Computes what elements half as large would change.
    fn refine(&mut self) -> Option<Refined> {
        let watch = &self.problem.watch;
        watch.begins("element size");
        if self.options.discretisation == Discretisation::Off {
            return None;
        }
        let refined = self.problem.refine(&self.end.evaluation, &self.end.boundary);
        if refined.is_none() && watch.ended().is_some() {
            self.missing.push("the effect of the element size");
        }
        refined
    }

    /// Computes what finite rotations would change, where that is asked for.
    fn turn(&self, slopes: &[f64]) -> Option<Rotations> {
        let Self { problem, options, end, .. } = self;
        let statistics = end.statistics.as_ref()?;
        let wanted = options.doubt && options.judge_rotations && problem.is_small();
        if !wanted || problem.watch.ended().is_some() {
            return None;
        }
        problem.watch.begins("finite rotations");
        let turned = problem.turn(&end.evaluation, &end.boundary);
        let rotations = Rotations::new(turned.map(|change| statistics.shift(&change)), slopes);
        Some(rotations).filter(|rotations| rotations.change.is_some() || problem.watch.ended().is_none())
    }

    /// Gives parameters and quantities their intervals.
    fn settle_intervals(
        &mut self,
        budget: &Budget,
        parameters: &mut [FittedParameter],
        derived: &mut [FittedQuantity],
    ) -> Option<IntervalBasis> {
        let Self { problem, options, end, .. } = *self;
        let watch = &problem.watch;
        watch.begins("intervals");
        let Minimum { evaluation, weights, boundary, follows_data, .. } = end;
        let statistics = end.statistics.as_ref()?;
        let follows_data = *follows_data;
        let base = Base { problem, evaluation, statistics, weights, boundary, follows_data, furthest: self.furthest };
        let mut settle_as = |wanted| settle(&base, wanted, options.bootstrap, budget, parameters, derived);
        let basis = settle_as(if watch.ended().is_some() { Intervals::Linear } else { options.intervals });
        // What was computed in part says that fits fail, which is not what happened.
        let basis = if watch.ended().is_some() { settle_as(Intervals::Linear) } else { basis };
        if options.intervals != Intervals::Linear && watch.ended().is_some() {
            self.missing.push("whether linear intervals are good enough");
        }
        Some(basis)
    }

    /// Tests whether the data contradict the model; `change` is what elements half as large change of the measured
    /// rows.
    fn doubt(&mut self, change: Option<&[Dense]>, constants: &[ConstantEffect]) -> Result<Doubts, FitError> {
        let Self { problem, options, end: Minimum { evaluation, weights, boundary, .. }, .. } = *self;
        let Some(statistics) = self.end.statistics.as_ref().filter(|_| options.doubt) else {
            return Ok(Doubts::default());
        };
        // Of a point that is no minimum the tests would tell that.
        if self.end.stage.status.cut_short() {
            self.missing.push("the misfit test");
            return Ok(Doubts::default());
        }
        let watch = &problem.watch;
        watch.begins("misfit");
        let misfit = problem.misfit(evaluation, weights, statistics, change, constants)?;
        watch.begins("prescribed parameters as unknowns");
        let released = match options.release {
            true => problem.release(evaluation, weights, statistics, boundary)?,
            false => None,
        };
        let ended = options.release && watch.ended().is_some();
        self.missing.extend(ended.then_some("what the prescribed parameters would be as unknowns"));
        let width_std = options.constants.iter().find(|constant| constant.kind == ConstantKind::Width);
        let width_std = width_std.map_or(0.0, |constant| constant.std);
        let width = problem.width_as_unknown(evaluation, weights, change, constants, width_std);
        let along = problem.thickness_along(evaluation, weights, statistics, change, constants);
        Ok(Doubts { misfit: Some(misfit), released: released.filter(|_| !ended), width, along })
    }
}

/// Finds what is known of the result at `end`; `minima` are the others of a law that has some, where they were looked
/// for.
fn appraise(
    problem: &Problem<'_>,
    options: &FitOptions,
    end: Minimum,
    minima: Option<&[(Vec<f64>, f64)]>,
) -> Result<Fit, FitError> {
    let (unknowns, x, statistics) = (&problem.unknowns, &end.evaluation.x, end.statistics.as_ref());
    let law = unknowns.law_at(x)?;
    let furthest = furthest(problem, &end.evaluation, &*law);
    let mut appraisal = Appraisal { problem, options, end: &end, missing: Vec::new(), furthest };
    let slopes = unknowns.slopes(x);
    let constants = match statistics {
        Some(statistics) => problem.constant_effects(&end.evaluation, statistics, &options.constants),
        None => Vec::new(),
    };
    let refined = appraisal.refine();
    let refinement = statistics.zip(refined.as_ref()).map(|(statistics, refined)| Refinement {
        scaled: statistics.shift(&refined.change),
        jumps: refined.jumps.clone(),
        forces: refined.forces.clone(),
        included: options.discretisation == Discretisation::Included,
    });
    let rotations = appraisal.turn(&slopes);
    let by_refinement: Option<Vec<f64>> =
        refinement.as_ref().map(|finer| finer.scaled.iter().zip(&slopes).map(|(z, slope)| z * slope).collect());
    let Fitted { budget, mut parameters, mut derived, covariance } = assess(
        problem,
        &Ingredients {
            x,
            statistics,
            constants: &options.constants,
            effects: &constants,
            by_refinement: by_refinement.as_deref(),
            discretisation: options.discretisation,
            furthest: appraisal.furthest,
        },
    );
    let correlation = covariance.as_ref().map(|covariance| correlation_of(covariance, statistics));
    let intervals = appraisal.settle_intervals(&budget, &mut parameters, &mut derived);
    // What the objective allows about every minimum, of a law with several.
    let axes = match (statistics, minima) {
        (Some(statistics), Some(minima)) if problem.watch.ended().is_none() => {
            Axes::new(problem, (&end.evaluation, &end.boundary), statistics, options, minima)?
        }
        _ => None,
    };
    if let Some(axes) = &axes {
        widen_to_minima(axes, (unknowns, furthest), &budget, &mut parameters, &mut derived);
    }
    let singular_values = end.local.singular_values()?;
    let doubts = appraisal.doubt(refined.as_ref().map(|refined| refined.change.as_slice()), &constants)?;
    let missing = appraisal.missing;
    let cut_short = problem.watch.ended().map(|ended| CutShort { ended, missing });
    let mut remarks = implausible_result(problem, &*law);
    remarks.extend(extrapolated(&*law, furthest));
    let mut fit = Fit {
        derived,
        furthest,
        parameters,
        values: law.values(),
        covariance,
        correlation,
        singular_values,
        omega: end.local.omega,
        status: end.stage.status,
        reason: end.stage.reason,
        evaluations: end.stage.evaluations,
        rescued: end.stage.rescued,
        history: end.stage.history.into_iter().map(|iteration| iteration.unscaled(unknowns)).collect(),
        starts: end.starts,
        misfit: doubts.misfit,
        released: doubts.released,
        width: doubts.width,
        along: doubts.along,
        verdict: Verdict::default(),
        constants,
        budget,
        remarks,
        intervals,
        refinement,
        rotations,
        statistics: end.statistics,
        evaluation: end.evaluation,
        boundary: end.boundary,
        largest_correction: end.largest_correction,
        cut_short,
        axes,
    };
    fit.verdict = judge(problem, options, &fit, &end.local.h);
    Ok(fit)
}

/// Judges a fit, at whose end the normal matrix is `h`.
fn judge(problem: &Problem<'_>, options: &FitOptions, of: &Fit, h: &Dense) -> Verdict {
    let unfinished = reasons_unfinished(of.status, of.cut_short.as_ref(), &problem.unknowns, &of.evaluation.x);
    let statistics = of.statistics.as_ref();
    let noise = statistics.map(|statistics| &statistics.covariance);
    let missing = if options.doubt { problem.missing_mode(&of.evaluation, h, noise, LARGEST_STD) } else { None };
    // Whether the data tell the parameters apart is a question to the noise: one wrong constant moves all of them
    // together.
    let of_noise = noise.map(|covariance| correlation_of(covariance, statistics));
    let verdict = match &of_noise {
        None => Verdict::singular(&of.parameters, unfinished, missing.as_ref()),
        Some(correlation) => {
            let released = of.released.as_ref();
            let prescribed =
                released.map_or(Vec::new(), |released| problem.prescribed_std(released, &options.constants));
            let grounds = Grounds {
                correlation,
                misfit: of.misfit.as_ref(),
                released,
                width: of.width.as_ref(),
                along: of.along.as_ref(),
                released_std: &prescribed,
                intervals: of.intervals.as_ref(),
                noise_ratio: problem.noise.ratio,
                given: problem.given(),
                unfinished,
                missing,
            };
            Verdict::new(&of.parameters, &grounds)
        }
    };
    let mut verdict = verdict.with_rotations(of.rotations.as_ref(), &of.parameters);
    if problem.observation.nodes.is_empty() && statistics.is_some() {
        verdict.sentences.push(curve_alone(&of.parameters, &of.derived));
    }
    if let Some(others) = of.axes.as_ref().map(Axes::n_others).filter(|others| *others > 0) {
        verdict.sentences.push(several_minima(problem.unknowns.law().name(), others));
    }
    verdict
}

/// Widens the intervals to what the objective allows about every minimum, constants and bias as before.
fn widen_to_minima(
    axes: &Axes,
    (unknowns, furthest): (&Unknowns, Option<Jump>),
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
        let allowed = axes.allowed().iter().filter_map(|law| law.values().get(index).copied()).collect();
        p.set_ends(ends(p.value, p.bias, budget.parameter(k).others, p.ends95, allowed));
    }
    for (k, q) in derived.iter_mut().enumerate() {
        let value =
            |law: &dyn CohesiveLaw| crate::identify::derived(law, furthest).get(k).map(|quantity| quantity.value);
        let allowed = axes.allowed().iter().filter_map(|law| value(&**law)).collect();
        q.set_ends(ends(q.quantity.value, q.bias, budget.quantity(k).others, q.ends95, allowed));
    }
}

/// The parameters after one Gauss-Newton step from `x` under the weights of kind `weights`, the boundary as measured:
/// where a fit near `x` ends, to first order.
///
/// # Errors
/// See [`FitError`].
pub fn first_order(problem: &Problem<'_>, weights: WeightKind, x: &[f64]) -> Result<Vec<f64>, FitError> {
    let evaluation = problem.evaluate(x, &problem.border.boundary)?.ok_or(FitError::Lost)?;
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
pub(crate) fn reasons_unfinished(
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

pub(crate) fn describe(unknowns: &Unknowns, x: &[f64]) -> String {
    let named = |(unknown, x): (&Unknown, &f64)| format!("{} = {x}", unknown.parameter.name);
    unknowns.list().iter().zip(x).map(named).collect::<Vec<_>>().join(", ")
}

/// The end to go on from: the lowest objective, converged ones first; and how the others compare with it.
pub(crate) fn compare(unknowns: &Unknowns, starts: &[Vec<f64>], ends: &[End]) -> (usize, Vec<StartEnd>) {
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
pub(crate) fn correlation_of(covariance: &Dense, statistics: Option<&Statistics>) -> Dense {
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
