//! What is known where the search of several tests ended.

use super::search::{Searched, TestWeights, evaluate_tests, locals_of, sum_of};
use crate::identify::intervals::statistics::Led;
use crate::identify::{Evaluation, FitError, Local, Statistics};
use crate::linalg::Dense;

/// The tests where the search ended.
pub(super) struct Known {
    pub evaluations: Vec<Evaluation>,
    /// Objective and derivatives of each test, in units of its noise.
    pub locals: Vec<Local>,
    pub sum: Local,
    /// What noise does; `None` where all tests together say nothing of some combination of the unknowns.
    pub led: Option<LedTogether>,
}

/// What the noise of several tests does to the unknowns that they share.
pub(super) struct LedTogether {
    /// Of each test, with the inverse of the normal matrix of all: `dz = A sum_k sum_i v_ki^T e_ki`.
    pub statistics: Vec<Statistics>,
    /// Covariance of the gradient that the noise of each test makes.
    pub spreads: Vec<Dense>,
}

impl Known {
    /// That of `tests` under `weights` at the scaled unknowns `z`, where there is a solution. Errors: a tangent without
    /// inverse.
    pub(super) fn at(tests: &[Searched<'_>], weights: &[TestWeights], z: &[f64]) -> Result<Self, FitError> {
        let x = tests[0].problem.unknowns.unscaled(z);
        let evaluations = evaluate_tests(tests, &x, true).ok_or(FitError::Lost)?;
        let locals = locals_of(tests, &evaluations, weights);
        let sum = sum_of(&locals);
        let led = match sum.h.cholesky() {
            Ok(factor) => Some(LedTogether::new(tests, weights, &evaluations, &locals, &factor.inverse())?),
            Err(_) => None,
        };
        Ok(Self { evaluations, locals, sum, led })
    }
}

impl LedTogether {
    fn new(
        tests: &[Searched<'_>],
        weights: &[TestWeights],
        evaluations: &[Evaluation],
        locals: &[Local],
        a: &Dense,
    ) -> Result<Self, FitError> {
        let (mut statistics, mut spreads) = (Vec::new(), Vec::new());
        for (((test, weights), evaluation), local) in tests.iter().zip(weights).zip(evaluations).zip(locals) {
            let (one, spread) = of_test(test, weights, evaluation, local, a)?;
            statistics.push(one);
            spreads.push(spread);
        }
        let mut sum = Dense::zeros(a.n_rows(), a.n_rows());
        spreads.iter().for_each(|spread| sum.add(1.0, spread));
        let covariance = a.times(&sum).times(a);
        let n = a.n_rows();
        // Symmetric to the last bit, as the inverse is.
        let covariance = Dense::from_fn(n, n, |r, c| 0.5 * (covariance[(r, c)] + covariance[(c, r)]));
        statistics.iter_mut().for_each(|one| one.covariance = covariance.clone());
        Ok(Self { statistics, spreads })
    }
}

/// The statistics of one test, with the covariance still to come, and the covariance of the gradient that its noise
/// makes.
fn of_test(
    test: &Searched<'_>,
    TestWeights { weights, factor: f }: &TestWeights,
    evaluation: &Evaluation,
    local: &Local,
    a: &Dense,
) -> Result<(Statistics, Dense), FitError> {
    let (noise, f) = (&test.problem.noise, *f);
    let Led { mut v, by_boundary, of_diagonal } = Led::new(test.problem, evaluation, weights)?;
    let n = a.n_rows();
    let times = |factor: f64, m: &Dense| Dense::from_fn(m.n_rows(), m.n_columns(), |r, c| factor * m[(r, c)]);
    v.iter_mut().for_each(|v| *v = times(f, v));
    let trace = |m: &Dense| (0..n).map(|r| (0..n).map(|c| a[(r, c)] * m[(c, r)]).sum::<f64>()).sum::<f64>();
    let n_data = test.problem.n_data() as f64;
    let (sigma2, spread, expected) = match of_diagonal {
        None => {
            let left = (n_data - trace(&local.h)).max(1.0);
            match noise.sigma {
                // The weights hold 1/sigma^2.
                Some(sigma) => (sigma * sigma, times(f, &local.h), f * left),
                None => {
                    let sigma2 = local.omega / f / left;
                    (sigma2, times(f * sigma2, &local.h), local.omega)
                }
            }
        }
        Some((unit, spread)) => {
            let left = (unit - f * trace(&spread)).max(f64::MIN_POSITIVE);
            let sigma2 = noise.sigma.map_or(local.omega / f / left, |sigma| sigma * sigma);
            (sigma2, times(f * f * sigma2, &spread), f * sigma2 * left)
        }
    };
    let statistics = Statistics {
        a: a.clone(),
        v,
        by_boundary,
        covariance: Dense::zeros(n, n),
        sigma: sigma2.sqrt(),
        sigma_estimated: noise.sigma.is_none(),
        expected_omega: expected,
    };
    Ok((statistics, spread))
}
