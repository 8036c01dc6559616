//! The ends of intervals of the profile likelihood, without the profile.

use super::bootstrap::Base;
use super::statistics::NORMAL_95;
use super::trust_region::Local;
use crate::linalg::Dense;
use rayon::prelude::*;

/// Scaled distance from the end of the fit (of logarithms: a factor of 20) beyond which no end of an interval is looked for.
const FAR: f64 = 3.0;
/// Longest component of one step towards an end.
const STRIDE: f64 = 0.7;
/// An end is found when the next step is shorter than this share of the distance in standard deviations.
const SHORT: f64 = 0.05;
/// Evaluations towards one end.
const TRIALS: usize = 20;

/// Ends of profile likelihood intervals without the profile: from the end of the fit the point is sought where a functional of the
/// scaled unknowns is extreme while the objective is `1.96^2` above its minimum (Venzon and Moolgavkar, Applied Statistics 37, 1988,
/// 87-94), with the second derivatives of Gauss-Newton and the weights of the end. A nearly linear problem takes one evaluation.
pub(super) struct ProfileEnds<'a> {
    base: &'a Base<'a>,
    z: Vec<f64>,
    local: Local,
}

impl<'a> ProfileEnds<'a> {
    pub(super) fn new(base: &'a Base<'a>) -> Option<Self> {
        let local = base.evaluation.local(base.weights, &base.problem.noise);
        let z = base.problem.unknowns.scaled(&base.evaluation.x);
        (local.omega.is_finite() && local.h.cholesky().is_ok()).then_some(Self { base, z, local })
    }

    /// Both ends for each of `directions`, in scaled unknowns; `None` where there is none within [`FAR`] and the bounds.
    pub(super) fn along(&self, directions: Vec<Vec<f64>>) -> Vec<[Option<Vec<f64>>; 2]> {
        let end = |k: usize| {
            let sign = if k.is_multiple_of(2) { -1.0 } else { 1.0 };
            self.end(&directions[k / 2].iter().map(|s| sign * s).collect::<Vec<_>>())
        };
        let ends: Vec<Option<Vec<f64>>> = (0..2 * directions.len()).into_par_iter().map(end).collect();
        ends.as_chunks::<2>().0.to_vec()
    }

    /// The end towards which `s z` grows.
    fn end(&self, s: &[f64]) -> Option<Vec<f64>> {
        let (end, reached) = self.way(s);
        reached.then_some(end)
    }

    /// How far it goes towards both sides of each of `directions`: to the ends, or where none was found to the last point on the way.
    pub(super) fn as_far_as(&self, directions: &[Vec<f64>]) -> Vec<[Vec<f64>; 2]> {
        let ways: Vec<Vec<f64>> = (0..2 * directions.len())
            .into_par_iter()
            .map(|k| {
                let sign = if k.is_multiple_of(2) { -1.0 } else { 1.0 };
                self.way(&directions[k / 2].iter().map(|s| sign * s).collect::<Vec<_>>()).0
            })
            .collect();
        ways.as_chunks::<2>().0.to_vec()
    }

    /// The last point of the search for the end towards which `s z` grows, and whether it is the end.
    fn way(&self, s: &[f64]) -> (Vec<f64>, bool) {
        let mut z = self.z.clone();
        let found = self.search(s, &mut z);
        found.map_or((z, false), |end| (end, true))
    }

    /// The end towards which `s z` grows; `z` begins at the end of the fit and is left at the last point with a value.
    fn search(&self, s: &[f64], z: &mut Vec<f64>) -> Option<Vec<f64>> {
        let Base { problem, statistics, weights, boundary, .. } = self.base;
        let n = s.len();
        let quadratic = |m: &Dense| (0..n).map(|r| (0..n).map(|c| s[r] * m[(r, c)] * s[c]).sum::<f64>()).sum::<f64>();
        let unit = quadratic(&statistics.covariance) / quadratic(&statistics.a);
        let rise = NORMAL_95.powi(2) * unit;
        if !(rise.is_finite() && rise > 0.0) {
            return None;
        }
        let wanted = self.local.omega + rise;
        let [lower, upper] = problem.unknowns.scaled_bounds();
        let mut local = self.local.clone();
        let mut trials = 0;
        while trials < TRIALS {
            // Unknowns on a bound that would pass it stay there.
            let mut free: Vec<usize> = (0..n).collect();
            let step = loop {
                let step = step_to(&local, s, wanted, &free)?;
                let stuck = |&k: &usize| (z[k] <= lower[k] && step[k] < 0.0) || (z[k] >= upper[k] && step[k] > 0.0);
                match free.iter().position(stuck) {
                    Some(at) => drop(free.remove(at)),
                    None => break step,
                }
            };
            let longest = step.iter().fold(0.0_f64, |most, p| most.max(p.abs()));
            let mut share = (STRIDE / longest).min(1.0);
            for k in 0..n {
                let room = if step[k] > 0.0 { upper[k] - z[k] } else { lower[k] - z[k] };
                if step[k] != 0.0 && (room / step[k]) < share {
                    share = (room / step[k]).max(0.0);
                }
            }
            let length: f64 = (0..n).map(|r| (0..n).map(|c| step[r] * local.h[(r, c)] * step[c]).sum::<f64>()).sum();
            let at = |share: f64| -> Vec<f64> {
                (0..n).map(|k| (z[k] + share * step[k]).clamp(lower[k], upper[k])).collect()
            };
            if share == 1.0 && length.max(0.0).sqrt() < SHORT * rise.sqrt() {
                return Some(at(1.0));
            }
            // Where the model has no solution, nearer.
            let next = loop {
                trials += 1;
                let trial = at(share);
                let evaluation = problem.evaluate(&problem.unknowns.unscaled(&trial), boundary).ok().flatten();
                let local = evaluation.map(|evaluation| evaluation.local(weights, &problem.noise));
                match local.filter(|local| local.omega.is_finite()) {
                    Some(local) => break (trial, local),
                    None if trials < TRIALS => share *= 0.5,
                    None => return None,
                }
            };
            (*z, local) = next;
            let gone: f64 = (0..n).map(|k| s[k] * (z[k] - self.z[k])).sum();
            if gone > FAR * s.iter().map(|s| s * s).sum::<f64>().sqrt() {
                return None;
            }
        }
        None
    }
}

/// The step of the `free` unknowns to where the quadratic model about `local` has the value `wanted` and `s z` is largest; to its
/// minimum where it is above that everywhere.
fn step_to(local: &Local, s: &[f64], wanted: f64, free: &[usize]) -> Option<Vec<f64>> {
    if free.iter().all(|&k| s[k] == 0.0) {
        return None;
    }
    let n = free.len();
    let factor = Dense::from_fn(n, n, |r, c| local.h[(free[r], free[c])]).cholesky().ok()?;
    let b = Dense::from_fn(n, 2, |r, c| if c == 0 { local.b[free[r]] } else { s[free[r]] });
    let back = factor.solve(&b);
    let dot = |r: usize, c: usize| b.column(r).iter().zip(back.column(c)).map(|(a, b)| a * b).sum::<f64>();
    let mu = ((wanted - local.omega + dot(0, 0)) / dot(1, 1)).max(0.0).sqrt();
    let mut step = vec![0.0; s.len()];
    for (at, &k) in free.iter().enumerate() {
        step[k] = back[(at, 0)] + mu * back[(at, 1)];
    }
    step.iter().all(|p| p.is_finite()).then_some(step)
}
