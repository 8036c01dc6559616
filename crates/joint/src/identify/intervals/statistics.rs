//! What the noise of the measurement does to the parameters (THEORY 7 and 9).

use crate::identify::{Evaluation, FitError, Problem, Weights, scale};
use crate::linalg::Dense;
use rayon::prelude::*;
use std::ops::Deref;

/// 97.5 % of a normal distribution lie below this many standard deviations.
pub const NORMAL_95: f64 = 1.959963984540054;

/// The estimate as a linear function of the noise: `dz = A sum_i v_i^T e_i`, `e_i` the noise of the rows at instant
/// `i`.
#[derive(Debug)]
pub struct Statistics {
    /// `A = (J^T W J)^-1`, of the scaled unknowns.
    pub a: Dense,
    /// `v_i`.
    pub v: Vec<Dense>,
    /// Derivatives of the rows by the coefficients of the border at each instant; empty where it has no noise.
    pub by_boundary: Vec<Dense>,
    /// Covariance of the scaled unknowns that the noise of the measurement gives.
    pub covariance: Dense,
    /// `sigma` of the noise: given, or estimated from the objective.
    pub sigma: f64,
    /// Whether it was estimated.
    pub sigma_estimated: bool,
    /// The objective that such noise leaves on average; where sigma is estimated, the objective itself.
    pub expected_omega: f64,
}

impl Statistics {
    /// The statistics of a fit that ended at `evaluation`, where the objective is `omega`.
    ///
    /// `None` when `J^T W J` has no inverse: the data say nothing of some combination of the unknowns.
    ///
    /// # Errors
    /// A tangent without inverse.
    pub fn new(problem: &Problem<'_>, evaluation: &Evaluation, weights: &Weights) -> Result<Option<Self>, FitError> {
        let noise = &problem.noise;
        let local = evaluation.local(weights, noise);
        let Some(factor) = local.h.cholesky().ok().filter(|_| !local.is_singular()) else { return Ok(None) };
        let a = factor.inverse();
        let Led { v, by_boundary, of_diagonal } = Led::new(problem, evaluation, weights)?;
        let n = problem.n_data() as f64;
        let p = problem.unknowns.n() as f64;
        let Some((unit, spread)) = of_diagonal else {
            // v holds 1/sigma^2 where sigma is known.
            let given = noise.sigma.map_or(1.0, |sigma| sigma * sigma);
            let unknown = noise.sigma.is_none();
            let sigma2 = if unknown { local.omega / (n - p).max(1.0) } else { given };
            let mut covariance = a.clone();
            if unknown {
                scale(&mut covariance, sigma2);
            }
            let expected_omega = if unknown { local.omega } else { n - p };
            let (sigma, sigma_estimated) = (sigma2.sqrt(), unknown);
            return Ok(Some(Self { a, v, by_boundary, covariance, sigma, sigma_estimated, expected_omega }));
        };
        let mut covariance = a.times(&spread).times(&a);
        let taken: f64 =
            (0..a.n_rows()).map(|k| (0..a.n_rows()).map(|j| a[(k, j)] * spread[(j, k)]).sum::<f64>()).sum();
        let left = (unit - taken).max(f64::MIN_POSITIVE);
        let sigma2 = noise.sigma.map_or(local.omega / left, |sigma| sigma * sigma);
        scale(&mut covariance, sigma2);
        Ok(Some(Self {
            a,
            v,
            by_boundary,
            covariance,
            sigma: sigma2.sqrt(),
            sigma_estimated: noise.sigma.is_none(),
            expected_omega: sigma2 * left,
        }))
    }

    /// How the scaled estimate moves when the computed displacements of the rows change by `moved`, a column for each
    /// instant: `-A sum_i v_i^T U_i`.
    pub fn shift(&self, moved: &[Dense]) -> Vec<f64> {
        let mut sum = Dense::zeros(self.a.n_rows(), 1);
        self.v.iter().zip(moved).for_each(|(v, moved)| sum.add(-1.0, &v.transposed_times(moved)));
        self.a.times(&sum).column(0).to_vec()
    }
}

/// How the noise of a measurement leads to the gradient of its objective: what does not depend on what else is fitted.
pub(crate) struct Led {
    /// `v_i`, of which `sum_i v_i^T e_i` is the gradient that the noise `e` makes.
    pub v: Vec<Dense>,
    /// Derivatives of the rows by the coefficients of the border at each instant; empty where it has no noise.
    pub by_boundary: Vec<Dense>,
    /// Under diagonal weights the objective that noise of sigma 1 has before anything is fitted, and the covariance of
    /// the gradient that it makes; under the inverse covariance both follow from the normal matrix.
    pub of_diagonal: Option<(f64, Dense)>,
}

impl Led {
    /// That of `evaluation` under `weights`. Errors: a tangent without inverse.
    pub(crate) fn new(problem: &Problem<'_>, evaluation: &Evaluation, weights: &Weights) -> Result<Self, FitError> {
        let (noise, observation) = (&problem.noise, &problem.observation);
        let by_boundary = problem.by_boundary(evaluation)?;
        let mut v = weights.times(noise, &evaluation.jacobian());
        let Weights::Diagonal(diagonal) = weights else { return Ok(Self { v, by_boundary, of_diagonal: None }) };
        // The residual is (I, -S) e: what is prescribed wrongly comes back through the model.
        let by_measured: Vec<_> = by_boundary.par_iter().map(|t| problem.border.by_measured(t)).collect();
        for (v, t) in v.iter_mut().zip(&by_measured) {
            let back = t.transposed_times(v);
            for (k, &node) in observation.prescribed.iter().enumerate() {
                for c in 0..2 {
                    (0..v.n_columns()).for_each(|j| v[(2 * node + c, j)] -= back[(2 * k + c, j)]);
                }
            }
        }
        let trace = |i: usize| problem.trace(&diagonal[i], by_measured.get(i).map(Deref::deref));
        let traces: Vec<f64> = (0..diagonal.len()).into_par_iter().map(trace).collect();
        let unit = (1.0 + noise.common) * traces.iter().sum::<f64>();
        let spread = problem.spread(&v);
        drop(by_measured);
        Ok(Self { v, by_boundary, of_diagonal: Some((unit, spread)) })
    }
}

impl Problem<'_> {
    /// `sum_i v_i^T C v_i + common (sum v)^T C (sum v)` for `C = M^-1`.
    fn spread(&self, v: &[Dense]) -> Dense {
        let c = &self.noise.precision;
        let parts: Vec<Dense> = v.par_iter().map(|v| v.transposed_times(&c.inverse_times(v))).collect();
        let mut sum = Dense::zeros(v[0].n_columns(), v[0].n_columns());
        parts.iter().for_each(|part| sum.add(1.0, part));
        if self.noise.common > 0.0 {
            let mut all = Dense::zeros(v[0].n_rows(), v[0].n_columns());
            v.iter().for_each(|v| all.add(1.0, v));
            c.leave_force_out(&mut all);
            sum.add(self.noise.common, &all.transposed_times(&c.inverse_times(&all)));
        }
        sum
    }

    /// `sum_k w_k (B C B^T)_kk` over the compared rows, `B = (I, -S)`, `S` the derivatives by the measured border.
    fn trace(&self, weights: &[f64], by_measured: Option<&Dense>) -> f64 {
        let observation = &self.observation;
        let rows: Vec<usize> = (0..weights.len()).filter(|&row| weights[row] > 0.0).collect();
        let mut b = Dense::zeros(observation.n_rows(), rows.len());
        for (k, &row) in rows.iter().enumerate() {
            b[(row, k)] = 1.0;
            if let Some(t) = by_measured {
                for (j, &node) in observation.prescribed.iter().enumerate() {
                    (0..2).for_each(|c| b[(2 * node + c, k)] -= t[(row, 2 * j + c)]);
                }
            }
        }
        let cb = self.noise.precision.inverse_times(&b);
        // A force has nothing in common with other instants; what is said here is multiplied by 1 + common.
        let force = observation.force_row();
        let variance = |k: usize| {
            let whole = b.column(k).iter().zip(cb.column(k)).map(|(a, b)| a * b).sum::<f64>();
            let common = self.noise.common / (1.0 + self.noise.common);
            if force == Some(rows[k]) { whole - common * cb[(rows[k], k)] } else { whole }
        };
        rows.iter().enumerate().map(|(k, &row)| weights[row] * variance(k)).sum()
    }
}
