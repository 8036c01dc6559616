//! The profile likelihood of one parameter: the objective with it prescribed and the others fitted.

use super::bootstrap::Base;
use super::error::wrong;
use super::fit::{Fit, FitOptions, fit};
use super::intervals::Intervals;
use super::objective::Problem;
use super::trust_region::Local;
use super::{Discretisation, FitError};
use crate::linalg::Dense;
use rayon::prelude::*;

/// The profile of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Name of the parameter.
    pub name: &'static str,
    /// Values at which it was prescribed.
    pub values: Vec<f64>,
    /// What the objective rises by, over what one standard deviation gives.
    pub rise: Vec<f64>,
    /// Where the rise is 1.96^2 on either side; `None` where it is not reached within the profile.
    pub interval95: [Option<f64>; 2],
}

/// Points on each side, and how many standard deviations they reach.
const POINTS: i32 = 5;
const REACH: f64 = 3.5;

/// The profile of unknown `k` about the end of `done`.
///
/// The rise is in units of `Cov_kk / A_kk`, which is 1 for the inverse covariance as weights: in a linear problem it is the
/// square of the distance in standard deviations.
///
/// # Errors
/// See [`FitError`].
pub fn profile(problem: &Problem<'_>, options: &FitOptions, done: &Fit, k: usize) -> Result<Profile, FitError> {
    let unknown = problem.unknowns.list()[k];
    let best: Vec<f64> = done.parameters.iter().map(|p| p.value).collect();
    let nothing = |values: Vec<f64>| {
        let rise = vec![0.0; values.len()];
        Profile { name: unknown.parameter.name, values, rise, interval95: [None; 2] }
    };
    let Some(statistics) = &done.statistics else { return Ok(nothing(vec![best[k]])) };
    let (variance, a) = (statistics.covariance[(k, k)], statistics.a[(k, k)]);
    let std = variance.max(0.0).sqrt();
    if std <= 0.0 || std.is_nan() {
        return Ok(nothing(vec![best[k]]));
    }
    let z = problem.unknowns.scaled(&best);
    let value = |j: i32| {
        let mut z = z.clone();
        z[k] += REACH * std * f64::from(j) / f64::from(POINTS);
        problem.unknowns.unscaled(&z)[k]
    };
    let options = FitOptions {
        starts: Vec::new(),
        constants: Vec::new(),
        discretisation: Discretisation::Off,
        doubt: false,
        intervals: Intervals::Linear,
        ..options.clone()
    };
    let unit = variance / a;
    let at = |j: i32| -> Result<(f64, f64), FitError> {
        let x = value(j);
        if j == 0 {
            return Ok((x, 0.0));
        }
        let others: Vec<f64> = best.iter().enumerate().filter(|(other, _)| *other != k).map(|(_, x)| *x).collect();
        if others.is_empty() {
            let what = "profile needs two parameters or more: of one alone the interval says it all";
            return Err(wrong("fit", "profile", what));
        }
        let unknowns = problem.unknowns.with_prescribed(unknown.index, x)?.starting_at(&others)?;
        let fit = fit(&problem.with_unknowns(unknowns), &options)?;
        Ok((x, ((fit.omega - done.omega) / unit).max(0.0)))
    };
    let points: Vec<i32> = (-POINTS..=POINTS).collect();
    let rows: Vec<(f64, f64)> = points.par_iter().map(|&j| at(j)).collect::<Result<_, _>>()?;
    let wanted = super::fit::NORMAL_95;
    // Between points the root of the rise is taken as a straight line, which it is in a linear problem.
    let crossing = |mut list: Vec<(f64, f64)>| {
        list.iter_mut().for_each(|row| row.1 = row.1.sqrt());
        let after = list.iter().position(|row| row.1 >= wanted).filter(|&after| after > 0)?;
        let [(x0, r0), (x1, r1)] = [list[after - 1], list[after]];
        Some(x0 + (x1 - x0) * (wanted - r0) / (r1 - r0))
    };
    let middle = POINTS as usize;
    let interval95 = [crossing(rows[..=middle].iter().rev().copied().collect()), crossing(rows[middle..].to_vec())];
    let (values, rise) = rows.into_iter().unzip();
    Ok(Profile { name: unknown.parameter.name, values, rise, interval95 })
}

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
        let of = |k: usize| {
            let sign = if k.is_multiple_of(2) { -1.0 } else { 1.0 };
            self.end(&directions[k / 2].iter().map(|s| sign * s).collect::<Vec<_>>())
        };
        let ends: Vec<Option<Vec<f64>>> = (0..2 * directions.len()).into_par_iter().map(of).collect();
        ends.as_chunks::<2>().0.to_vec()
    }

    /// The end towards which `s z` grows.
    fn end(&self, s: &[f64]) -> Option<Vec<f64>> {
        let Base { problem, statistics, weights, boundary, .. } = self.base;
        let n = s.len();
        let quadratic = |m: &Dense| (0..n).map(|r| (0..n).map(|c| s[r] * m[(r, c)] * s[c]).sum::<f64>()).sum::<f64>();
        let unit = quadratic(&statistics.covariance) / quadratic(&statistics.a);
        let rise = super::fit::NORMAL_95.powi(2) * unit;
        if !(rise.is_finite() && rise > 0.0) {
            return None;
        }
        let wanted = self.local.omega + rise;
        let [lower, upper] = problem.unknowns.scaled_bounds();
        let (mut z, mut local) = (self.z.clone(), self.local.clone());
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
            (z, local) = next;
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
