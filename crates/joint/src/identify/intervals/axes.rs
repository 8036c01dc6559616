//! How far the parameters can go along each axis of their covariance before the objective objects: what linear theory
//! has to be replaced by where the data hardly know a parameter.

use crate::identify::{
    Base, Evaluation, FitError, FitOptions, LINEAR_STD, NORMAL_95, Problem, ProfileEnds, Statistics, Weights,
};
use crate::io::case::WeightKind;
use crate::mechanics::BoundaryHistory;
use crate::mechanics::cohesive::CohesiveLaw;

/// Scaled distance below which the search for an end has not got anywhere.
const STUCK: f64 = 0.02;

/// The axes of the likelihood of a fit, in scaled unknowns.
///
/// Along an axis of the covariance whose standard deviation is at most [`LINEAR_STD`] linear theory holds. Along the
/// others the objective is followed to where it is `1.96^2` above its minimum ([`ProfileEnds`]), on either side by
/// itself; a draw goes there in proportion. Axes are independent of one another, as they are in linear theory.
///
/// Of a law with [minima of its own](CohesiveLaw::has_own_minima) the covariance knows one of them only. There, and
/// wherever an axis is wide, the objective is followed along every unknown by itself too, from every minimum: the laws
/// that are met on the way and that the objective allows are kept.
#[derive(Debug)]
pub(crate) struct Axes {
    /// Moves at 1.96 standard deviations below and above, of each axis.
    ends: Vec<[Vec<f64>; 2]>,
    /// Works of separation at the ends of their own profiles, below and above, N/mm; `None` without an end.
    works: [[Option<f64>; 2]; 2],
    /// Laws that the objective allows.
    allowed: Vec<Box<dyn CohesiveLaw>>,
    /// Minima beside that of the fit that the objective allows.
    n_others: usize,
}

impl Axes {
    /// Those of a fit that ended at `evaluation`, whose law has more `minima` (scaled unknowns with the objective
    /// there); `None` where linear theory holds along all of them, or nothing is known of some.
    ///
    /// # Errors
    /// A covariance without inverse.
    pub fn new(
        problem: &Problem<'_>,
        (evaluation, boundary): (&Evaluation, &BoundaryHistory),
        statistics: &Statistics,
        options: &FitOptions,
        minima: &[(Vec<f64>, f64)],
    ) -> Result<Option<Self>, FitError> {
        let Some((variances, vectors)) = statistics.covariance.symmetric_eigen() else { return Ok(None) };
        let stds: Vec<f64> = variances.iter().map(|variance| variance.max(0.0).sqrt()).collect();
        let wide: Vec<usize> = (0..stds.len()).filter(|&k| stds[k] > LINEAR_STD && stds[k].is_finite()).collect();
        if wide.is_empty() && !problem.unknowns.law().has_own_minima() {
            return Ok(None);
        }
        let weights = weights_at_end(problem, statistics, options)?;
        let base =
            Base { problem, evaluation, statistics, weights: &weights, boundary, follows_data: false, furthest: None };
        let Some(profile) = ProfileEnds::new(&base) else { return Ok(None) };
        let z = problem.unknowns.scaled(&evaluation.x);
        let straight = |k: usize| {
            let move_of = |sign: f64| vectors.column(k).iter().map(|v| sign * NORMAL_95 * stds[k] * v).collect();
            [move_of(-1.0), move_of(1.0)]
        };
        let mut ends: Vec<[Vec<f64>; 2]> = (0..stds.len()).map(straight).collect();
        let directions: Vec<Vec<f64>> = wide.iter().map(|&k| vectors.column(k).to_vec()).collect();
        let minima: Vec<&Vec<f64>> =
            (minima.iter()).filter(|(minimum, omega)| profile.allows(minimum, *omega)).map(|(z, _)| z).collect();
        let mut seen: Vec<Vec<f64>> = minima.iter().map(|z| z.to_vec()).collect();
        for (&k, found) in wide.iter().zip(profile.ways(&directions)) {
            for (end, found) in ends[k].iter_mut().zip(found) {
                let way: Vec<f64> = found.last.iter().zip(&z).map(|(end, z)| end - z).collect();
                seen.extend(found.allowed);
                let longest = |way: &[f64]| way.iter().fold(0.0_f64, |most, w| most.max(w.abs()));
                // At the end of a law the search is stuck from the first: what is beyond is left to the draws.
                if longest(&way) > STUCK {
                    *end = way;
                } else {
                    let share = (1.0 / longest(end)).min(1.0);
                    end.iter_mut().for_each(|e| *e *= share);
                }
            }
        }
        let by = by_works(problem, &z);
        let mut works = [[None; 2]; 2];
        let law_at = |z: &[f64]| problem.unknowns.law_at(&problem.unknowns.unscaled(z)).ok();
        for (mode, found) in profile.ways(&by).into_iter().enumerate() {
            works[mode] = found.map(|way| {
                seen.extend(way.allowed);
                work_of(&*law_at(&way.end?)?, mode)
            });
        }
        let units: Vec<Vec<f64>> = (0..z.len()).map(|k| (0..z.len()).map(|j| f64::from(j == k)).collect()).collect();
        let others = minima.iter().filter_map(|minimum| profile.from(minimum));
        for profile in [&profile].into_iter().chain(&others.collect::<Vec<_>>()) {
            for (unit, ways) in units.iter().zip(profile.ways(&units)) {
                for (way, sign) in ways.into_iter().zip([-1.0, 1.0]) {
                    seen.extend(way.allowed);
                    if way.end.is_none() {
                        seen.extend(profile.straight(&unit.iter().map(|s| sign * s).collect::<Vec<_>>()));
                    }
                }
            }
        }
        let allowed: Vec<Box<dyn CohesiveLaw>> = seen.iter().filter_map(|z| law_at(z)).collect();
        for (mode, ends) in works.iter_mut().enumerate() {
            for work in allowed.iter().filter_map(|law| work_of(&**law, mode)) {
                ends[0] = ends[0].map(|low| low.min(work));
                ends[1] = ends[1].map(|high| high.max(work));
            }
        }
        Ok(Some(Self { ends, works, allowed, n_others: minima.len() }))
    }

    /// Laws that the objective allows: each has its place within the 95 % band of whatever is asked for.
    pub fn allowed(&self) -> &[Box<dyn CohesiveLaw>] {
        &self.allowed
    }

    /// How many minima beside that of the fit it allows.
    pub fn n_others(&self) -> usize {
        self.n_others
    }

    /// The error of the scaled unknowns at so many standard deviations along each axis.
    pub fn at(&self, t: &[f64]) -> Vec<f64> {
        let mut error = vec![0.0; t.len()];
        for (t, ends) in t.iter().zip(&self.ends) {
            let end = &ends[usize::from(*t > 0.0)];
            error.iter_mut().zip(end).for_each(|(e, end)| *e += t.abs() / NORMAL_95 * end);
        }
        error
    }

    /// The ends of the profiles of the works of separation in opening and in sliding.
    pub fn works(&self) -> [[Option<f64>; 2]; 2] {
        self.works
    }
}

/// The weights under which the objective of a fit is followed from its end on. Errors: a covariance without inverse.
pub(crate) fn weights_at_end(
    problem: &Problem<'_>,
    statistics: &Statistics,
    options: &FitOptions,
) -> Result<Weights, FitError> {
    match options.weights {
        WeightKind::Covariance => problem.inverse_covariance(statistics.by_boundary.clone()),
        kind => Ok(problem.diagonal_weights(kind)),
    }
}

/// Names of the work of separation among the parameters of laws, by mode.
pub(crate) const WORKS: [&[&str]; 2] = [&["phi_n", "G_Ic", "G_c"], &["phi_t", "G_IIc"]];

/// The work of separation in opening or in sliding, where it is a parameter of `law` or follows from those.
fn work_of(law: &dyn CohesiveLaw, mode: usize) -> Option<f64> {
    let place = law.parameters().iter().position(|p| WORKS[mode].contains(&p.name));
    place.map(|place| law.values()[place]).or_else(|| law.sliding_work().filter(|_| mode == 1))
}

/// Derivatives of the logarithms of both works by the scaled unknowns.
fn by_works(problem: &Problem<'_>, z: &[f64]) -> [Vec<f64>; 2] {
    const H: f64 = 1e-5;
    let at = |k: usize, h: f64, mode: usize| {
        let mut there = z.to_vec();
        there[k] += h;
        let law = problem.unknowns.law_at(&problem.unknowns.unscaled(&there)).ok()?;
        work_of(&*law, mode).map(f64::ln)
    };
    let slope = |k: usize, mode: usize| Some((at(k, H, mode)? - at(k, -H, mode)?) / (2.0 * H));
    [0, 1].map(|mode| (0..z.len()).map(|k| slope(k, mode).unwrap_or(0.0)).collect())
}
