//! The profile likelihood of one parameter: the objective with it prescribed and the others fitted.

use crate::identify::{Fit, FitError, FitOptions, NORMAL_95, Problem, fit, wrong};
use crate::io::case::{Discretisation, Intervals};
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
/// The rise is in units of `Cov_kk / A_kk`, which is 1 for the inverse covariance as weights: in a linear problem it is
/// the square of the distance in standard deviations.
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
        direct: None,
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
    let wanted = NORMAL_95;
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
