//! How well a fit predicts instants that it has not seen.

use crate::identify::solve::stage::run;
use crate::identify::{
    COARSE, Evaluation, Fit, FitError, FitOptions, FitStatus, Observation, Problem, TrustRegionOptions, Weights,
};
use crate::io::case::WeightKind;
use crate::linalg::Dense;
use rayon::prelude::*;
use std::sync::Arc;

/// Parts that the instants are divided into, every fifth into one: each is left out once.
const PARTS: usize = 5;
/// Forward runs that the fit to the others may take, from the fit to all on.
const EVALUATIONS: usize = 8;
/// The same of a law that the data reject anyway.
const EVALUATIONS_REJECTED: usize = 3;

/// What is left of instants that were left out of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOut {
    /// The sum of the squares of their whitened residuals, each predicted by a fit to the others; with an unknown
    /// noise that of noise 1.
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

    /// The instants left out of `fit` part by part: every part is predicted by a fit to the others that goes on from
    /// there; `None` where there are fewer than two instants, or such a fit has no solution or no time. Errors: a
    /// covariance without inverse.
    pub(crate) fn left_out(
        &self,
        fit: &Fit,
        options: &FitOptions,
        rejected: bool,
    ) -> Result<Option<LeftOut>, FitError> {
        let n = self.observation.instants.len();
        let Some(statistics) = fit.statistics.as_ref().filter(|_| n > 1) else { return Ok(None) };
        let parts = PARTS.min(n);
        let covariance = |instants: &[usize]| -> Result<Weights, FitError> {
            let by_boundary = match statistics.by_boundary.is_empty() {
                true => Vec::new(),
                false => instants.iter().map(|&i| statistics.by_boundary[i].clone()).collect(),
            };
            self.at_instants(instants)?.inverse_covariance(by_boundary)
        };
        let max_evaluations = if rejected { EVALUATIONS_REJECTED } else { EVALUATIONS };
        let region = TrustRegionOptions { step_tolerance: COARSE, max_evaluations, ..options.region };
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
            let end = run(&problem, &fit.boundary, &weights, &fit.evaluation.x, Some(seen), &region);
            // Whose residual is not that of a fit to the others would be predicted too well.
            let at = match end.status {
                FitStatus::TimeLimit | FitStatus::Stopped | FitStatus::NoStart => None,
                _ => self.evaluate(&self.unknowns.unscaled(&end.z), &fit.boundary)?,
            };
            let Some(at) = at else { return Ok(None) };
            let residual = at.residual();
            let residual: Vec<Dense> = left.iter().map(|&i| residual[i].clone()).collect();
            let weighted = covariance(&left)?.times(&self.noise, &residual);
            Ok(Some(residual.iter().zip(&weighted).map(|(r, wr)| r.transposed_times(wr)[(0, 0)]).sum()))
        };
        let of_parts: Vec<Option<f64>> = (0..parts).into_par_iter().map(of_part).collect::<Result<_, FitError>>()?;
        let sum: Option<f64> = of_parts.into_iter().sum();
        Ok(sum.map(|omega| LeftOut { omega, parts }))
    }
}
