//! What was fitted, with what is known of it.

use crate::identify::intervals::budget::budget;
use crate::identify::{Budget, Derived, FitStatus, Ingredients, NORMAL_95, Problem};
use crate::linalg::Dense;
use crate::mechanics::cohesive::Parameter;

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
    /// 95 % interval: the root of the sum of all lines of the budget, extended by the bias, see
    /// [`crate::identify::interval95`]; `None` where it has not two ends.
    pub interval95: Option<[f64; 2]>,
    /// Its ends, each for itself: `None` where the data do not bound the parameter on that side.
    pub ends95: [Option<f64>; 2],
    /// What noise shifts the value by on average (found less true), through kinks and plasticity; the interval is
    /// extended by it, the value is not moved. `None` where it was not looked for.
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
    /// What noise shifts it by on average, as of a parameter.
    pub bias: Option<f64>,
}

impl FittedParameter {
    /// Its standard uncertainty relative to its value, with everything that its interval holds; infinite where that has
    /// not two ends.
    pub fn relative_std(&self) -> f64 {
        let std = self.interval95.map_or(f64::INFINITY, |[low, high]| (high - low) / (2.0 * NORMAL_95));
        if self.value == 0.0 && std > 0.0 { f64::INFINITY } else { std / self.value.abs().max(f64::MIN_POSITIVE) }
    }

    pub(crate) fn set_ends(&mut self, ends: [Option<f64>; 2]) {
        (self.ends95, self.interval95) = (ends, both(ends));
    }
}

impl FittedQuantity {
    pub(crate) fn set_ends(&mut self, ends: [Option<f64>; 2]) {
        (self.ends95, self.interval95) = (ends, both(ends));
    }
}

/// Parameters and quantities with their standard uncertainties, before they get intervals.
pub(crate) struct Fitted {
    pub parameters: Vec<FittedParameter>,
    pub derived: Vec<FittedQuantity>,
    pub covariance: Option<Dense>,
    pub budget: Budget,
}

/// Makes the budget of the parameters found, and gives them and what follows from them their standard uncertainties.
pub(crate) fn assess(problem: &Problem<'_>, of: &Ingredients<'_>) -> Fitted {
    let (x, change) = (of.x, of.by_refinement);
    let (budget, quantities, covariance) = budget(problem, of);
    let is_known = covariance.is_some();
    let parameters = (problem.unknowns.list().iter().enumerate())
        .map(|(k, unknown)| {
            let (parts, [low, high]) = (budget.parameter(k), unknown.bounds);
            FittedParameter {
                parameter: unknown.parameter,
                value: x[k],
                std: is_known.then_some(parts.std),
                std_noise: is_known.then_some(parts.noise),
                discretisation: change.map(|change| change[k]),
                interval95: None,
                ends95: [None; 2],
                bias: None,
                bias_std: None,
                std_bootstrap: None,
                start: unknown.start,
                bounds: unknown.bounds,
                at_bound: x[k] <= low * (1.0 + 1e-9) || x[k] >= high * (1.0 - 1e-9),
            }
        })
        .collect();
    let derived = (quantities.into_iter().enumerate())
        .map(|(q, quantity)| {
            let parts = budget.quantity(q);
            FittedQuantity {
                quantity,
                std: is_known.then_some(parts.std),
                std_noise: is_known.then_some(parts.noise),
                discretisation: change.and_then(|_| budget.lines.last()?.derived.get(q).copied()),
                interval95: None,
                ends95: [None; 2],
                bias: None,
            }
        })
        .collect();
    Fitted { parameters, derived, covariance, budget }
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
