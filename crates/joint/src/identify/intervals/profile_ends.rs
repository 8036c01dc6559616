//! The ends of intervals of the profile likelihood, without the profile.

use crate::identify::{Base, Local, NORMAL_95};
use crate::linalg::Dense;
use rayon::prelude::*;

/// Scaled distance from the end of the fit (of logarithms: a factor of 20) beyond which no end of an interval is looked
/// for.
const FAR: f64 = 3.0;
/// Longest component of one step towards an end.
const STRIDE: f64 = 0.7;
/// An end is found when the next step is shorter than this share of the distance in standard deviations.
const SHORT: f64 = 0.05;
/// Evaluations towards one end.
const TRIALS: usize = 20;

/// Ends of profile likelihood intervals without the profile: from the end of the fit the point is sought where a
/// functional of the scaled unknowns is extreme while the objective is `1.96^2` above its minimum (Venzon and
/// Moolgavkar, Applied Statistics 37, 1988, 87-94), with the second derivatives of Gauss-Newton and the weights of the
/// end. A nearly linear problem takes one evaluation.
pub(crate) struct ProfileEnds<'a> {
    base: &'a Base<'a>,
    z: Vec<f64>,
    local: Local,
    /// The least objective, from which rises count.
    least: f64,
}

/// A search for an end.
pub(crate) struct Way {
    /// The end; `None` where there is none within [`FAR`] and the bounds.
    pub end: Option<Vec<f64>>,
    /// The last point with a value.
    pub last: Vec<f64>,
    /// The points seen whose objective is no higher than at an end.
    pub allowed: Vec<Vec<f64>>,
}

impl<'a> ProfileEnds<'a> {
    pub(crate) fn new(base: &'a Base<'a>) -> Option<Self> {
        let local = base.evaluation.local(base.weights, &base.problem.noise);
        let z = base.problem.unknowns.scaled(&base.evaluation.x);
        let least = local.omega;
        (local.omega.is_finite() && local.h.cholesky().is_ok()).then_some(Self { base, z, local, least })
    }

    /// The same from another minimum at the scaled unknowns `z`; rises count from the least of both.
    pub(crate) fn from(&self, z: &[f64]) -> Option<Self> {
        let local = self.local_at(z)?;
        let least = self.least.min(local.omega);
        local.h.cholesky().is_ok().then_some(Self { base: self.base, z: z.to_vec(), local, least })
    }

    fn local_at(&self, z: &[f64]) -> Option<Local> {
        let Base { problem, weights, boundary, .. } = self.base;
        let evaluation = problem.evaluate(&problem.unknowns.unscaled(z), boundary).ok().flatten()?;
        Some(evaluation.local(weights, &problem.noise)).filter(|local| local.omega.is_finite())
    }

    /// Both ends for each of `directions`, in scaled unknowns; `None` where there is none within [`FAR`] and the
    /// bounds.
    pub(crate) fn along(&self, directions: &[Vec<f64>]) -> Vec<[Option<Vec<f64>>; 2]> {
        self.ways(directions).into_iter().map(|ways| ways.map(|way| way.end)).collect()
    }

    /// The searches towards both sides of each of `directions`, in scaled unknowns.
    pub(crate) fn ways(&self, directions: &[Vec<f64>]) -> Vec<[Way; 2]> {
        let towards = |k: usize, sign: f64| self.way(&directions[k].iter().map(|s| sign * s).collect::<Vec<_>>());
        (0..directions.len())
            .into_par_iter()
            .map(|k| {
                let (below, above) = rayon::join(|| towards(k, -1.0), || towards(k, 1.0));
                [below, above]
            })
            .collect()
    }

    /// The search for the end towards which `s z` grows.
    fn way(&self, s: &[f64]) -> Way {
        let mut way = Way { end: None, last: self.z.clone(), allowed: Vec::new() };
        if let Some(rise) = self.rise(s) {
            way.end = self.search(s, rise, &mut way);
            way.allowed.extend(way.end.clone());
        }
        way
    }

    /// What the objective may rise by at an end towards which `s z` grows.
    fn rise(&self, s: &[f64]) -> Option<f64> {
        let Base { statistics, .. } = self.base;
        let unit = quadratic(&statistics.covariance, s) / quadratic(&statistics.a, s);
        let rise = NORMAL_95.powi(2) * unit;
        (rise.is_finite() && rise > 0.0).then_some(rise)
    }

    /// Whether the objective `omega` at `z` is no higher than at an end in its direction.
    pub(crate) fn allows(&self, z: &[f64], omega: f64) -> bool {
        let way: Vec<f64> = z.iter().zip(&self.z).map(|(there, here)| there - here).collect();
        self.rise(&way).is_some_and(|rise| omega <= self.least + rise)
    }

    /// The farthest of some points on the straight way of linear theory towards which `s z` grows that the objective
    /// allows: what is left where a search gets nowhere.
    pub(crate) fn straight(&self, s: &[f64]) -> Option<Vec<f64>> {
        let covariance = &self.base.statistics.covariance;
        let wanted = self.least + self.rise(s)?;
        let std = quadratic(covariance, s).sqrt();
        let way: Vec<f64> = (0..s.len())
            .map(|r| (0..s.len()).map(|c| covariance[(r, c)] * s[c]).sum::<f64>() * NORMAL_95 / std)
            .collect();
        let longest = way.iter().fold(0.0_f64, |most, w| most.max(w.abs()));
        let [lower, upper] = self.base.problem.unknowns.scaled_bounds();
        [1.0, 0.5, 0.25, 0.125].into_iter().find_map(|share| {
            let share = share * (FAR / longest).min(1.0);
            let there: Vec<f64> =
                (0..s.len()).map(|k| (self.z[k] + share * way[k]).clamp(lower[k], upper[k])).collect();
            (self.local_at(&there)?.omega <= wanted).then_some(there)
        })
    }

    /// The end towards which `s z` grows, where the objective is higher by `rise` than the least; tells `way` where it
    /// comes by.
    fn search(&self, s: &[f64], rise: f64, way: &mut Way) -> Option<Vec<f64>> {
        let Base { problem, .. } = self.base;
        let n = s.len();
        let z = &mut way.last;
        let wanted = self.least + rise;
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
                match self.local_at(&trial) {
                    Some(local) => break (trial, local),
                    None if trials < TRIALS => share *= 0.5,
                    None => return None,
                }
            };
            (*z, local) = next;
            if local.omega <= wanted {
                way.allowed.push(z.clone());
            }
            let gone: f64 = (0..n).map(|k| s[k] * (z[k] - self.z[k])).sum();
            if gone > FAR * s.iter().map(|s| s * s).sum::<f64>().sqrt() {
                return None;
            }
        }
        None
    }
}

fn quadratic(m: &Dense, s: &[f64]) -> f64 {
    (0..s.len()).map(|r| (0..s.len()).map(|c| s[r] * m[(r, c)] * s[c]).sum::<f64>()).sum()
}

/// The step of the `free` unknowns to where the quadratic model about `local` has the value `wanted` and `s z` is
/// largest; to its minimum where it is above that everywhere.
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
