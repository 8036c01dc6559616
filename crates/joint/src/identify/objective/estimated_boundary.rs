//! Prescribed displacements as unknowns beside the parameters, with their covariance (THEORY 7): it removes the bias
//! that noise of the boundary makes through plasticity.

use crate::identify::solve::stage::at;
use crate::identify::{
    Evaluation, FitError, FitOptions, FitStatus, Iteration, Noise, Problem, Stage, StepRegion, Weights, cone_step,
    full_weights, prescribed_of, room,
};
use crate::linalg::Dense;
use crate::mechanics::BoundaryHistory;

/// Linearisations at most.
const STEPS: usize = 40;
/// The fit ends when two steps together move every parameter by less than this share of its standard uncertainty, twice
/// in a row. The kink of the law at zero opening lets Gauss-Newton on thousands of unknowns converge slowly only.
const SHARE: f64 = 1e-2;
/// Share of the decrease along the step that a trial has to reach (Armijo).
const ENOUGH: f64 = 1e-4;
/// Shortest part of a step that is tried.
const SHORTEST: f64 = 1e-3;
/// Stands in for the standard deviation of the noise (mm) where steps are compared with it and it is not known.
const UNKNOWN_SIGMA: f64 = 1e-4;

/// Corrections of the coefficients of the border ([`crate::identify::Border`]) at each instant compared.
type Corrections = Vec<Vec<f64>>;

/// Where parameters and corrections are.
struct Point {
    z: Vec<f64>,
    corrections: Corrections,
    boundary: BoundaryHistory,
    evaluation: Evaluation,
    omega: f64,
}

/// What stays while they move.
struct Search<'a> {
    problem: &'a Problem<'a>,
    /// Displacements of the prescribed nodes before any correction.
    given: Vec<Vec<[f64; 2]>>,
    /// The weights of all rows, the prescribed ones among them.
    whole: Weights,
    bounds: [Vec<f64>; 2],
    /// Number of this stage.
    number: usize,
}

/// Where the search ended, with what was computed there.
pub(crate) struct Estimated {
    /// The prescribed displacements.
    pub boundary: BoundaryHistory,
    /// Their largest correction, mm.
    pub largest_correction: f64,
    /// The objective's ingredients.
    pub evaluation: Evaluation,
    /// The full weights.
    pub weights: Weights,
}

/// Gauss-Newton on parameters and prescribed displacements together, the latter eliminated instant by instant, with a
/// line search on the objective of both.
pub(crate) fn estimate_boundary(
    problem: &Problem<'_>,
    stage: &mut Stage,
    options: &FitOptions,
) -> Result<Estimated, FitError> {
    let n_instants = problem.observation.instants.len();
    let search = Search {
        problem,
        given: prescribed_of(problem.joint, &problem.border.boundary),
        whole: problem.inverse_covariance(Vec::new())?,
        bounds: problem.unknowns.scaled_bounds(),
        number: stage.next_number(),
    };
    // While sigma is not known, the normal matrix lacks its square.
    let missing = problem.noise.sigma.map_or(UNKNOWN_SIGMA, |_| 1.0);
    let share_of = |h: &Dense, way: &[f64]| share_of_std(h, way).map_or(f64::INFINITY, |share| share / missing);
    let n = problem.border.n_coefficients(problem.joint);
    let mut point = search.begin(stage.z.clone(), vec![vec![0.0; n]; n_instants])?;
    let mut trail: Vec<Vec<f64>> = Vec::new();
    let (mut small, mut share) = (0, f64::INFINITY);
    let (status, reason, weights) = loop {
        let weights = full_weights(problem, &point.evaluation)?;
        let Weights::Inverse(inverse) = &weights else { return Err(FitError::Lost) };
        let local = point.evaluation.local(&weights, &problem.noise);
        // Steps go to and fro across the kink: what counts is the way of two.
        if let Some(before) = trail.len().checked_sub(2) {
            let way: Vec<f64> = point.z.iter().zip(&trail[before]).map(|(z, before)| z - before).collect();
            share = share_of(&local.h, &way);
            small = if share < SHARE { small + 1 } else { 0 };
        }
        if small > 1 {
            break (FitStatus::Converged, format!("two steps moved by {share:.1e} of the uncertainty"), weights);
        }
        if let Some(ended) = problem.watch.ended() {
            break (ended.status(), format!("{} after {} linearisations", ended.reason(), trail.len()), weights);
        }
        if trail.len() >= STEPS {
            let reason = format!("two steps still moved by {share:.1e} of the uncertainty");
            break (FitStatus::EvaluationLimit, reason, weights);
        }
        trail.push(point.z.clone());
        let [below, above] = room(search.bounds.each_ref().map(Vec::as_slice), &point.z);
        let region = StepRegion { lower: &below, upper: &above, radius: options.region.max_radius };
        let Some(step) = cone_step(&local.h, &local.b, &region) else { return Err(FitError::NotFinite) };
        // The rest after the step is what the corrections of the boundary have to explain.
        let rest = point.evaluation.residual_after(&step);
        let more = inverse.boundary_corrections(&problem.noise.precision, &rest);
        let slope = 2.0 * (square(&weights, &problem.noise, &rest) - point.omega);
        match search.along(&point, &step, &more, slope, stage)? {
            Some(next) => point = next,
            // Said above.
            None if problem.watch.ended().is_some() => {}
            None => {
                // No lower neighbour: the end, where the step is nothing beside the uncertainty.
                let share = share_of(&local.h, &step);
                let status = if share < SHARE { FitStatus::Converged } else { FitStatus::Stalled };
                let reason = format!("no step along the last direction ({share:.1e} of the uncertainty) goes down");
                break (status, reason, weights);
            }
        }
    };
    stage.z = point.z;
    (stage.status, stage.reason) = (status, format!("{reason}, boundary displacements estimated"));
    let moved = point.corrections.iter().flat_map(|c| problem.border.displacements(c)).flatten();
    let largest_correction = moved.fold(0.0_f64, |most, d| most.max(d.abs()));
    Ok(Estimated { boundary: point.boundary, largest_correction, evaluation: point.evaluation, weights })
}

impl Search<'_> {
    fn boundary(&self, corrections: &Corrections) -> Result<BoundaryHistory, FitError> {
        let mut values = self.given.clone();
        for (observed, correction) in self.problem.observation.instants.iter().zip(corrections) {
            for (u, d) in values[observed.index].iter_mut().zip(self.problem.border.displacements(correction)) {
                *u = [u[0] + d[0], u[1] + d[1]];
            }
        }
        self.problem.joint.measured.boundary(values).map_err(FitError::Boundary)
    }

    /// The objective of parameters and corrections: the latter are residuals of the prescribed rows.
    fn omega(&self, evaluation: &Evaluation) -> f64 {
        square(&self.whole, &self.problem.noise, &evaluation.residual())
    }

    fn begin(&self, z: Vec<f64>, corrections: Corrections) -> Result<Point, FitError> {
        let boundary = self.boundary(&corrections)?;
        let evaluation = at(self.problem, &z, &boundary)?;
        let omega = self.omega(&evaluation);
        Ok(Point { z, corrections, boundary, evaluation, omega })
    }

    /// The first of the points at the whole step, its half, its quarter, ... that is low enough; every trial is noted.
    fn along(
        &self,
        from: &Point,
        step: &[f64],
        more: &Corrections,
        slope: f64,
        stage: &mut Stage,
    ) -> Result<Option<Point>, FitError> {
        let [lower, upper] = &self.bounds;
        let mut length = 1.0;
        while length > SHORTEST {
            let moved_unknown = |k: usize| (from.z[k] + length * step[k]).clamp(lower[k], upper[k]);
            let z: Vec<f64> = (0..step.len()).map(moved_unknown).collect();
            let moved = |(c, m): (&Vec<f64>, &Vec<f64>)| c.iter().zip(m).map(|(c, m)| c + length * m).collect();
            let corrections: Corrections = from.corrections.iter().zip(more).map(moved).collect();
            let boundary = self.boundary(&corrections)?;
            let evaluation = self.problem.evaluate(&self.problem.unknowns.unscaled(&z), &boundary)?;
            let omega = evaluation.as_ref().map(|evaluation| self.omega(evaluation));
            self.problem.watch.note_trial(omega, self.problem.named(&self.problem.unknowns.unscaled(&z)));
            let accepted = omega.is_some_and(|omega| omega <= from.omega + ENOUGH * length * slope);
            let rescued = evaluation.as_ref().is_some_and(|evaluation| evaluation.rescued);
            stage.evaluations += 1;
            stage.rescued += usize::from(rescued);
            let number = self.number;
            stage.history.push(Iteration { stage: number, z: z.clone(), omega, radius: length, accepted, rescued });
            if let (Some(evaluation), Some(omega), true) = (evaluation, omega, accepted) {
                return Ok(Some(Point { z, corrections, boundary, evaluation, omega }));
            }
            length *= 0.5;
        }
        Ok(None)
    }
}

/// `r^T W r`.
fn square(weights: &Weights, noise: &Noise, r: &[Dense]) -> f64 {
    r.iter().zip(&weights.times(noise, r)).map(|(r, wr)| r.transposed_times(wr)[(0, 0)]).sum()
}

/// The largest component of `way` as a share of the standard uncertainty that the normal matrix `h` stands for.
fn share_of_std(h: &Dense, way: &[f64]) -> Option<f64> {
    let covariance = h.cholesky().ok()?.inverse();
    let share = |k: usize| way[k].abs() / covariance[(k, k)].sqrt();
    Some((0..way.len()).map(share).fold(0.0, f64::max))
}
