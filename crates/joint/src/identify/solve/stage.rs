//! The stages of a fit: one start under fixed weights, and the same again under weights made where that ended.

use crate::identify::{
    End, Evaluation, FitError, FitStatus, Iteration, Local, Problem, TrustRegionOptions, Weights, minimise_unless,
};
use crate::mechanics::BoundaryHistory;

/// Most fits under weights that are made anew. What new weights change falls by a factor of 100 from one to the next.
const REWEIGHTINGS: usize = 5;
/// Scaled step at which a fit ends whose weights are made anew afterwards; when new weights change less, the next are
/// the last.
pub(crate) const COARSE: f64 = 1e-4;

/// What a stage hands to the next.
pub(crate) struct Stage {
    pub z: Vec<f64>,
    pub status: FitStatus,
    pub reason: String,
    pub evaluations: usize,
    pub rescued: usize,
    pub history: Vec<Iteration>,
}

impl Stage {
    pub fn of(end: End) -> Self {
        let (rescued, End { z, status, reason, evaluations, history, .. }) = (end.rescued(), end);
        Self { z, status, reason, evaluations, rescued, history }
    }

    /// Number of the stage that comes after those in the history.
    pub fn next_number(&self) -> usize {
        self.history.last().map_or(1, |iteration| iteration.stage + 1)
    }

    pub fn add(&mut self, mut end: End) {
        let number = self.next_number();
        end.history.iter_mut().for_each(|iteration| iteration.stage = number);
        self.rescued += end.rescued();
        self.evaluations += end.evaluations;
        (self.z, self.status, self.reason) = (end.z, end.status, end.reason);
        self.history.extend(end.history);
    }
}

/// One start of the unknowns of `problem` under fixed weights, of which `local_at` makes the objective.
pub(crate) fn run_with(
    problem: &Problem<'_>,
    start: &[f64],
    region: &TrustRegionOptions,
    mut local_at: impl FnMut(&[f64]) -> Option<Local>,
) -> End {
    let (unknowns, watch) = (&problem.unknowns, &problem.watch);
    let [lower, upper] = unknowns.scaled_bounds();
    let evaluate = |z: &[f64]| {
        let x = unknowns.unscaled(z);
        let local = local_at(&x).filter(|local| local.omega.is_finite());
        watch.note_trial(local.as_ref().map(|local| local.omega), problem.named(&x));
        local
    };
    let ended = || watch.ended().map(|ended| (ended.status(), ended.reason()));
    let limits = |z: &[f64]| unknowns.scaled_limits(z);
    minimise_unless(&unknowns.scaled(start), [&lower, &upper], region, evaluate, limits, ended)
}

/// The same of the data of `problem`; `known` is what is known at the start.
pub(crate) fn run(
    problem: &Problem<'_>,
    boundary: &BoundaryHistory,
    weights: &Weights,
    start: &[f64],
    mut known: Option<Evaluation>,
    region: &TrustRegionOptions,
) -> End {
    run_with(problem, start, region, |x| {
        let evaluation = known.take().or_else(|| problem.evaluate(x, boundary).ok().flatten());
        evaluation.map(|evaluation| evaluation.local(weights, &problem.noise))
    })
}

/// Fits under the inverse covariance made at the end of the fit before, until the parameters stand still; gives the
/// weights.
pub(crate) fn reweight(
    problem: &Problem<'_>,
    stage: &mut Stage,
    tolerances: &TrustRegionOptions,
) -> Result<Weights, FitError> {
    let measured = &problem.border.boundary;
    let (mut coarse, mut round) = (true, 0);
    loop {
        round += 1;
        let evaluation = at(problem, &stage.z, measured)?;
        let weights = full_weights(problem, &evaluation)?;
        let step_tolerance = if coarse { COARSE } else { tolerances.step_tolerance };
        let region = TrustRegionOptions { first_radius: 0.1, step_tolerance, ..*tolerances };
        let before = stage.z.clone();
        let start = evaluation.x.clone();
        stage.add(run(problem, measured, &weights, &start, Some(evaluation), &region));
        if !coarse || stage.status != FitStatus::Converged {
            return Ok(weights);
        }
        coarse = round < REWEIGHTINGS && distance(&before, &stage.z) > COARSE;
    }
}

/// The ingredients at `z`, where there must be a solution: it was reached before.
pub(crate) fn at(problem: &Problem<'_>, z: &[f64], boundary: &BoundaryHistory) -> Result<Evaluation, FitError> {
    problem.evaluate_again(&problem.unknowns.unscaled(z), boundary)?.ok_or(FitError::Lost)
}

/// The inverse covariance at `evaluation`.
pub(crate) fn full_weights(problem: &Problem<'_>, evaluation: &Evaluation) -> Result<Weights, FitError> {
    problem.inverse_covariance(problem.by_boundary(evaluation)?)
}

/// The largest difference.
pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}
