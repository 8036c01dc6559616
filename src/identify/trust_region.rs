//! Gauss-Newton in a trust region with bounds (THEORY 6), on scaled unknowns.

use super::cone_step::{StepRegion, cone_step, length};
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
}

impl Default for TrustRegionOptions {
    fn default() -> Self {
        Self { step_tolerance: 1e-9, max_evaluations: 100, first_radius: 0.5, max_radius: 2.0 }
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
    /// The forward model has no solution at the start.
    NoStart,
}

impl FitStatus {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::EvaluationLimit => "evaluation_limit",
            Self::Stalled => "stalled",
            Self::NoStart => "no_start",
        }
    }
}

/// One accepted point, or one step that was tried and refused.
#[derive(Debug, Clone, PartialEq)]
pub struct Iteration {
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

/// Share of the objective below which its differences are round-off.
const ROUND_OFF: f64 = 1e-12;

/// Minimises the objective from `start` within `[lower, upper]`; `evaluate` gives `None` where there is no value, which
/// shortens the step.
pub fn minimise(
    start: &[f64],
    [lower, upper]: [&[f64]; 2],
    options: &TrustRegionOptions,
    mut evaluate: impl FnMut(&[f64]) -> Option<Local>,
) -> End {
    let mut radius = options.first_radius;
    let mut z = start.to_vec();
    let mut history = Vec::new();
    let mut note = |z: &[f64], local: Option<&Local>, radius: f64, accepted: bool| {
        let (omega, rescued) = (local.map(|l| l.omega), local.is_some_and(|l| l.rescued));
        history.push(Iteration { z: z.to_vec(), omega, radius, accepted, rescued });
    };
    let first = evaluate(&z);
    note(&z, first.as_ref(), radius, first.is_some());
    let mut evaluations = 1;
    let Some(mut local) = first else {
        let reason = "the forward model has no solution at the start; start from a less brittle adhesive \
                      (smaller phi_n/delta_n)";
        let status = FitStatus::NoStart;
        return End { z, local: None, status, reason: reason.into(), evaluations, history };
    };
    let (status, reason) = loop {
        let below: Vec<f64> = lower.iter().zip(&z).map(|(l, z)| (l - z).min(0.0)).collect();
        let above: Vec<f64> = upper.iter().zip(&z).map(|(u, z)| (u - z).max(0.0)).collect();
        let Some(step) = cone_step(&local.h, &local.b, &StepRegion { lower: &below, upper: &above, radius }) else {
            break (FitStatus::Stalled, "the derivatives are not finite".to_owned());
        };
        let size = step.iter().fold(0.0_f64, |most, s| most.max(s.abs()));
        if size < options.step_tolerance {
            let by_radius = length(&step) > 0.5 * radius;
            if !by_radius {
                // Worth no evaluation, but it takes off what is left of the error.
                z = (0..z.len()).map(|k| (z[k] + step[k]).clamp(lower[k], upper[k])).collect();
            }
            break match by_radius {
                true => (FitStatus::Stalled, format!("no step down to {radius:.1e} lowers the objective")),
                false => (FitStatus::Converged, format!("the scaled step {size:.1e} is below its tolerance")),
            };
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
        let Some(new) = found else {
            note(&trial, None, with_radius, false);
            radius = 0.25 * length(&step);
            continue;
        };
        let curved: f64 =
            (0..z.len()).map(|r| step[r] * (0..z.len()).map(|c| local.h[(r, c)] * step[c]).sum::<f64>()).sum();
        let foretold = 2.0 * step.iter().zip(&local.b).map(|(s, b)| s * b).sum::<f64>() - curved;
        let gain = local.omega - new.omega;
        let accepted = match foretold <= ROUND_OFF * local.omega {
            true => gain >= -10.0 * ROUND_OFF * local.omega,
            false => gain > 1e-4 * foretold,
        };
        note(&trial, Some(&new), with_radius, accepted);
        if gain < 0.25 * foretold && foretold > ROUND_OFF * local.omega {
            radius = 0.25 * length(&step);
        } else if gain > 0.75 * foretold && length(&step) > 0.9 * radius {
            radius = (2.0 * radius).min(options.max_radius);
        }
        if accepted {
            (z, local) = (trial, new);
        } else if foretold <= ROUND_OFF * local.omega {
            radius = 0.25 * length(&step);
        }
    };
    End { z, local: Some(local), status, reason, evaluations, history }
}
