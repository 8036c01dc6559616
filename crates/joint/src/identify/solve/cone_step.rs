//! The step of the trust region as a small cone program: the box and the radius are its cones.

use crate::linalg::Dense;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus};

/// Where a step may lead: every component within its bounds, the whole within the radius.
#[derive(Debug, Clone, Copy)]
pub struct StepRegion<'a> {
    /// Least components; not above zero.
    pub lower: &'a [f64],
    /// Largest components; not below zero.
    pub upper: &'a [f64],
    /// Largest Euclidean length.
    pub radius: f64,
}

/// How far each unknown may go down and up from `z` within its bounds: the components of [`StepRegion`].
pub(crate) fn room([lower, upper]: [&[f64]; 2], z: &[f64]) -> [Vec<f64>; 2] {
    let below = lower.iter().zip(z).map(|(l, z)| (l - z).min(0.0)).collect();
    [below, upper.iter().zip(z).map(|(u, z)| (u - z).max(0.0)).collect()]
}

impl StepRegion<'_> {
    fn holds(&self, step: &[f64]) -> bool {
        let inside = |(s, (l, u)): (&f64, (&f64, &f64))| s >= l && s <= u;
        length(step) <= self.radius && step.iter().zip(self.lower.iter().zip(self.upper)).all(inside)
    }
}

/// The step `s` that minimises `s^T H s / 2 - b^T s` within the region.
///
/// Where the minimum of the quadratic lies inside, it is taken as it is. Otherwise clarabel solves the program in
/// variables of the size of the answer (its tolerances are absolute), and the components that it puts on a bound are
/// then set exactly there and the others solved for again.
///
/// `None` when `H` holds a number that is not finite.
pub fn cone_step(h: &Dense, b: &[f64], region: &StepRegion<'_>) -> Option<Vec<f64>> {
    cone_step_beside(h, b, region, &[])
}

/// A half space that a step has to stay in: `by . s >= least`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HalfSpace {
    pub by: Vec<f64>,
    /// Not above zero.
    pub least: f64,
}

impl HalfSpace {
    fn holds(&self, step: &[f64]) -> bool {
        // Nothing but rounding may be beyond it.
        self.at(step) >= self.least - 1e-9 * self.least.abs() - 1e-12 * length(&self.by) * length(step)
    }

    fn at(&self, step: &[f64]) -> f64 {
        self.by.iter().zip(step).map(|(by, s)| by * s).sum()
    }
}

/// The same within `limits` too.
pub(crate) fn cone_step_beside(
    h: &Dense,
    b: &[f64],
    region: &StepRegion<'_>,
    limits: &[HalfSpace],
) -> Option<Vec<f64>> {
    let n = b.len();
    let holds = |step: &[f64]| region.holds(step) && limits.iter().all(|limit| limit.holds(step));
    let free = newton(h, b, &vec![None; n]);
    if let Some(step) = free.as_ref().filter(|step| holds(step)) {
        return Some(step.clone());
    }
    // The scale of the program: the radius, or the unconstrained step when it is shorter.
    let scale = free.map_or(region.radius, |step| region.radius.min(length(&step))).max(f64::MIN_POSITIVE);
    let curvature = (0..n).fold(0.0_f64, |most, k| most.max(h[(k, k)]));
    let slope = b.iter().fold(0.0_f64, |most, b| most.max(b.abs()));
    let unit = (curvature * scale * scale).max(slope * scale);
    if !(unit.is_finite() && unit > 0.0) {
        return unit.is_finite().then(|| vec![0.0; n]);
    }
    let dense = |rows: usize, columns: usize, entry: &dyn Fn(usize, usize) -> f64| {
        let rows: Vec<Vec<f64>> = (0..rows).map(|r| (0..columns).map(|c| entry(r, c)).collect()).collect();
        CscMatrix::from(&rows)
    };
    let p = dense(n, n, &|r, c| if r <= c { h[(r, c)] * scale * scale / unit } else { 0.0 });
    let q: Vec<f64> = b.iter().map(|b| -b * scale / unit).collect();
    // b - A s in the cones: upper - s, s - lower, by . s - least, (radius, s).
    let m = limits.len();
    let a = dense(3 * n + m + 1, n, &|r, c| match r {
        r if r < n => f64::from(r == c),
        r if r < 2 * n => -f64::from(r - n == c),
        r if r < 2 * n + m => -limits[r - 2 * n].by[c],
        r if r == 2 * n + m => 0.0,
        r => -f64::from(r - 2 * n - m - 1 == c),
    });
    // A bound further away than the radius is none.
    let far = 2.0 * region.radius / scale;
    let mut right: Vec<f64> = region.upper.iter().map(|u| (u / scale).min(far)).collect();
    right.extend(region.lower.iter().map(|l| (-l / scale).min(far)));
    right.extend(limits.iter().map(|limit| -limit.least / scale));
    right.push(region.radius / scale);
    right.extend(std::iter::repeat_n(0.0, n));
    let cones = [NonnegativeConeT(2 * n + m), SecondOrderConeT(n + 1)];
    let settings = DefaultSettings { verbose: false, max_threads: 1, ..DefaultSettings::default() };
    let mut solver = DefaultSolver::new(&p, &q, &a, &right, &cones, settings).ok()?;
    solver.solve();
    let solved = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
    let clamp = |k: usize, s: f64| s.clamp(region.lower[k], region.upper[k]);
    let mut step: Vec<f64> = match solved {
        true => solver.solution.x.iter().enumerate().map(|(k, s)| clamp(k, s * scale)).collect(),
        // Downhill along the slope: never worse than standing still for a radius that is small enough.
        false => (0..n).map(|k| clamp(k, region.radius * b[k] / length(b).max(f64::MIN_POSITIVE))).collect(),
    };
    if length(&step) < 0.999 * region.radius {
        let bound = |k: usize| {
            let near = |bound: f64| (step[k] - bound).abs() < 1e-5 * scale;
            let pushed = |sign: f64| sign * (b[k] - (0..n).map(|j| h[(k, j)] * step[j]).sum::<f64>()) > 0.0;
            match () {
                () if near(region.upper[k]) && pushed(1.0) => Some(region.upper[k]),
                () if near(region.lower[k]) && pushed(-1.0) => Some(region.lower[k]),
                () => None,
            }
        };
        let fixed: Vec<Option<f64>> = (0..n).map(bound).collect();
        let reached: Vec<&HalfSpace> =
            limits.iter().filter(|limit| limit.at(&step) - limit.least < 1e-5 * scale * length(&limit.by)).collect();
        let exact = if reached.is_empty() { newton(h, b, &fixed) } else { along(h, b, &fixed, &reached) };
        if let Some(exact) = exact.filter(|exact| holds(exact)) {
            step = exact;
        }
    }
    let excess = length(&step) / region.radius;
    if excess > 1.0 {
        step.iter_mut().for_each(|s| *s /= excess);
    }
    Some(step)
}

/// Euclidean length.
pub fn length(step: &[f64]) -> f64 {
    step.iter().map(|s| s * s).sum::<f64>().sqrt()
}

/// The minimum of the quadratic with the components in `fixed` held; `None` where `H` is not positive definite.
fn newton(h: &Dense, b: &[f64], fixed: &[Option<f64>]) -> Option<Vec<f64>> {
    let open: Vec<usize> = (0..b.len()).filter(|&k| fixed[k].is_none()).collect();
    let mut step: Vec<f64> = fixed.iter().map(|s| s.unwrap_or(0.0)).collect();
    if open.is_empty() {
        return Some(step);
    }
    // Scaled to a unit diagonal, so that the factor does not depend on the units of the parameters.
    let diagonal: Vec<f64> = open.iter().map(|&k| h[(k, k)].sqrt()).collect();
    if !diagonal.iter().all(|d| d.is_finite() && *d > 0.0) {
        return None;
    }
    let scaled = Dense::from_fn(open.len(), open.len(), |r, c| h[(open[r], open[c])] / (diagonal[r] * diagonal[c]));
    let rest = |k: usize| b[k] - (0..b.len()).map(|j| h[(k, j)] * step[j]).sum::<f64>();
    let rhs = Dense::from_fn(open.len(), 1, |r, _| rest(open[r]) / diagonal[r]);
    let solution = scaled.cholesky().ok()?.solve(&rhs);
    for (place, &k) in open.iter().enumerate() {
        step[k] = solution[(place, 0)] / diagonal[place];
    }
    step.iter().all(|s| s.is_finite()).then_some(step)
}

/// The minimum of the quadratic with the components in `fixed` held and on the faces of `limits`, less those that would
/// hold it back from inside; `None` where there is none.
fn along(h: &Dense, b: &[f64], fixed: &[Option<f64>], limits: &[&HalfSpace]) -> Option<Vec<f64>> {
    let without = newton(h, b, fixed)?;
    // What a push by each limit moves, the fixed components held.
    let still: Vec<Option<f64>> = fixed.iter().map(|s| s.map(|_| 0.0)).collect();
    let pushes: Vec<Vec<f64>> = limits.iter().map(|limit| newton(h, &limit.by, &still)).collect::<Option<_>>()?;
    let mut active: Vec<usize> = (0..limits.len()).collect();
    while !active.is_empty() {
        let n = active.len();
        let matrix = Dense::from_fn(n, n, |r, c| limits[active[r]].at(&pushes[active[c]]));
        let lacking = Dense::from_fn(n, 1, |r, _| limits[active[r]].least - limits[active[r]].at(&without));
        let force = matrix.cholesky().ok()?.solve(&lacking);
        if let Some(worst) =
            (0..n).filter(|&k| force[(k, 0)] < 0.0).min_by(|&a, &b| force[(a, 0)].total_cmp(&force[(b, 0)]))
        {
            active.remove(worst);
            continue;
        }
        let mut step = without;
        for (k, &limit) in active.iter().enumerate() {
            step.iter_mut().zip(&pushes[limit]).for_each(|(s, push)| *s += force[(k, 0)] * push);
        }
        return Some(step);
    }
    Some(without)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The least of `x^2 + y^2 - 4 x - 2 y` beside a line, by hand: the foot of the perpendicular from (2, 1), or the
    /// corner of two.
    #[test]
    fn a_step_beside_limits_ends_on_them_and_leaves_those_that_do_not_hold_it_back() {
        let h = Dense::from_fn(2, 2, |r, c| f64::from(u8::from(r == c)));
        let far = [[-10.0; 2], [10.0; 2]];
        let region = StepRegion { lower: &far[0], upper: &far[1], radius: 5.0 };
        let step = |limits: &[([f64; 2], f64)]| {
            let limits: Vec<HalfSpace> =
                limits.iter().map(|(by, least)| HalfSpace { by: by.to_vec(), least: *least }).collect();
            cone_step_beside(&h, &[2.0, 1.0], &region, &limits).unwrap()
        };
        let x_below = |x: f64| ([-1.0, 0.0], -x);
        for (limits, wanted) in [
            (vec![], [2.0, 1.0]),
            (vec![x_below(3.0)], [2.0, 1.0]),
            (vec![x_below(0.5)], [0.5, 1.0]),
            (vec![x_below(0.0)], [0.0, 1.0]),
            // x + y below 1: the foot from (2, 1) is (1, 0).
            (vec![([-1.0, -1.0], -1.0)], [1.0, 0.0]),
            // Both: the foot (1, 0) has too large an x, and the corner is (0.5, 0.5).
            (vec![([-1.0, -1.0], -1.0), x_below(0.5)], [0.5, 0.5]),
            // The second only touches where the first ends the step, and would hold nothing back.
            (vec![x_below(0.5), ([0.0, 1.0], 0.0)], [0.5, 1.0]),
        ] {
            let found = step(&limits);
            assert!((0..2).all(|k| (found[k] - wanted[k]).abs() < 1e-10), "{found:?} for {wanted:?} beside {limits:?}");
        }
    }
}
