//! Averages over several laws, each with its weight: what is left of the choice of the law is part of the uncertainty (Burnham
//! and Anderson 2002, section 4.3).

use super::bands::CurveBand;

/// Difference of `omega + 2 p` up to which two laws cannot be told apart: the worse one is then at least exp(-3) = 5 % as likely.
pub const ALIKE: f64 = 6.0;

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

/// The average of `parts`, each with its weight; the weights have the sum 1. Value and standard uncertainty are those of the mixture. The
/// interval holds those of all laws that cannot be told from the most likely one ([`ALIKE`]): a weight says which of them noise favours
/// today, and quantiles of the mixture held the truth in 84 % of the tractions of laws that differ by less.
pub fn average(parts: &[(f64, Spread)]) -> Spread {
    let value: f64 = parts.iter().map(|(weight, part)| weight * part.value).sum();
    let variance: Option<f64> =
        parts.iter().map(|(weight, part)| Some(weight * (part.std?.powi(2) + (part.value - value).powi(2)))).sum();
    let most = parts.iter().fold(0.0_f64, |most, (weight, _)| most.max(*weight));
    // Rounding must not decide about a law at the limit.
    let alike = |weight: f64| weight >= (1.0 - 1e-9) * (-0.5 * ALIKE).exp() * most;
    let end = |side: usize, further: fn(f64, f64) -> f64| {
        let ends = parts.iter().filter(|(weight, _)| alike(*weight)).map(|(_, part)| part.ends95[side]);
        ends.collect::<Option<Vec<f64>>>()?.into_iter().reduce(further)
    };
    Spread { value, std: variance.map(f64::sqrt), ends95: [end(0, f64::min), end(1, f64::max)] }
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
    use crate::identify::NORMAL_95;

    fn normal(value: f64, std: f64) -> Spread {
        Spread { value, std: Some(std), ends95: [Some(value - NORMAL_95 * std), Some(value + NORMAL_95 * std)] }
    }

    #[test]
    fn one_law_averages_to_itself_and_equal_ones_too() {
        for parts in [vec![(1.0, normal(3.0, 0.2))], vec![(0.3, normal(3.0, 0.2)), (0.7, normal(3.0, 0.2))]] {
            let found = average(&parts);
            assert!((found.value - 3.0).abs() < 1e-14 && (found.std.unwrap() - 0.2).abs() < 1e-14, "{found:?}");
            assert_eq!(found.ends95, normal(3.0, 0.2).ends95);
        }
    }

    #[test]
    fn an_interval_holds_those_of_all_laws_that_cannot_be_told_apart() {
        let found = average(&[(0.9, normal(0.0, 0.1)), (0.08, normal(10.0, 0.1)), (0.02, normal(50.0, 0.1))]);
        assert!((found.value - 1.8).abs() < 1e-12);
        assert!(
            (found.std.unwrap()
                - (0.01_f64 + 0.9 * 1.8_f64.powi(2) + 0.08 * 8.2_f64.powi(2) + 0.02 * 48.2_f64.powi(2)).sqrt())
            .abs()
                < 1e-12
        );
        // exp(-3) of the weight of the first: the second counts, the third does not.
        assert_eq!(found.ends95, [normal(0.0, 0.1).ends95[0], normal(10.0, 0.1).ends95[1]]);
    }

    #[test]
    fn an_open_end_stays_open_unless_its_law_is_told_from_the_best() {
        let open = Spread { value: 1.0, std: None, ends95: [Some(0.5), None] };
        assert_eq!(average(&[(0.1, open), (0.9, normal(1.0, 0.1))]).ends95, [Some(0.5), None]);
        assert!(average(&[(0.01, open), (0.99, normal(1.0, 0.1))]).ends95[1].is_some());
    }
}
