//! The prescribed parameters of the law, tried once as unknowns: does the objective want them elsewhere? (THEORY 11)

use crate::identify::intervals::statistics::Statistics;
use crate::identify::objective::problem::{Evaluation, Problem};
use crate::identify::objective::unknowns::Unknowns;
use crate::identify::objective::weights::Weights;
use crate::identify::solve::stage::run;
use crate::identify::solve::trust_region::{FitStatus, TrustRegionOptions};
use crate::identify::{FitError, NORMAL_95};
use crate::mechanics::BoundaryHistory;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Scaled step at which the trial ends: its objective is then good to far below one.
pub(crate) const STEP: f64 = 1e-4;
/// Evaluations after which it is given up where it is.
pub(crate) const EVALUATIONS: usize = 20;
/// The share of right prescriptions for which the fall of the objective is called significant.
const FALSE_ALARMS: f64 = 1e-3;

/// Fall of the objective that `freedom` right prescriptions exceed in one of a thousand cases.
pub(crate) fn limit(freedom: usize) -> f64 {
    ChiSquared::new(freedom as f64).map_or(f64::INFINITY, |law| law.inverse_cdf(1.0 - FALSE_ALARMS))
}

/// What becomes of the objective when the prescribed parameters of the law are unknowns too, all together, under the
/// weights of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Released {
    /// The parameters that were prescribed.
    pub parameters: Vec<ReleasedParameter>,
    /// What the objective falls by, in units of the noise's variance: a chi-square of as many degrees of freedom as
    /// there are parameters where the prescriptions are right.
    pub gain: f64,
    /// Fall that right prescriptions exceed in one of a thousand cases.
    pub limit: f64,
    /// Whether the trial converged.
    pub converged: bool,
}

/// A prescribed parameter as the data would have it.
#[derive(Debug, Clone, PartialEq)]
pub struct ReleasedParameter {
    /// Its name.
    pub name: &'static str,
    /// The value that the case prescribes.
    pub prescribed: f64,
    /// The value that the data prefer.
    pub value: f64,
    /// Its standard uncertainty by the noise; `None` where the data say nothing of it.
    pub std: Option<f64>,
}

impl Released {
    /// Whether the data want other values than those prescribed.
    pub fn significant(&self) -> bool {
        self.converged && self.gain > self.limit
    }
}

impl ReleasedParameter {
    /// Whether the value that the data prefer is beyond what the prescription allows, known to `std`.
    pub fn contradicts(&self, std: f64) -> bool {
        let own = self.std.unwrap_or(f64::INFINITY);
        (self.value - self.prescribed).abs() > NORMAL_95 * own.hypot(std)
    }
}

impl Problem<'_> {
    /// Tries the prescribed parameters of the law as unknowns, from the end `evaluation` of the fit on; `None` where
    /// there are none, or the law allows no others.
    ///
    /// # Errors
    /// A tangent without inverse.
    pub(crate) fn release(
        &self,
        evaluation: &Evaluation,
        weights: &Weights,
        statistics: &Statistics,
        boundary: &BoundaryHistory,
    ) -> Result<Option<Released>, FitError> {
        let law = self.unknowns.law_at(&evaluation.x)?;
        let values = law.values();
        let mut list: Vec<(usize, f64, Option<f64>, Option<f64>)> = (self.unknowns.list().iter().zip(&evaluation.x))
            .map(|(unknown, &x)| (unknown.index, x, Some(unknown.bounds[0]), Some(unknown.bounds[1])))
            .collect();
        let fitted = list.len();
        let prescribed: Vec<usize> =
            (0..values.len()).filter(|index| list.iter().all(|(fitted, ..)| fitted != index)).collect();
        list.extend(prescribed.iter().map(|&index| (index, values[index], None, None)));
        if prescribed.is_empty() || self.observation.n_data() <= list.len() {
            return Ok(None);
        }
        let Ok(unknowns) = Unknowns::new(&*law, &list) else { return Ok(None) };
        let problem = self.with_unknowns(unknowns);
        let region =
            TrustRegionOptions { step_tolerance: STEP, max_evaluations: EVALUATIONS, ..TrustRegionOptions::default() };
        let start = problem.unknowns.start();
        let end = run(&problem, boundary, weights, &start, None, &region);
        let before = evaluation.local(weights, &self.noise).omega;
        let Some(local) = &end.local else { return Ok(None) };
        let x = problem.unknowns.unscaled(&end.z);
        let slopes = problem.unknowns.slopes(&x);
        let variance = match (weights, local.h.cholesky()) {
            (_, Err(_)) => None,
            // The inverse covariance, of noise 1 where that is unknown.
            (Weights::Inverse(_), Ok(factor)) => {
                let inverse = factor.inverse();
                let unit = if self.noise.sigma.is_some() { 1.0 } else { statistics.sigma * statistics.sigma };
                Some((0..x.len()).map(|k| unit * inverse[(k, k)]).collect::<Vec<f64>>())
            }
            (Weights::Diagonal(_), Ok(_)) => {
                let at = problem.evaluate(&x, boundary)?;
                let own = at.map(|at| Statistics::new(&problem, &at, weights)).transpose()?.flatten();
                own.map(|own| (0..x.len()).map(|k| own.covariance[(k, k)]).collect())
            }
        };
        let std = |k: usize| variance.as_ref().map(|v| slopes[k] * v[k].max(0.0).sqrt()).filter(|std| std.is_finite());
        let parameters: Vec<ReleasedParameter> = (prescribed.iter().zip(fitted..))
            .map(|(&index, k)| ReleasedParameter {
                name: law.parameters()[index].name,
                prescribed: values[index],
                value: x[k],
                std: std(k),
            })
            .collect();
        let fall = (before - local.omega).max(0.0);
        let gain = match weights {
            Weights::Inverse(_) if self.noise.sigma.is_some() => fall,
            // In units of what one number compared leaves of the objective.
            _ => fall / (statistics.expected_omega / self.observation.n_data() as f64).max(f64::MIN_POSITIVE),
        };
        Ok(Some(Released {
            limit: limit(prescribed.len()),
            parameters,
            gain,
            converged: end.status == FitStatus::Converged,
        }))
    }
}
