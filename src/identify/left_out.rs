//! How well a fit foretells instants that it has not seen.

use super::FitError;
use super::fit::Fit;
use super::objective::{Evaluation, Problem};
use super::observation::Observation;
use super::options::FitOptions;
use super::stage::no_texture;
use super::weights::{InverseCovariance, WeightKind, Weights};
use crate::linalg::Dense;
use rayon::prelude::*;
use std::sync::Arc;

/// Parts that the instants are divided into, every fifth into one: each is left out once.
const PARTS: usize = 5;
/// Shares of the step that are tried one after the other.
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.0625];

/// What is left of instants that were left out of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOut {
    /// The sum of the squares of their whitened residuals, each foretold by a fit to the others; with an unknown noise that of
    /// noise 1.
    pub omega: f64,
    /// Parts that were left out, one after the other.
    pub parts: usize,
}

impl Problem<'_> {
    /// The same with some of the instants only.
    fn at_instants(&self, instants: &[usize]) -> Result<Self, FitError> {
        let all = &self.observation.instants;
        let instants = instants.iter().map(|&i| all[i].clone()).collect();
        let observation = Arc::new(Observation { instants, ..(*self.observation).clone() });
        let unknowns = self.unknowns.starting_at(&self.unknowns.start())?;
        Ok(Self { observation, ..self.with_unknowns(unknowns) })
    }

    /// The instants left out of `fit` part by part: every part is foretold by one Gauss-Newton step from `fit` on the others,
    /// shortened until it lowers their objective, and a forward run there; `None` where there are fewer than two instants or no derivatives to step with.
    ///
    /// # Errors
    /// A covariance without inverse.
    pub(super) fn left_out(&self, fit: &Fit, options: &FitOptions) -> Result<Option<LeftOut>, FitError> {
        let n = self.observation.instants.len();
        let Some(statistics) = fit.statistics.as_ref().filter(|_| n > 1) else { return Ok(None) };
        let parts = PARTS.min(n);
        let covariance = |instants: &[usize]| -> Result<Weights, FitError> {
            let by_boundary = match statistics.by_boundary.is_empty() {
                true => Vec::new(),
                false => instants.iter().map(|&i| statistics.by_boundary[i].clone()).collect(),
            };
            let inverse = InverseCovariance::new(&self.noise, instants.len(), by_boundary).map_err(no_texture)?;
            Ok(Weights::Inverse(inverse))
        };
        let z = self.unknowns.scaled(&fit.evaluation.x);
        let [lower, upper] = self.unknowns.scaled_bounds();
        let of_part = |part: usize| -> Result<Option<f64>, FitError> {
            let (left, kept): (Vec<usize>, Vec<usize>) = (0..n).partition(|i| i % parts == part);
            let problem = self.at_instants(&kept)?;
            let weights = match options.weights {
                WeightKind::Covariance => covariance(&kept)?,
                kind => problem.diagonal_weights(kind),
            };
            let blocks = |instants: &[usize], of: &Evaluation| -> Vec<Dense> {
                instants.iter().map(|&i| of.blocks[i].clone()).collect()
            };
            let seen = Evaluation { blocks: blocks(&kept, &fit.evaluation), ..fit.evaluation.clone() };
            let local = seen.local(&weights, &self.noise);
            let Ok(factor) = local.h.cholesky() else { return Ok(None) };
            let step = factor.solve(&Dense::from_fn(z.len(), 1, |k, _| local.b[k]));
            // The objective is no parabola where little is known: a step that does not lower it on what is kept is too long.
            let mut residual = fit.evaluation.residual();
            for share in SHARES {
                let there: Vec<f64> =
                    (0..z.len()).map(|k| (z[k] + share * step[(k, 0)]).clamp(lower[k], upper[k])).collect();
                let Some(at) = self.evaluate(&self.unknowns.unscaled(&there), &fit.boundary)? else { continue };
                let trial = Evaluation { blocks: blocks(&kept, &at), ..seen.clone() };
                if trial.local(&weights, &self.noise).omega <= local.omega {
                    residual = at.residual();
                    break;
                }
            }
            let residual: Vec<Dense> = left.iter().map(|&i| residual[i].clone()).collect();
            let weighted = covariance(&left)?.times(&self.noise, &residual);
            Ok(Some(residual.iter().zip(&weighted).map(|(r, wr)| r.transposed_times(wr)[(0, 0)]).sum()))
        };
        let of_parts: Vec<Option<f64>> = (0..parts).into_par_iter().map(of_part).collect::<Result<_, FitError>>()?;
        let sum: Option<f64> = of_parts.into_iter().sum();
        Ok(sum.map(|omega| LeftOut { omega, parts }))
    }
}
