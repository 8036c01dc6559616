//! The search for the parameters that all tests share.

use crate::identify::solve::stage::{distance, run_with};
use crate::identify::{
    COARSE, End, Evaluation, FitError, FitOptions, FitStatus, Local, Problem, Stage, TrustRegionOptions, Weights,
    full_weights,
};
use crate::io::case::WeightKind;
use crate::linalg::Dense;
use rayon::prelude::*;

/// Most fits under weights that are made anew, as of a single test.
const REWEIGHTINGS: usize = 5;

/// One test of several, as the search sees it.
pub(super) struct Searched<'a> {
    pub name: &'a str,
    pub problem: &'a Problem<'a>,
    pub options: &'a FitOptions,
}

/// The weights of one test, and the factor that brings its objective to units of its noise.
pub(super) struct TestWeights {
    pub weights: Weights,
    pub factor: f64,
}

impl Searched<'_> {
    fn noisy_boundary(&self) -> bool {
        !self.problem.observation.prescribed.is_empty()
    }

    /// Whether its weights or their factor follow the parameters.
    fn follows(&self) -> bool {
        let covariance = self.options.weights == WeightKind::Covariance;
        (covariance && self.noisy_boundary()) || self.problem.noise.sigma.is_none()
    }

    /// The weights to begin with.
    fn first(&self) -> Result<Weights, FitError> {
        self.problem.first_weights(self.options.weights)
    }

    /// `weights` with the factor after which the objective is about the number of data: by the noise where that is
    /// known, else by the residual of `evaluation`.
    fn scaled(&self, weights: Weights, evaluation: &Evaluation) -> TestWeights {
        let (noise, n) = (&self.problem.noise, self.problem.observation.n_data() as f64);
        let expected = match (&weights, noise.sigma) {
            (Weights::Inverse(_), Some(_)) => n,
            (Weights::Diagonal(rows), Some(sigma)) => {
                let sum: f64 = rows.iter().flatten().sum();
                sum * sigma * sigma * noise.mean_variance()
            }
            (_, None) => evaluation.local(&weights, noise).omega,
        };
        let factor = n / expected;
        TestWeights { weights, factor: if factor.is_finite() && factor > 0.0 { factor } else { 1.0 } }
    }
}

/// The tests at one set of parameters; `None` where one of them has no solution. `again`: also when the fit has to end.
pub(super) fn evaluate_tests(tests: &[Searched<'_>], x: &[f64], again: bool) -> Option<Vec<Evaluation>> {
    let one = |test: &Searched<'_>| {
        let (problem, boundary) = (test.problem, &test.problem.border.boundary);
        let found = if again { problem.evaluate_again(x, boundary) } else { problem.evaluate(x, boundary) };
        found.ok().flatten()
    };
    tests.par_iter().map(one).collect()
}

/// The objective of each test, in units of its noise.
pub(super) fn locals_of(tests: &[Searched<'_>], evaluations: &[Evaluation], weights: &[TestWeights]) -> Vec<Local> {
    let one = |((test, evaluation), of): ((&Searched<'_>, &Evaluation), &TestWeights)| {
        evaluation.local(&of.weights, &test.problem.noise).times(of.factor)
    };
    tests.iter().zip(evaluations).zip(weights).map(one).collect()
}

/// The sum of the objectives of all tests.
pub(super) fn sum_of(locals: &[Local]) -> Local {
    let n = locals[0].b.len();
    let mut sum = Local { omega: 0.0, b: vec![0.0; n], h: Dense::zeros(n, n), rescued: false };
    for local in locals {
        sum.omega += local.omega;
        sum.b.iter_mut().zip(&local.b).for_each(|(sum, b)| *sum += b);
        sum.h.add(1.0, &local.h);
        sum.rescued |= local.rescued;
    }
    sum
}

/// One start under fixed weights.
pub(super) fn run(tests: &[Searched<'_>], weights: &[TestWeights], start: &[f64], region: &TrustRegionOptions) -> End {
    run_with(tests[0].problem, start, region, |x| {
        evaluate_tests(tests, x, false).map(|evaluations| sum_of(&locals_of(tests, &evaluations, weights)))
    })
}

/// Where the search ended.
pub(super) struct Found {
    pub stage: Stage,
    pub weights: Vec<TestWeights>,
    pub ends: Vec<End>,
    pub best: usize,
}

/// Fits all `tests` from `starts`; `better` chooses among the ends. Errors: a covariance or a tangent without inverse.
/// No start with a solution is an end without an objective.
pub(super) fn search(
    tests: &[Searched<'_>],
    starts: &[Vec<f64>],
    region: &TrustRegionOptions,
    better: impl Fn(&[End]) -> usize,
) -> Result<Found, FitError> {
    let unknowns = &tests[0].problem.unknowns;
    let first = evaluate_tests(tests, &starts[0], false);
    let begin = |(k, test): (usize, &Searched<'_>)| -> Result<TestWeights, FitError> {
        let weights = test.first()?;
        Ok(match &first {
            Some(evaluations) => test.scaled(weights, &evaluations[k]),
            None => TestWeights { weights, factor: 1.0 },
        })
    };
    let mut weights: Vec<TestWeights> = tests.iter().enumerate().map(begin).collect::<Result<_, _>>()?;
    let follows = tests.iter().any(Searched::follows);
    let tolerance = if follows && starts.len() == 1 { COARSE } else { region.step_tolerance };
    let coarse = TrustRegionOptions { step_tolerance: tolerance, ..*region };
    let ends: Vec<End> = starts.par_iter().map(|start| run(tests, &weights, start, &coarse)).collect();
    let best = better(&ends);
    let mut stage = Stage::of(ends[best].clone());
    let mut round = 0;
    let mut go_on = follows && stage.status == FitStatus::Converged;
    while go_on {
        round += 1;
        let x = unknowns.unscaled(&stage.z);
        let evaluations = evaluate_tests(tests, &x, true).ok_or(FitError::Lost)?;
        let made = |(test, evaluation): (&Searched<'_>, &Evaluation)| -> Result<TestWeights, FitError> {
            let whole = test.options.weights == WeightKind::Covariance && test.noisy_boundary();
            let weights = if whole { full_weights(test.problem, evaluation)? } else { test.first()? };
            Ok(test.scaled(weights, evaluation))
        };
        weights = tests.iter().zip(&evaluations).map(made).collect::<Result<_, _>>()?;
        let last = round > REWEIGHTINGS;
        let step_tolerance = if last { region.step_tolerance } else { COARSE };
        let before = stage.z.clone();
        let again = TrustRegionOptions { first_radius: 0.1, step_tolerance, ..*region };
        stage.add(run(tests, &weights, &x, &again));
        let still = distance(&before, &stage.z) <= COARSE;
        go_on = stage.status == FitStatus::Converged && !last;
        if go_on && still {
            // What new weights would change is below what the last digits are worth; those are made under these.
            let fine = TrustRegionOptions { first_radius: 0.1, ..*region };
            stage.add(run(tests, &weights, &unknowns.unscaled(&stage.z), &fine));
            go_on = false;
        }
    }
    Ok(Found { stage, weights, ends, best })
}
