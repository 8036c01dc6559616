//! The 95 % intervals: whether linear theory is good enough for them, and what they are made of (THEORY 7, 11).

use crate::identify::{
    Base, Bootstrap, Budget, Derived, FittedParameter, FittedQuantity, NORMAL_95, Parts, ProfileEnds, derived,
    interval95,
};
use crate::io::case::Intervals;

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
    /// What a pair of opposite draws of noise does to each scaled unknown beyond linear theory, in standard
    /// uncertainties: the even part, which is the bias that the noise makes, and the odd part. `None` where that
    /// was not computed.
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
    /// Draws of the bootstrap that was to be made; 0 for none.
    pub draws: usize,
    /// The bootstrap, which counts the draws that failed; `None` where none was to be made, or no pair of draws gave
    /// two fits.
    pub bootstrap: Option<Bootstrap>,
    /// What noise shifts each scaled unknown by on average (found less true), by bootstrap or probe.
    pub bias: Option<Vec<f64>>,
}

impl IntervalBasis {
    /// The linear one, of which nothing was looked for.
    fn linear() -> Self {
        let (kind, linearity) = (IntervalKind::Linear, Linearity::default());
        Self { kind, linearity, draws: 0, bootstrap: None, bias: None }
    }

    /// Draws of the bootstrap that failed or did not converge; all of them where nothing came of it.
    pub fn failed(&self) -> usize {
        self.bootstrap.as_ref().map_or(self.draws, |bootstrap| bootstrap.failed)
    }
}

/// Why linear intervals may not be good, from the relative standard uncertainties of the parameters called `names`, and
/// from the even and the odd part of a probe in standard uncertainties.
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

/// What gets intervals, with what adds up with the noise.
struct Settled<'a> {
    base: &'a Base<'a>,
    budget: &'a Budget,
    parameters: &'a mut [FittedParameter],
    quantities: &'a mut [FittedQuantity],
    /// Derivatives of the unknowns by the scaled unknowns.
    slopes: Vec<f64>,
}

/// Gives `parameters` and `quantities` the intervals that `wanted` asks for; `n_draws` is the size of the bootstrap,
/// `budget` has what adds up with the noise.
pub(crate) fn settle(
    base: &Base<'_>,
    wanted: Intervals,
    n_draws: Option<usize>,
    budget: &Budget,
    parameters: &mut [FittedParameter],
    quantities: &mut [FittedQuantity],
) -> IntervalBasis {
    let x = &base.evaluation.x;
    let slopes = base.problem.unknowns.slopes(x);
    let n = x.len();
    let scaled_std: Vec<f64> = (0..n).map(|k| base.statistics.covariance[(k, k)].max(0.0).sqrt()).collect();
    let relative: Vec<f64> = (0..n).map(|k| scaled_std[k] * slopes[k] / x[k].abs().max(f64::MIN_POSITIVE)).collect();
    let names: Vec<&str> = parameters.iter().map(|p| p.parameter.name).collect();
    let mut basis = IntervalBasis::linear();
    let mut of = Settled { base, budget, parameters, quantities, slopes };
    of.set_linear(None);
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
    if wanted == Intervals::Auto && !basis.linearity.in_doubt() {
        let Some([even, _]) = &basis.linearity.probe else { return basis };
        let bias: Vec<f64> = even.iter().zip(&scaled_std).map(|(share, std)| share * std).collect();
        of.set_linear(Some(&bias));
        basis.bias = Some(bias);
        return basis;
    }
    basis.kind = IntervalKind::Profile;
    let pairs = n_draws.unwrap_or(DRAWS).div_ceil(2);
    if pairs > 0 && !base.follows_data {
        basis.draws = 2 * pairs;
        basis.bootstrap = base.bootstrap(pairs);
        basis.bias = basis.bootstrap.as_ref().map(|bootstrap| bootstrap.bias.clone());
    }
    of.set_profile(basis.bootstrap.as_ref());
    basis
}

/// The interval of linear theory.
fn linear(value: f64, bias: f64, parts: Parts) -> [Option<f64>; 2] {
    interval95(value, [Some(NORMAL_95 * parts.noise); 2], bias, parts.others)
}

impl Settled<'_> {
    /// Sets the intervals of linear theory, extended by this bias of the scaled unknowns, if any.
    fn set_linear(&mut self, bias: Option<&[f64]>) {
        for (k, p) in self.parameters.iter_mut().enumerate() {
            (p.bias_std, p.std_bootstrap) = (None, None);
            p.bias = bias.map(|bias| self.slopes[k] * bias[k]);
            p.set_ends(linear(p.value, p.bias.unwrap_or(0.0), self.budget.parameter(k)));
        }
        let by_scaled = bias.map_or(Vec::new(), |_| by_scaled(self.base));
        for (k, q) in self.quantities.iter_mut().enumerate() {
            let slopes = by_scaled.get(k).zip(bias);
            q.bias = slopes.map(|(slopes, bias)| slopes.iter().zip(bias).map(|(slope, bias)| slope * bias).sum());
            q.set_ends(linear(q.quantity.value, q.bias.unwrap_or(0.0), self.budget.quantity(k)));
        }
    }

    /// Sets the intervals of the profile likelihood, extended by the bias of the `bootstrap`.
    fn set_profile(&mut self, bootstrap: Option<&Bootstrap>) {
        let unknowns = &self.base.problem.unknowns;
        let z = unknowns.scaled(&self.base.evaluation.x);
        let n = z.len();
        let ends = ProfileEnds::new(self.base);
        let found = ends.as_ref().map(|ends| {
            let directions = (0..n).map(|k| (0..n).map(|j| f64::from(j == k)).collect());
            let of_quantities = by_scaled(self.base).into_iter().zip(self.quantities.iter());
            let of_quantities = of_quantities.map(|(slopes, q)| slopes.iter().map(|s| s / q.quantity.value).collect());
            ends.along(&directions.chain(of_quantities).collect::<Vec<_>>())
        });
        let end = |direction: usize, side: usize| found.as_ref().and_then(|found| found[direction][side].as_deref());
        for (k, p) in self.parameters.iter_mut().enumerate() {
            let slope = self.slopes[k];
            let noise = [0, 1].map(|side| end(k, side).map(|end| (end[k] - z[k]).abs()));
            let bias = bootstrap.map(|b| b.bias[k]);
            let ends = interval95(z[k], noise, bias.unwrap_or(0.0), self.budget.parameter(k).others / slope);
            let there = |end: f64| {
                let mut z = z.clone();
                z[k] = end;
                unknowns.unscaled(&z)[k]
            };
            p.bias = bias.map(|bias| slope * bias);
            p.bias_std = bootstrap.and_then(|b| b.bias_std.as_ref()).map(|std| slope * std[k]);
            p.std_bootstrap = bootstrap.map(|b| slope * b.std[k]);
            p.set_ends(ends.map(|end| end.map(there)));
        }
        let value = |z: &[f64], q: usize| {
            let law = unknowns.law_at(&unknowns.unscaled(z)).ok()?;
            derived(&*law, self.base.furthest).get(q).map(|quantity| quantity.value).filter(|value| *value > 0.0)
        };
        for (k, q) in self.quantities.iter_mut().enumerate() {
            let here = q.quantity.value;
            if here <= 0.0 {
                continue;
            }
            // In logarithms, as the parameters.
            let noise = [0, 1].map(|side| value(end(n + k, side)?, k).map(|there| (there / here).ln().abs()));
            let errors = bootstrap.map(|b| {
                let relative = |error: &Vec<f64>| {
                    let there: Vec<f64> = z.iter().zip(error).map(|(z, e)| z + e).collect();
                    value(&there, k).map_or(0.0, |there| (there / here).ln())
                };
                b.errors.iter().map(relative).sum::<f64>() / b.errors.len().max(1) as f64
            });
            q.bias = errors.map(|bias| bias * here);
            let ends = interval95(0.0, noise, errors.unwrap_or(0.0), self.budget.quantity(k).others / here);
            q.set_ends(ends.map(|end| end.map(|end| here * end.exp())));
        }
    }
}

/// Derivatives of the derived quantities by the scaled unknowns.
fn by_scaled(base: &Base<'_>) -> Vec<Vec<f64>> {
    let unknowns = &base.problem.unknowns;
    let z = unknowns.scaled(&base.evaluation.x);
    let at = |k: usize, h: f64| {
        let mut z = z.clone();
        z[k] += h;
        unknowns.law_at(&unknowns.unscaled(&z)).map(|law| derived(&*law, base.furthest)).unwrap_or_default()
    };
    const H: f64 = 1e-5;
    let sides: Vec<_> = (0..z.len()).map(|k| (at(k, H), at(k, -H))).collect();
    let n = sides.first().map_or(0, |(more, _)| more.len());
    let slope = |q: usize, (more, less): &(Vec<Derived>, Vec<Derived>)| {
        more.get(q).zip(less.get(q)).map_or(0.0, |(more, less)| (more.value - less.value) / (2.0 * H))
    };
    (0..n).map(|q| sides.iter().map(|side| slope(q, side)).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
