//! Gauss-Newton in a trust region with bounds (THEORY 6), on scaled unknowns.

use crate::identify::solve::cone_step::{cone_step_beside, length};
use crate::identify::{FitError, HalfSpace, StepRegion, Unknowns, room};
use crate::linalg::Dense;

/// What the objective is about a point, in scaled unknowns `z`: `omega(z + s) ~ omega - 2 b^T s + s^T H s`.
#[derive(Debug, Clone)]
pub struct Local {
    /// The objective.
    pub omega: f64,
    /// `J^T W r`: minus half the gradient.
    pub b: Vec<f64>,
    /// `J^T W J`.
    pub h: Dense,
    /// Whether the forward run was rescued: node pairs snapped.
    pub rescued: bool,
}

/// Least eigenvalue of a normal matrix of unit diagonal that is more than round-off.
const NOTHING: f64 = 1e-11;

impl Local {
    /// The same by a factor.
    pub(crate) fn times(self, factor: f64) -> Self {
        let b = self.b.iter().map(|b| factor * b).collect();
        let h = Dense::from_fn(self.h.n_rows(), self.h.n_rows(), |r, c| factor * self.h[(r, c)]);
        Self { omega: factor * self.omega, b, h, rescued: self.rescued }
    }

    /// Whether some combination of the unknowns changes nothing beyond round-off.
    pub(crate) fn is_singular(&self) -> bool {
        let n = self.b.len();
        let size: Vec<f64> = (0..n).map(|k| self.h[(k, k)].sqrt()).collect();
        let unit = Dense::from_fn(n, n, |r, c| self.h[(r, c)] / (size[r] * size[c]));
        // Of one that nothing depends on there is no number.
        n > 0 && !unit.symmetric_eigen().is_some_and(|(values, _)| values[0] > NOTHING)
    }

    /// Those of the weighted Jacobian by the scaled unknowns, falling.
    pub(crate) fn singular_values(&self) -> Result<Vec<f64>, FitError> {
        let (values, _) = self.h.symmetric_eigen().ok_or(FitError::NotFinite)?;
        Ok(values.iter().rev().map(|value| value.max(0.0).sqrt()).collect())
    }
}

/// When the iteration ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustRegionOptions {
    /// Largest component of the scaled step at which the fit has converged.
    pub step_tolerance: f64,
    /// Evaluations of the objective.
    pub max_evaluations: usize,
    /// Radius of the first step, in scaled unknowns: with logarithms, a factor of e^radius.
    pub first_radius: f64,
    /// Largest radius.
    pub max_radius: f64,
    /// Share of the objective by which ten evaluations together have to lower it, else the fit has converged too; with
    /// 0 a fit that stands still has converged only where nothing is left to gain. Far below what noise makes of the
    /// objective it ends a fit that creeps along a direction of which the data say nothing, or that lies on a kink.
    pub standstill: f64,
}

impl Default for TrustRegionOptions {
    fn default() -> Self {
        Self { step_tolerance: 1e-9, max_evaluations: 100, first_radius: 0.5, max_radius: 2.0, standstill: 0.0 }
    }
}

/// How a fit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitStatus {
    /// The scaled step is below its tolerance.
    Converged,
    /// The evaluations are used up.
    EvaluationLimit,
    /// No step, however short, lowers the objective any more.
    Stalled,
    /// Its limit of time was over.
    TimeLimit,
    /// It was asked to stop.
    Stopped,
    /// The forward model has no solution at the start.
    NoStart,
}

impl FitStatus {
    /// Whether something from outside ended it.
    pub fn cut_short(self) -> bool {
        matches!(self, Self::TimeLimit | Self::Stopped)
    }

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::EvaluationLimit => "evaluation_limit",
            Self::Stalled => "stalled",
            Self::TimeLimit => "time_limit",
            Self::Stopped => "stopped",
            Self::NoStart => "no_start",
        }
    }
}

/// One accepted point, or one step that was tried and refused.
#[derive(Debug, Clone, PartialEq)]
pub struct Iteration {
    /// The run of the minimiser that it belongs to, from 1: objectives of different stages have different weights.
    pub stage: usize,
    /// The point, in scaled unknowns.
    pub z: Vec<f64>,
    /// The objective; `None` where the forward model failed.
    pub omega: Option<f64>,
    /// Radius with which the point was reached.
    pub radius: f64,
    /// Whether the fit went on from here.
    pub accepted: bool,
    /// Whether the forward run was rescued.
    pub rescued: bool,
}

impl Iteration {
    /// The same with the point in parameters.
    pub(crate) fn unscaled(self, unknowns: &Unknowns) -> Self {
        Self { z: unknowns.unscaled(&self.z), ..self }
    }
}

/// Where a fit ended.
#[derive(Debug, Clone)]
pub struct End {
    /// The best point, in scaled unknowns.
    pub z: Vec<f64>,
    /// The objective there; `None` when not even the start could be evaluated.
    pub local: Option<Local>,
    /// How it ended.
    pub status: FitStatus,
    /// In words.
    pub reason: String,
    /// Evaluations, failed ones included.
    pub evaluations: usize,
    /// Every evaluation.
    pub history: Vec<Iteration>,
}

impl End {
    /// Evaluations in which the forward run was rescued.
    pub fn rescued(&self) -> usize {
        self.history.iter().filter(|iteration| iteration.rescued).count()
    }
}

/// Evaluations within which a fit has to get on, see [`TrustRegionOptions::standstill`].
const PATIENCE: usize = 10;
/// Share of the objective by which [`PATIENCE`] evaluations have to lower it in any fit: far below what any noise makes
/// of it.
const STANDS_STILL: f64 = 1e-9;
/// Share of the objective below which its differences are round-off.
const ROUND_OFF: f64 = 1e-12;

/// Decrease of the objective that the quadratic model with curvature `h` predicts for a step.
fn predicted(h: &Dense, b: &[f64], step: &[f64]) -> f64 {
    2.0 * step.iter().zip(b).map(|(s, b)| s * b).sum::<f64>()
        - times(h, step).iter().zip(step).map(|(h, s)| h * s).sum::<f64>()
}

fn times(h: &Dense, step: &[f64]) -> Vec<f64> {
    (0..step.len()).map(|r| (0..step.len()).map(|c| h[(r, c)] * step[c]).sum()).collect()
}

/// What Gauss-Newton leaves out of the second derivatives, learned from the gradients along the way: the structured
/// secant update of Dennis, Gay and Welsch (ACM TOMS 7, 1981, 348-368) with the condition of Biggs (J. Inst. Maths
/// Applics 19, 1977, 1-12).
struct Secant {
    s: Dense,
    in_use: bool,
}

impl Secant {
    fn new(n: usize) -> Self {
        Self { s: Dense::zeros(n, n), in_use: false }
    }

    /// The second derivatives that steps are made with; those of Gauss-Newton where the sum is not positive definite.
    fn model(&self, h: &Dense) -> Dense {
        let mut sum = h.clone();
        if self.in_use {
            sum.add(1.0, &self.s);
        }
        if self.in_use && sum.cholesky().is_err() { h.clone() } else { sum }
    }

    /// Takes the model that predicted the last gain better.
    fn choose(&mut self, local: &Local, step: &[f64], gain: f64) {
        let mut with = local.h.clone();
        with.add(1.0, &self.s);
        let off = |h: &Dense| (gain - predicted(h, &local.b, step)).abs();
        self.in_use = off(&with) < off(&local.h);
    }

    fn learn(&mut self, old: &Local, new: &Local, step: &[f64]) {
        let n = step.len();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let y: Vec<f64> = old.b.iter().zip(&new.b).map(|(old, new)| old - new).collect();
        let ys = dot(&y, step);
        if !(ys > 0.0 && ys.is_finite()) {
            return;
        }
        // The second derivatives change along the step by what the normal matrix does not explain.
        let left: Vec<f64> = y.iter().zip(times(&new.h, step)).map(|(y, h)| y - h).collect();
        let before = dot(&times(&self.s, step), step).abs();
        let size = if before > 0.0 { (dot(&left, step).abs() / before).min(1.0) } else { 1.0 };
        let s = Dense::from_fn(n, n, |r, c| size * self.s[(r, c)]);
        let rest: Vec<f64> = left.iter().zip(times(&s, step)).map(|(left, s)| left - s).collect();
        let twice = dot(&rest, step) / (ys * ys);
        self.s = Dense::from_fn(n, n, |r, c| s[(r, c)] + (rest[r] * y[c] + y[r] * rest[c]) / ys - twice * y[r] * y[c]);
    }
}

/// Minimises the objective from `start` within `[lower, upper]`; `evaluate` gives `None` where there is no value, which
/// shortens the step.
pub fn minimise(
    start: &[f64],
    [lower, upper]: [&[f64]; 2],
    options: &TrustRegionOptions,
    evaluate: impl FnMut(&[f64]) -> Option<Local>,
) -> End {
    minimise_unless(start, [lower, upper], options, evaluate, |_| Vec::new(), || None)
}

/// Distance of a limit of the law at which a fit is on it; no step leads nearer.
pub(crate) const ON_LIMIT: f64 = 1e-6;
/// Share of the distance of a limit that a step leaves: limits are curved, and a step onto one would end beyond it.
const LEFT_OF_DISTANCE: f64 = 0.01;

/// Where steps may lead beside limits at these distances, with their derivatives by the unknowns.
fn half_spaces(limits: Vec<(f64, Vec<f64>)>) -> Vec<HalfSpace> {
    // A step that fails at a limit would only be shortened until nothing is left of it: it has to lead along the limit.
    let half_space = |(distance, by): (f64, Vec<f64>)| {
        let left = (LEFT_OF_DISTANCE * distance).max(ON_LIMIT).min(distance);
        HalfSpace { by, least: left - distance }
    };
    limits.into_iter().map(half_space).collect()
}

/// How it ends where nothing is left of the trust radius; `solved` says whether the last trial had a value.
fn end_of_radius(radius: f64, solved: bool, options: &TrustRegionOptions) -> (FitStatus, String) {
    let reason = format!("no step down to {radius:.1e} lowers the objective");
    match solved && options.standstill > 0.0 {
        // On a kink: it has values on all sides, and all are higher.
        true => (FitStatus::Converged, format!("{reason}: a kink of the law")),
        false => (FitStatus::Stalled, reason),
    }
}

/// Says how and why it ends where the last evaluations lowered the objective by next to nothing; `omegas` is the least
/// one after each, `left` what the longest step would lower it by.
fn standstill(omegas: &[f64], options: &TrustRegionOptions, left: impl Fn() -> f64) -> Option<(FitStatus, String)> {
    let omega = *omegas.last()?;
    let gained = omegas.iter().rev().nth(PATIENCE)? - omega;
    if gained >= options.standstill.max(STANDS_STILL) * omega {
        return None;
    }
    let reason = format!("{PATIENCE} evaluations lowered the objective by {gained:.1e} of {omega:.4}");
    match options.standstill > 0.0 || left() < STANDS_STILL.sqrt() * omega {
        true => Some((FitStatus::Converged, format!("{reason}, which is nothing beside the noise"))),
        false => Some((FitStatus::Stalled, reason)),
    }
}

/// The same; `limits` gives the distances of what ends the range of the unknowns beside their bounds, with their
/// derivatives by the unknowns; where `ended` says how, it ends at the best point so far.
pub(crate) fn minimise_unless(
    start: &[f64],
    [lower, upper]: [&[f64]; 2],
    options: &TrustRegionOptions,
    mut evaluate: impl FnMut(&[f64]) -> Option<Local>,
    limits: impl Fn(&[f64]) -> Vec<(f64, Vec<f64>)>,
    ended: impl Fn() -> Option<(FitStatus, String)>,
) -> End {
    let mut radius = options.first_radius;
    let mut z = start.to_vec();
    let mut history = Vec::new();
    let mut note = |z: &[f64], local: Option<&Local>, radius: f64, accepted: bool| {
        let (omega, rescued) = (local.map(|l| l.omega), local.is_some_and(|l| l.rescued));
        history.push(Iteration { stage: 1, z: z.to_vec(), omega, radius, accepted, rescued });
    };
    let first = evaluate(&z);
    note(&z, first.as_ref(), radius, first.is_some());
    let mut evaluations = 1;
    let Some(mut local) = first else {
        if let Some((status, reason)) = ended() {
            let reason = format!("{reason} before the forward run at the start had ended");
            return End { z, local: None, status, reason, evaluations, history };
        }
        let reason = "the forward model has no solution at the start; start from a less brittle adhesive \
                      (smaller phi_n/delta_n)";
        let status = FitStatus::NoStart;
        return End { z, local: None, status, reason: reason.into(), evaluations, history };
    };
    let mut secant = Secant::new(z.len());
    // The least objective after each evaluation.
    let mut omegas = vec![local.omega];
    // Whether the last trial had one.
    let mut solved = true;
    let (status, reason) = loop {
        let [below, above] = room([lower, upper], &z);
        let h = secant.model(&local.h);
        let near = limits(&z);
        // Along a curved limit the last digits are those of the way there.
        let on_limit = near.iter().any(|(distance, _)| *distance < 2.0 * ON_LIMIT);
        let step_tolerance = if on_limit { options.step_tolerance.max(ON_LIMIT) } else { options.step_tolerance };
        let beside = half_spaces(near);
        let region = StepRegion { lower: &below, upper: &above, radius };
        let Some(step) = cone_step_beside(&h, &local.b, &region, &beside) else {
            break (FitStatus::Stalled, "the derivatives are not finite".to_owned());
        };
        let size = step.iter().fold(0.0_f64, |most, s| most.max(s.abs()));
        if size < step_tolerance {
            let by_radius = length(&step) > 0.5 * radius;
            if !by_radius {
                // Worth no evaluation, but it takes off what is left of the error.
                z = (0..z.len()).map(|k| (z[k] + step[k]).clamp(lower[k], upper[k])).collect();
            }
            break match by_radius {
                true => end_of_radius(radius, solved, options),
                false => (FitStatus::Converged, format!("the scaled step {size:.1e} is below its tolerance")),
            };
        }
        if let Some((status, reason)) = ended() {
            break (status, format!("{reason} after {evaluations} evaluations, the last scaled step was {size:.1e}"));
        }
        let left = || {
            let region = StepRegion { lower: &below, upper: &above, radius: options.max_radius };
            let step = cone_step_beside(&h, &local.b, &region, &beside);
            step.map_or(f64::INFINITY, |step| predicted(&h, &local.b, &step))
        };
        if let Some(end) = standstill(&omegas, options, left) {
            break end;
        }
        if evaluations >= options.max_evaluations {
            let reason = format!("{evaluations} evaluations, the last scaled step was {size:.1e}");
            break (FitStatus::EvaluationLimit, reason);
        }
        // Clamped once more: the sum may pass a bound by its rounding.
        let trial: Vec<f64> = (0..z.len()).map(|k| (z[k] + step[k]).clamp(lower[k], upper[k])).collect();
        let with_radius = radius;
        evaluations += 1;
        let found = evaluate(&trial);
        solved = found.is_some();
        let Some(new) = found else {
            note(&trial, None, with_radius, false);
            if let Some((status, reason)) = ended() {
                break (status, format!("{reason} in evaluation {evaluations}"));
            }
            radius = 0.25 * length(&step);
            omegas.push(local.omega);
            continue;
        };
        let gain = local.omega - new.omega;
        let predicted = predicted(&h, &local.b, &step);
        let accepted = match predicted <= ROUND_OFF * local.omega {
            true => gain >= -10.0 * ROUND_OFF * local.omega,
            false => gain > 1e-4 * predicted,
        };
        note(&trial, Some(&new), with_radius, accepted);
        if gain < 0.25 * predicted && predicted > ROUND_OFF * local.omega {
            radius = 0.25 * length(&step);
        } else if gain > 0.75 * predicted && length(&step) > 0.9 * radius {
            radius = (2.0 * radius).min(options.max_radius);
        }
        secant.choose(&local, &step, gain);
        if accepted {
            secant.learn(&local, &new, &step);
            (z, local) = (trial, new);
        } else if predicted <= ROUND_OFF * local.omega {
            radius = 0.25 * length(&step);
        }
        omegas.push(local.omega);
    };
    End { z, local: Some(local), status, reason, evaluations, history }
}
