//! The prescribed parameters of the law, tried once as unknowns: does the objective want them elsewhere? (THEORY 11)

use crate::identify::solve::stage::run;
use crate::identify::{
    Asked, Evaluation, FitError, FitStatus, NORMAL_95, Problem, Statistics, TrustRegionOptions, Unknowns, Weights,
};
use crate::mechanics::BoundaryHistory;
use crate::mechanics::cohesive::CohesiveLaw;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// The share of right prescriptions for which the fall of the objective is called significant.
const FALSE_ALARMS: f64 = 1e-3;

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

/// A law all of whose parameters are unknowns, as a trial.
pub(crate) struct Trial {
    law: Box<dyn CohesiveLaw>,
    /// As of [`Unknowns::of_list`]: those fitted, then those prescribed.
    list: Vec<Asked>,
    fitted: usize,
}

impl Trial {
    /// How it is searched: its objective is then good to far below one, or it is given up where it is.
    pub fn region() -> TrustRegionOptions {
        TrustRegionOptions { step_tolerance: 1e-4, max_evaluations: 20, ..TrustRegionOptions::default() }
    }

    /// The trial from `x` on; `None` where nothing is prescribed, or `n_data` numbers are too few for it.
    pub fn new(unknowns: &Unknowns, x: &[f64], n_data: usize) -> Result<Option<Self>, FitError> {
        let law = unknowns.law_at(x)?;
        let mut list: Vec<Asked> = (unknowns.list().iter().zip(x))
            .map(|(unknown, &x)| (unknown.index, x, Some(unknown.bounds[0]), Some(unknown.bounds[1])))
            .collect();
        let fitted = list.len();
        for (index, value) in law.values().into_iter().enumerate() {
            if list[..fitted].iter().all(|(other, ..)| *other != index) {
                list.push((index, value, None, None));
            }
        }
        Ok((list.len() > fitted && n_data > list.len()).then_some(Self { law, list, fitted }))
    }

    /// The same unknowns as `fitted` and those prescribed; `None` where the law allows no other values.
    pub fn unknowns(&self, fitted: &Unknowns) -> Option<Unknowns> {
        fitted.of_list(&*self.law, &self.list).ok()
    }

    /// What the trial that ended so with the parameters `x`, each known to `std`, comes to.
    pub fn released(&self, status: FitStatus, x: &[f64], std: impl Fn(usize) -> Option<f64>, gain: f64) -> Released {
        let prescribed = &self.list[self.fitted..];
        let parameter = |(k, &(index, prescribed, ..)): (usize, &Asked)| ReleasedParameter {
            name: self.law.parameters()[index].name,
            prescribed,
            value: x[k],
            std: std(k).filter(|std| std.is_finite()),
        };
        let chance = ChiSquared::new(prescribed.len() as f64);
        Released {
            limit: chance.map_or(f64::INFINITY, |law| law.inverse_cdf(1.0 - FALSE_ALARMS)),
            parameters: (self.fitted..).zip(prescribed).map(parameter).collect(),
            gain,
            converged: status == FitStatus::Converged,
        }
    }
}

impl Problem<'_> {
    /// Tries the prescribed parameters of the law as unknowns, from the end `evaluation` of the fit on; `None` where
    /// there are none, or the law allows no others. Errors: a tangent without inverse.
    pub(crate) fn release(
        &self,
        evaluation: &Evaluation,
        weights: &Weights,
        statistics: &Statistics,
        boundary: &BoundaryHistory,
    ) -> Result<Option<Released>, FitError> {
        let Some(trial) = Trial::new(&self.unknowns, &evaluation.x, self.n_data())? else {
            return Ok(None);
        };
        let Some(unknowns) = trial.unknowns(&self.unknowns) else { return Ok(None) };
        let problem = self.with_unknowns(unknowns);
        let end = run(&problem, boundary, weights, &problem.unknowns.start(), None, &Trial::region());
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
        let std = |k: usize| variance.as_ref().map(|v| slopes[k] * v[k].max(0.0).sqrt());
        let fall = (before - local.omega).max(0.0);
        let gain = match weights {
            Weights::Inverse(_) if self.noise.sigma.is_some() => fall,
            // In units of what one number compared leaves of the objective.
            _ => fall / (statistics.expected_omega / self.n_data() as f64).max(f64::MIN_POSITIVE),
        };
        Ok(Some(trial.released(end.status, &x, std, gain)))
    }
}
