//! Averages over several laws, each with its weight: what is left of the choice of the law is part of the uncertainty (Burnham
//! and Anderson 2002, section 4.3).

use super::bands::CurveBand;
use super::statistics::NORMAL_95;
use statrs::distribution::{ContinuousCDF, Normal};

/// A value with its standard uncertainty and its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// The value.
    pub value: f64,
    /// Its standard uncertainty; `None` where the data give none.
    pub std: Option<f64>,
    /// Ends of the 95 % interval; `None` where it has none on that side.
    pub ends95: [Option<f64>; 2],
}

/// The average of `parts`, each with its weight; the weights have the sum 1. The interval is that of the mixture, every part
/// taken as two halves of a normal distribution that have its own interval.
pub fn average(parts: &[(f64, Spread)]) -> Spread {
    let value: f64 = parts.iter().map(|(weight, part)| weight * part.value).sum();
    let variance: Option<f64> =
        parts.iter().map(|(weight, part)| Some(weight * (part.std?.powi(2) + (part.value - value).powi(2)))).sum();
    let std = variance.map(f64::sqrt);
    let end = |side: usize| {
        // A law that hardly counts must not open the interval of the others.
        let counted: Vec<&(f64, Spread)> =
            parts.iter().filter(|(weight, part)| part.ends95[side].is_some() || *weight > 1e-3).collect();
        let ends: Option<Vec<f64>> = counted.iter().map(|(_, part)| part.ends95[side]).collect();
        let (low, high) = ends?.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &e| (a.min(e), b.max(e)));
        let sum: f64 = counted.iter().map(|(weight, _)| weight).sum();
        let share = [0.025, 0.975][side];
        let normal = Normal::standard();
        let below = |x: f64| -> f64 {
            let of_part = |(weight, part): &&(f64, Spread)| {
                // The other half is never far beyond its own value at this side of the whole.
                let own = part.ends95[usize::from(x >= part.value)].or(part.ends95[side]).unwrap_or(part.value);
                let std = (own - part.value).abs() / NORMAL_95;
                let share = match std > 0.0 {
                    true => normal.cdf((x - part.value) / std),
                    false => f64::from(u8::from(x >= part.value)),
                };
                weight / sum * share
            };
            counted.iter().map(of_part).sum()
        };
        // Every part has this share below its own end, so that the end of the whole lies between the least and the largest.
        let (mut low, mut high) = (low, high);
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if below(middle) < share { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    };
    Spread { value, std, ends95: [end(0), end(1)] }
}

/// The average of curves over the same jumps.
pub fn average_curve(parts: &[(f64, &CurveBand)]) -> CurveBand {
    let jumps = parts.first().map_or(Vec::new(), |(_, curve)| curve.jumps.clone());
    let n = jumps.len();
    let list = || Vec::with_capacity(n);
    let mut curve = CurveBand { jumps, traction: list(), std: list(), low: list(), high: list() };
    for k in 0..n {
        let at = |(weight, curve): &(f64, &CurveBand)| {
            let ends95 = [Some(curve.low[k]), Some(curve.high[k])];
            (*weight, Spread { value: curve.traction[k], std: Some(curve.std[k]), ends95 })
        };
        let here = average(&parts.iter().map(at).collect::<Vec<_>>());
        curve.traction.push(here.value);
        curve.std.push(here.std.unwrap_or(0.0));
        curve.low.push(here.ends95[0].unwrap_or(here.value));
        curve.high.push(here.ends95[1].unwrap_or(here.value));
    }
    curve
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normal(value: f64, std: f64) -> Spread {
        Spread { value, std: Some(std), ends95: [Some(value - NORMAL_95 * std), Some(value + NORMAL_95 * std)] }
    }

    #[test]
    fn one_law_averages_to_itself_and_equal_ones_too() {
        for parts in [vec![(1.0, normal(3.0, 0.2))], vec![(0.3, normal(3.0, 0.2)), (0.7, normal(3.0, 0.2))]] {
            let found = average(&parts);
            assert!((found.value - 3.0).abs() < 1e-14 && (found.std.unwrap() - 0.2).abs() < 1e-14, "{found:?}");
            // The share of the quantile is good to the digits of 0.025.
            let [low, high] = found.ends95.map(Option::unwrap);
            assert!((low - (3.0 - NORMAL_95 * 0.2)).abs() < 1e-5 && (high - (3.0 + NORMAL_95 * 0.2)).abs() < 1e-5);
        }
    }

    /// Two narrow laws far apart: 2.5 % below the lower quantile of the lower one is 5 % of it, its quantile at -1.6449.
    #[test]
    fn laws_that_differ_widen_the_interval() {
        let found = average(&[(0.5, normal(0.0, 0.1)), (0.5, normal(10.0, 0.1))]);
        assert_eq!(found.value, 5.0);
        assert!((found.std.unwrap() - (25.0_f64 + 0.01).sqrt()).abs() < 1e-12);
        let [low, high] = found.ends95.map(Option::unwrap);
        assert!((low + 0.164_485).abs() < 1e-5 && (high - 10.164_485).abs() < 1e-5, "{low} {high}");
    }

    #[test]
    fn an_open_end_stays_open_unless_its_law_hardly_counts() {
        let open = Spread { value: 1.0, std: None, ends95: [Some(0.5), None] };
        assert_eq!(average(&[(0.5, open), (0.5, normal(1.0, 0.1))]).ends95[1], None);
        assert!(average(&[(1e-6, open), (1.0 - 1e-6, normal(1.0, 0.1))]).ends95[1].is_some());
    }
}
