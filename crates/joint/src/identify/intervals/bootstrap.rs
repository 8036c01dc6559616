//! Parametric bootstrap: what fits of data simulated from the fitted model do, noise of border and common reference
//! included. It finds the bias that noise makes through a kink of the law or through plasticity, which no linear theory
//! sees.

use crate::identify::solve::stage::run;
use crate::identify::{Evaluation, FitStatus, Problem, Statistics, TrustRegionOptions, Weights, prescribed_of};
use crate::linalg::Dense;
use crate::mechanics::BoundaryHistory;
use crate::mechanics::cohesive::Jump;
use rayon::prelude::*;
use std::sync::Arc;

/// The seed of the first pair of draws; those of the others follow.
const SEED: u64 = 20_090_603;
/// A refit ends when its step is below this share of the smallest standard uncertainty.
const SHARE: f64 = 0.05;
/// Evaluations that a refit may take.
const EVALUATIONS: usize = 15;

/// What the refits came to, in scaled unknowns.
#[derive(Debug, Clone, PartialEq)]
pub struct Bootstrap {
    /// Refits: pairs of opposite draws, whose first-order effects cancel out in the bias.
    pub draws: usize,
    /// Those that failed or did not converge.
    pub failed: usize,
    /// Those that ended on a bound.
    pub on_bound: usize,
    /// Mean error of each unknown (found less simulated), over the pairs of which both converged.
    pub bias: Vec<f64>,
    /// Standard uncertainty of the bias, from the scatter of the pairs; `None` of one pair alone.
    pub bias_std: Option<Vec<f64>>,
    /// Standard deviation of the errors.
    pub std: Vec<f64>,
    /// The errors of all refits that converged.
    pub errors: Vec<Vec<f64>>,
}

/// Where a fit ended, as far as refits need it.
pub(crate) struct Base<'a> {
    pub problem: &'a Problem<'a>,
    pub evaluation: &'a Evaluation,
    pub statistics: &'a Statistics,
    pub weights: &'a Weights,
    pub boundary: &'a BoundaryHistory,
    /// Whether the fit makes its weights (or the border) anew from the data: refits under the weights of the end then
    /// tell nothing of its bias, whose part through the border even changes its sign.
    pub follows_data: bool,
    /// How far the joint went.
    pub furthest: Option<Jump>,
}

/// One refit: the error of the scaled unknowns, and whether it ended on a bound.
type Refit = Option<(Vec<f64>, bool)>;

impl Base<'_> {
    /// `n_pairs` pairs of refits under the weights of the end; the same for any number of threads. `None` when no pair
    /// converged.
    pub(crate) fn bootstrap(&self, n_pairs: usize) -> Option<Bootstrap> {
        let pairs: Vec<[Refit; 2]> = (0..n_pairs as u64)
            .into_par_iter()
            .map(|pair| {
                let noise = self.noise(SEED + pair);
                [1.0, -1.0].map(|sign| self.refit(&noise, sign))
            })
            .collect();
        let n = self.evaluation.x.len();
        let all: Vec<&(Vec<f64>, bool)> = pairs.iter().flatten().flatten().collect();
        let errors: Vec<Vec<f64>> = all.iter().map(|(error, _)| error.clone()).collect();
        let means: Vec<Vec<f64>> = (pairs.iter())
            .filter_map(|pair| match pair {
                [Some((a, _)), Some((b, _))] => Some(a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect()),
                _ => None,
            })
            .collect();
        if means.is_empty() {
            return None;
        }
        let mean = |list: &[Vec<f64>], k: usize| list.iter().map(|e| e[k]).sum::<f64>() / list.len() as f64;
        let spread = |list: &[Vec<f64>], k: usize, about: f64| {
            (list.iter().map(|e| (e[k] - about).powi(2)).sum::<f64>() / (list.len() as f64 - 1.0).max(1.0)).sqrt()
        };
        let bias: Vec<f64> = (0..n).map(|k| mean(&means, k)).collect();
        let count = means.len() as f64;
        Some(Bootstrap {
            draws: 2 * n_pairs,
            failed: 2 * n_pairs - errors.len(),
            on_bound: all.iter().filter(|(_, on_bound)| *on_bound).count(),
            bias_std: (means.len() > 1).then(|| (0..n).map(|k| spread(&means, k, bias[k]) / count.sqrt()).collect()),
            std: (0..n).map(|k| spread(&errors, k, bias[k])).collect(),
            bias,
            errors,
        })
    }

    /// What one pair of opposite draws moves the unknowns by, to second order: the even and the odd part of what the
    /// linear theory does not predict. `None` where a forward run has no solution. Two evaluations.
    pub(crate) fn probe(&self) -> Option<[Vec<f64>; 2]> {
        let noise = self.noise(SEED);
        let predicted = self.predicted(&noise);
        let off: Vec<Vec<f64>> = [1.0, -1.0]
            .into_par_iter()
            .map(|sign| {
                let (problem, boundary) = self.simulate(&noise, sign)?;
                let evaluation = problem.evaluate(&self.start(&predicted, sign), &boundary).ok().flatten()?;
                let local = evaluation.local(self.weights, &problem.noise);
                let b = Dense::from_fn(local.b.len(), 1, |k, _| local.b[k]);
                let step = local.h.cholesky().ok()?.solve(&b).column(0).to_vec();
                step.iter().all(|s| s.is_finite()).then_some(step)
            })
            .collect::<Option<_>>()?;
        let part = |sign: f64| off[0].iter().zip(&off[1]).map(|(a, b)| 0.5 * (a + sign * b)).collect();
        Some([part(1.0), part(-1.0)])
    }

    /// Noise of all rows at every instant of the boundary, mm.
    fn noise(&self, seed: u64) -> Vec<Vec<f64>> {
        let noise = &self.problem.noise;
        let factor = self.statistics.sigma / noise.sigma.unwrap_or(1.0);
        let mut drawn = noise.draw(self.boundary.instants().len(), seed);
        drawn.iter_mut().flatten().for_each(|e| *e *= factor);
        drawn
    }

    /// `dz = A sum_i v_i^T e_i`.
    fn predicted(&self, noise: &[Vec<f64>]) -> Vec<f64> {
        let statistics = self.statistics;
        let mut sum = Dense::zeros(statistics.a.n_rows(), 1);
        for (observed, v) in self.problem.observation.instants.iter().zip(&statistics.v) {
            let e = &noise[observed.index];
            sum.add(1.0, &v.transposed_times(&Dense::from_fn(e.len(), 1, |row, _| e[row])));
        }
        statistics.a.times(&sum).column(0).to_vec()
    }

    /// The parameters that linear theory predicts for the draw, within the bounds.
    fn start(&self, predicted: &[f64], sign: f64) -> Vec<f64> {
        let unknowns = &self.problem.unknowns;
        let z = unknowns.scaled(&self.evaluation.x);
        unknowns.unscaled(&z.iter().zip(predicted).map(|(z, d)| z + (sign * d).clamp(-1.0, 1.0)).collect::<Vec<_>>())
    }

    /// The problem and the border that the fitted model gives with this noise.
    fn simulate(&self, noise: &[Vec<f64>], sign: f64) -> Option<(Problem<'_>, BoundaryHistory)> {
        let Problem { joint, observation, border, noise: known, unknowns, watch } = self.problem;
        let mut data = (**observation).clone();
        for observed in &mut data.instants {
            let u = &self.evaluation.solution.instants[observed.index].displacement;
            let e = &noise[observed.index];
            if let (Some(cell), Some(row)) = (&mut data.force, observation.force_row())
                && cell.at(observed.index).is_some()
            {
                let law = unknowns.law_at(&self.evaluation.x).ok()?;
                let computed = cell.width_mm * cell.reaction(self.evaluation.model(self.problem), &*law, u).value;
                cell.values[observed.index] = Some(computed + sign * e[row]);
            }
            for (row, value) in observed.displacement.iter_mut().enumerate() {
                *value = u[observation.nodes[row / 2] as usize][row % 2] + sign * e[row];
            }
        }
        let boundary = if observation.prescribed.is_empty() {
            self.boundary.clone()
        } else {
            let moved = |(values, e): (Vec<[f64; 2]>, &Vec<f64>)| {
                let measured = observation.prescribed.iter().flat_map(|&row| [e[2 * row], e[2 * row + 1]]).collect();
                let errors = border.errors(measured);
                let moved_node = |(u, e): (&[f64; 2], &[f64; 2])| [0, 1].map(|c| u[c] + sign * e[c]);
                values.iter().zip(errors.as_chunks::<2>().0).map(moved_node).collect()
            };
            let values = prescribed_of(joint, self.boundary);
            joint.measured.boundary(values.into_iter().zip(noise).map(moved).collect()).ok()?
        };
        let unknowns = unknowns.starting_at(&self.evaluation.x).ok()?;
        let (border, noise, watch) = (Arc::clone(border), Arc::clone(known), watch.clone());
        Some((Problem { joint, observation: Arc::new(data), border, noise, unknowns, watch }, boundary))
    }

    fn refit(&self, noise: &[Vec<f64>], sign: f64) -> Refit {
        let (problem, boundary) = self.simulate(noise, sign)?;
        let covariance = &self.statistics.covariance;
        let n = covariance.n_rows();
        let least = (0..n).map(|k| covariance[(k, k)].sqrt()).fold(f64::INFINITY, f64::min);
        let region = TrustRegionOptions {
            step_tolerance: (SHARE * least).min(1e-2),
            max_evaluations: EVALUATIONS,
            ..TrustRegionOptions::default()
        };
        let from = |start: &[f64]| run(&problem, &boundary, self.weights, start, None, &region);
        let mut end = from(&self.start(&self.predicted(noise), sign));
        if end.status == FitStatus::NoStart {
            end = from(&self.evaluation.x);
        }
        let z = problem.unknowns.scaled(&self.evaluation.x);
        let [lower, upper] = problem.unknowns.scaled_bounds();
        let on_bound = (0..n).any(|k| end.z[k] <= lower[k] || end.z[k] >= upper[k]);
        let error: Vec<f64> = end.z.iter().zip(&z).map(|(end, z)| end - z).collect();
        let usable = end.status == FitStatus::Converged && error.iter().all(|e| e.is_finite());
        usable.then_some((error, on_bound))
    }
}
