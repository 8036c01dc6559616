//! The search for the parameters that all tests share.

use crate::identify::FitError;
use crate::identify::cases::options::FitOptions;
use crate::identify::objective::problem::{Evaluation, Problem};
use crate::identify::objective::unknowns::Unknowns;
use crate::identify::objective::weights::{InverseCovariance, Weights};
use crate::identify::solve::stage::{COARSE, Stage, distance, full_weights, no_texture};
use crate::identify::solve::trust_region::{End, FitStatus, Local, TrustRegionOptions, minimise_unless};
use crate::io::case::WeightKind;
use crate::linalg::Dense;
use rayon::prelude::*;

/// Most fits under weights that are made anew, as of a single test.
const REWEIGHTINGS: usize = 5;

/// One test of several, as the search sees it.
pub(super) struct Searched<'a> {
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
        let problem = self.problem;
        Ok(match self.options.weights {
            WeightKind::Covariance if !self.noisy_boundary() => {
                let n = problem.observation.instants.len();
                Weights::Inverse(InverseCovariance::new(&problem.noise, n, Vec::new()).map_err(no_texture)?)
            }
            kind => problem.diagonal_weights(kind),
        })
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
        let (problem, boundary) = (test.problem, &test.problem.joint.boundary);
        let found = if again { problem.evaluate_again(x, boundary) } else { problem.evaluate(x, boundary) };
        found.ok().flatten()
    };
    tests.par_iter().map(one).collect()
}

/// The objective of one test, in units of its noise.
pub(super) fn local_of(test: &Searched<'_>, evaluation: &Evaluation, weights: &TestWeights) -> Local {
    let Local { omega, b, h, rescued } = evaluation.local(&weights.weights, &test.problem.noise);
    let f = weights.factor;
    let n = h.n_rows();
    let h = Dense::from_fn(n, n, |r, c| f * h[(r, c)]);
    Local { omega: f * omega, b: b.iter().map(|b| f * b).collect(), h, rescued }
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
pub(super) fn run(
    tests: &[Searched<'_>],
    weights: &[TestWeights],
    unknowns: &Unknowns,
    start: &[f64],
    region: &TrustRegionOptions,
) -> End {
    let [lower, upper] = unknowns.scaled_bounds();
    let watch = &tests[0].problem.watch;
    let evaluate = |z: &[f64]| {
        let x = unknowns.unscaled(z);
        let local = evaluate_tests(tests, &x, false).map(|evaluations| {
            let locals: Vec<Local> =
                (tests.iter().zip(&evaluations).zip(weights)).map(|((t, e), w)| local_of(t, e, w)).collect();
            sum_of(&locals)
        });
        let local = local.filter(|local| local.omega.is_finite());
        watch.note_trial(local.as_ref().map(|local| local.omega), tests[0].problem.named(&x));
        local
    };
    let ended = || watch.ended().map(|ended| (ended.status(), ended.reason()));
    let limits = |z: &[f64]| unknowns.scaled_limits(z);
    minimise_unless(&unknowns.scaled(start), [&lower, &upper], region, evaluate, limits, ended)
}

/// Where the search ended.
pub(super) struct Found {
    pub stage: Stage,
    pub weights: Vec<TestWeights>,
    pub ends: Vec<End>,
    pub best: usize,
}

/// Fits all `tests` from `starts`; `better` chooses among the ends.
///
/// # Errors
/// A covariance or a tangent without inverse. No start with a solution is an end without an objective.
pub(super) fn search(
    tests: &[Searched<'_>],
    unknowns: &Unknowns,
    starts: &[Vec<f64>],
    region: &TrustRegionOptions,
    better: impl Fn(&[End]) -> usize,
) -> Result<Found, FitError> {
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
    let ends: Vec<End> = starts.par_iter().map(|start| run(tests, &weights, unknowns, start, &coarse)).collect();
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
        stage.add(run(tests, &weights, unknowns, &x, &again));
        let still = distance(&before, &stage.z) <= COARSE;
        go_on = stage.status == FitStatus::Converged && !last;
        if go_on && still {
            // What new weights would change is below what the last digits are worth; those are made under these.
            let fine = TrustRegionOptions { first_radius: 0.1, ..*region };
            stage.add(run(tests, &weights, unknowns, &unknowns.unscaled(&stage.z), &fine));
            go_on = false;
        }
    }
    Ok(Found { stage, weights, ends, best })
}
