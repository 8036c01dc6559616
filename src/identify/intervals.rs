//! The 95 % intervals: whether linear theory is good enough for them, and what they are made of (THEORY 7, 11).

use super::bootstrap::{Base, Bootstrap};
use super::derived::derived;
use super::fit::{FittedParameter, FittedQuantity, NORMAL_95};
use super::profile::ProfileEnds;

/// Which intervals are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Intervals {
    /// Of the profile likelihood where linear theory is in doubt, else linear.
    #[default]
    Auto,
    /// Linear, whatever they are worth.
    Linear,
    /// Of the profile likelihood, with the bias of a bootstrap.
    Profile,
}

/// Which intervals a fit has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IntervalKind {
    /// 1.96 standard uncertainties either way, extended by the bias of the noise where that was looked for.
    Linear,
    /// Of the profile likelihood, extended by the bias of a bootstrap.
    Profile,
}

impl IntervalKind {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Profile => "profile",
        }
    }
}

/// Relative standard uncertainty of a parameter above which linear intervals are in doubt.
pub const LINEAR_STD: f64 = 0.05;
/// Share of a standard uncertainty by which what a pair of opposite draws of noise does may differ from linear theory.
pub const LINEAR_PROBE: f64 = 0.5;
/// Relative standard uncertainty below which nothing is probed: the noise is that of rounding.
const NOTHING: f64 = 1e-7;
/// Draws of a bootstrap whose number is not given.
pub const DRAWS: usize = 24;

/// Whether linear theory describes what the noise does.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Linearity {
    /// Why it may not; empty when nothing speaks against it.
    pub doubts: Vec<String>,
    /// What a pair of opposite draws of noise does to each scaled unknown beyond linear theory, in standard uncertainties: the
    /// even part, which is the bias that the noise makes, and the odd part. `None` where that was not computed.
    pub probe: Option<[Vec<f64>; 2]>,
}

impl Linearity {
    /// Whether something speaks against linear theory.
    pub fn in_doubt(&self) -> bool {
        !self.doubts.is_empty()
    }
}

/// What was found out about the intervals of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct IntervalBasis {
    /// Which intervals it has.
    pub kind: IntervalKind,
    /// Whether linear theory describes what the noise does.
    pub linearity: Linearity,
    /// The bootstrap, where one was made; it counts the draws that failed.
    pub bootstrap: Option<Bootstrap>,
    /// What noise shifts each scaled unknown by on the average (found less true), by bootstrap or probe.
    pub bias: Option<Vec<f64>>,
}

/// Why linear intervals may not be good, from the relative standard uncertainties of the parameters called `names`, and from
/// the even and the odd part of a probe in standard uncertainties.
pub fn doubts(names: &[&str], relative_std: &[f64], probe: Option<&[Vec<f64>; 2]>) -> Vec<String> {
    let mut list = Vec::new();
    for (name, std) in names.iter().zip(relative_std).filter(|(_, std)| **std > LINEAR_STD) {
        list.push(format!(
            "the standard uncertainty of {name} is {:.1} % of its value, more than {:.0} %",
            100.0 * std,
            100.0 * LINEAR_STD
        ));
    }
    for (part, what) in probe.into_iter().flatten().zip(["moves it one way, whatever its sign, by", "differs by"]) {
        for (name, share) in names.iter().zip(part).filter(|(_, share)| share.abs() > LINEAR_PROBE) {
            list.push(format!(
                "a draw of the noise {} {:.2} of the standard uncertainty of {name} (more than {LINEAR_PROBE})",
                what,
                share.abs()
            ));
        }
    }
    list
}

/// How far a 95 % interval reaches below and above a value: `noise` is how far that of the noise alone does, `None` without
/// an end; `bias` is what noise shifts the value by on the average (found less true); `other_std` is the standard uncertainty
/// of everything else. The value is never moved: the interval is extended to where the bias says that the truth is.
pub fn compose(noise: [Option<f64>; 2], bias: f64, other_std: f64) -> [Option<f64>; 2] {
    let other = NORMAL_95 * other_std;
    [noise[0].map(|half| half.hypot(other) + bias.max(0.0)), noise[1].map(|half| half.hypot(other) + (-bias).max(0.0))]
}

/// Gives `parameters` and `quantities`, which have linear intervals, those that `wanted` asks for; `n_draws` is the size of the
/// bootstrap, `included` whether the element size is part of the intervals.
pub(super) fn settle(
    base: &Base<'_>,
    wanted: Intervals,
    n_draws: Option<usize>,
    included: bool,
    parameters: &mut [FittedParameter],
    quantities: &mut [FittedQuantity],
) -> IntervalBasis {
    let unknowns = &base.problem.unknowns;
    let x = &base.evaluation.x;
    let slopes = unknowns.slopes(x);
    let n = x.len();
    let scaled_std: Vec<f64> = (0..n).map(|k| base.statistics.covariance[(k, k)].max(0.0).sqrt()).collect();
    let relative: Vec<f64> = (0..n).map(|k| scaled_std[k] * slopes[k] / x[k].abs().max(f64::MIN_POSITIVE)).collect();
    let names: Vec<&str> = parameters.iter().map(|p| p.parameter.name).collect();
    let mut basis =
        IntervalBasis { kind: IntervalKind::Linear, linearity: Linearity::default(), bootstrap: None, bias: None };
    let silent =
        relative.iter().all(|std| *std < NOTHING) || scaled_std.iter().any(|std| *std <= 0.0 || !std.is_finite());
    if wanted == Intervals::Linear || silent {
        return basis;
    }
    let mut list = doubts(&names, &relative, None);
    if list.is_empty() && !base.follows_data {
        let probe = base.probe().map(|parts| {
            parts.map(|part| part.iter().zip(&scaled_std).map(|(off, std)| off / std).collect::<Vec<f64>>())
        });
        list = match &probe {
            Some(probe) => doubts(&names, &relative, Some(probe)),
            None => vec!["the model has no solution for data with another draw of the noise".to_owned()],
        };
        basis.linearity.probe = probe;
    }
    basis.linearity.doubts = list;
    let included = |change: Option<f64>| change.filter(|_| included).unwrap_or(0.0);
    if wanted == Intervals::Auto && !basis.linearity.in_doubt() {
        let Some([even, _]) = &basis.linearity.probe else { return basis };
        let bias: Vec<f64> = even.iter().zip(&scaled_std).map(|(share, std)| share * std).collect();
        for (k, p) in parameters.iter_mut().enumerate() {
            let noise = slopes[k] * scaled_std[k];
            let shift = slopes[k] * bias[k];
            let Some(std) = p.std else { continue };
            let other = (std * std - noise * noise).max(0.0).sqrt().hypot(included(p.discretisation));
            let [low, high] = compose([Some(NORMAL_95 * noise); 2], shift, other);
            p.bias = Some(shift);
            p.set_ends([low.map(|reach| p.value - reach), high.map(|reach| p.value + reach)]);
        }
        for (q, by_scaled) in quantities.iter_mut().zip(by_scaled(base)) {
            let shift: f64 = by_scaled.iter().zip(&bias).map(|(slope, bias)| slope * bias).sum();
            let Some([low, high]) = q.interval95 else { continue };
            q.bias = Some(shift);
            q.set_ends([Some(low - shift.max(0.0)), Some(high + (-shift).max(0.0))]);
        }
        basis.bias = Some(bias);
        return basis;
    }
    basis.kind = IntervalKind::Profile;
    let draws = n_draws.unwrap_or(DRAWS);
    if draws > 0 && !base.follows_data {
        basis.bootstrap = base.bootstrap(draws.div_ceil(2));
        basis.bias = basis.bootstrap.as_ref().map(|bootstrap| bootstrap.bias.clone());
    }
    let ends = ProfileEnds::new(base);
    let z = unknowns.scaled(x);
    let found = ends.as_ref().map(|ends| {
        let directions = (0..n).map(|k| (0..n).map(|j| f64::from(j == k)).collect());
        let of_quantities = by_scaled(base).into_iter().zip(quantities.iter());
        let of_quantities = of_quantities.map(|(slopes, q)| slopes.iter().map(|s| s / q.quantity.value).collect());
        ends.along(directions.chain(of_quantities).collect())
    });
    let end = |direction: usize, side: usize| found.as_ref().and_then(|found| found[direction][side].as_deref());
    for (k, p) in parameters.iter_mut().enumerate() {
        let noise = [0, 1].map(|side| end(k, side).map(|end| (end[k] - z[k]).abs()));
        let bias = basis.bootstrap.as_ref().map(|b| b.bias[k]);
        let other = p.std.map_or(0.0, |std| ((std / slopes[k]).powi(2) - scaled_std[k].powi(2)).max(0.0).sqrt());
        let other = other.hypot(included(p.discretisation) / slopes[k]);
        let reach = compose(noise, bias.unwrap_or(0.0), other);
        let moved = |by: f64| {
            let mut z = z.clone();
            z[k] += by;
            unknowns.unscaled(&z)[k]
        };
        let ends = [reach[0].map(|by| moved(-by)), reach[1].map(moved)];
        p.bias = bias.map(|bias| slopes[k] * bias);
        p.bias_std = basis.bootstrap.as_ref().and_then(|b| b.bias_std.as_ref()).map(|std| slopes[k] * std[k]);
        p.std_bootstrap = basis.bootstrap.as_ref().map(|b| slopes[k] * b.std[k]);
        p.set_ends(ends);
    }
    let value = |z: &[f64], q: usize| {
        let law = unknowns.law_at(&unknowns.unscaled(z)).ok()?;
        derived(&*law).get(q).map(|quantity| quantity.value).filter(|value| *value > 0.0)
    };
    for (k, (q, by_scaled)) in quantities.iter_mut().zip(by_scaled(base)).enumerate() {
        let here = q.quantity.value;
        if here <= 0.0 {
            continue;
        }
        // In logarithms, as the parameters.
        let noise = [0, 1].map(|side| value(end(n + k, side)?, k).map(|there| (there / here).ln().abs()));
        let errors = basis.bootstrap.as_ref().map(|b| {
            let of = |error: &Vec<f64>| {
                let there: Vec<f64> = z.iter().zip(error).map(|(z, e)| z + e).collect();
                value(&there, k).map_or(0.0, |there| (there / here).ln())
            };
            b.errors.iter().map(of).sum::<f64>() / b.errors.len().max(1) as f64
        });
        let covariance = &base.statistics.covariance;
        let variance: f64 =
            (0..n).map(|r| (0..n).map(|c| by_scaled[r] * covariance[(r, c)] * by_scaled[c]).sum::<f64>()).sum();
        let other = q.std.map_or(0.0, |std| (std * std - variance).max(0.0).sqrt());
        let other = other.hypot(included(q.discretisation)) / here;
        let [low, high] = compose(noise, errors.unwrap_or(0.0), other);
        q.bias = errors.map(|bias| bias * here);
        q.set_ends([low.map(|by| here * (-by).exp()), high.map(|by| here * by.exp())]);
    }
    basis
}

/// Derivatives of the derived quantities by the scaled unknowns.
fn by_scaled(base: &Base<'_>) -> Vec<Vec<f64>> {
    let unknowns = &base.problem.unknowns;
    let z = unknowns.scaled(&base.evaluation.x);
    let at = |k: usize, h: f64| {
        let mut z = z.clone();
        z[k] += h;
        unknowns.law_at(&unknowns.unscaled(&z)).map(|law| derived(&*law)).unwrap_or_default()
    };
    const H: f64 = 1e-5;
    let sides: Vec<_> = (0..z.len()).map(|k| (at(k, H), at(k, -H))).collect();
    let n = sides.first().map_or(0, |(more, _)| more.len());
    let slope = |q: usize, (more, less): &(Vec<super::Derived>, Vec<super::Derived>)| match (more.get(q), less.get(q)) {
        (Some(more), Some(less)) => (more.value - less.value) / (2.0 * H),
        _ => 0.0,
    };
    (0..n).map(|q| sides.iter().map(|side| slope(q, side)).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_reaches_to_where_the_bias_says_that_the_truth_is_and_has_no_end_where_the_noise_gives_none() {
        // Found 2 too low: the truth lies above; 3-4-5 with the other uncertainty.
        let other = 3.0 / NORMAL_95;
        assert_eq!(compose([Some(4.0), Some(4.0)], -2.0, other).map(Option::unwrap), [5.0, 7.0]);
        assert_eq!(compose([Some(4.0), None], 2.0, other), [Some(7.0), None]);
    }

    #[test]
    fn linear_theory_is_in_doubt_beyond_its_thresholds_only() {
        let names = ["a", "b"];
        assert!(doubts(&names, &[LINEAR_STD, 0.0], None).is_empty());
        let even = |share: f64| [vec![0.0, share], vec![0.0, 0.0]];
        assert!(doubts(&names, &[0.0; 2], Some(&even(-LINEAR_PROBE))).is_empty());
        let both = doubts(&names, &[0.06, 0.0], Some(&even(-0.6)));
        assert!(both.len() == 2 && both[0].contains("of a is 6.0 %") && both[1].contains("0.60"), "{both:?}");
    }
}
