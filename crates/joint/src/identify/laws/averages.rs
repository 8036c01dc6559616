//! Averages over several laws, each with its weight: what is left of the choice of the law is part of the uncertainty
//! (Burnham and Anderson 2002, section 4.3).

use crate::identify::{CurveBand, NORMAL_95};

/// 99 % quantile of a standard normal variable, one-sided.
const NORMAL_99: f64 = 2.326;

/// By how much noise alone puts omega of a law with `n_best` parameters below that of another with `n`, where both
/// describe the joint equally well: mean and standard deviation. Each has then fitted as much noise as it has
/// parameters: chi-square of `n_best` less chi-square of `n`, whose scatter is largest where they fit different parts
/// of it.
fn of_noise(n_best: usize, n: usize) -> [f64; 2] {
    let [best, other] = [n_best, n].map(|n| n as f64);
    [best - other, (2.0 * (best + other)).sqrt()]
}

/// The same, exceeded in one of a hundred tests (taken as normal): up to here two laws cannot be told apart.
pub fn within_noise(n_best: usize, n: usize) -> f64 {
    let [mean, std] = of_noise(n_best, n);
    mean + NORMAL_99 * std
}

/// What is left of the half-widths of the 95 % intervals of a law whose omega lies `above` that of the best: all of
/// them while noise puts it there in the ordinary run of things, one standard deviation beyond its mean; beyond, what
/// the profile of the likelihood over all laws leaves, down to nothing where no value of the law is within 1.96^2.
pub fn share_of_interval(above: f64, n_best: usize, n: usize) -> f64 {
    let [mean, std] = of_noise(n_best, n);
    let beyond = (above - mean - std).max(0.0);
    (1.0 - beyond / NORMAL_95.powi(2)).max(0.0).sqrt()
}

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

/// What one law adds to an average.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part<T> {
    /// Its weight; all together have the sum 1.
    pub weight: f64,
    /// Share of the half-widths of its interval that counts: [`share_of_interval`].
    pub share: f64,
    /// What it has.
    pub of: T,
}

/// The average of `parts`. Value and standard uncertainty are those of the mixture. The interval holds what counts of
/// those of all laws: a weight says which of them noise favours today, and quantiles of the mixture hold the truth less
/// often than the true law by itself does (docs/identification.md, "Law against law").
pub fn average(parts: &[Part<Spread>]) -> Spread {
    let value: f64 = parts.iter().map(|part| part.weight * part.of.value).sum();
    let variance: Option<f64> =
        parts.iter().map(|part| Some(part.weight * (part.of.std?.powi(2) + (part.of.value - value).powi(2)))).sum();
    let end = |side: usize, further: fn(f64, f64) -> f64| {
        let counted = parts.iter().filter(|part| part.share > 0.0);
        let ends = counted.map(|part| Some(part.of.value + part.share * (part.of.ends95[side]? - part.of.value)));
        ends.collect::<Option<Vec<f64>>>()?.into_iter().reduce(further)
    };
    Spread { value, std: variance.map(f64::sqrt), ends95: [end(0, f64::min), end(1, f64::max)] }
}

/// The average of curves over the same jumps.
pub fn average_curve(parts: &[Part<&CurveBand>]) -> CurveBand {
    let jumps = parts.first().map_or(Vec::new(), |part| part.of.jumps.clone());
    let mut curve = CurveBand { jumps, ..CurveBand::default() };
    for k in 0..curve.jumps.len() {
        let at = |&Part { weight, share, of }: &Part<&CurveBand>| {
            let ends95 = [Some(of.low[k]), Some(of.high[k])];
            Part { weight, share, of: Spread { value: of.traction[k], std: Some(of.std[k]), ends95 } }
        };
        let here = average(&parts.iter().map(at).collect::<Vec<_>>());
        curve.traction.push(here.value);
        curve.std.push(here.std.unwrap_or(f64::INFINITY));
        curve.low.push(here.ends95[0].unwrap_or(f64::NEG_INFINITY));
        curve.high.push(here.ends95[1].unwrap_or(f64::INFINITY));
    }
    curve
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn normal(value: f64, std: f64) -> Spread {
        Spread { value, std: Some(std), ends95: [Some(value - NORMAL_95 * std), Some(value + NORMAL_95 * std)] }
    }

    fn part(weight: f64, share: f64, of: Spread) -> Part<Spread> {
        Part { weight, share, of }
    }

    #[test]
    fn one_law_averages_to_itself_and_equal_ones_too() {
        let law = normal(3.0, 0.2);
        for parts in [vec![part(1.0, 1.0, law)], vec![part(0.3, 1.0, law), part(0.7, 1.0, law)]] {
            let found = average(&parts);
            assert!((found.value - 3.0).abs() < 1e-14 && (found.std.unwrap() - 0.2).abs() < 1e-14, "{found:?}");
            assert_eq!(found.ends95, law.ends95);
        }
    }

    #[test]
    fn an_interval_holds_what_counts_of_those_of_all_laws() {
        let found = average(&[
            part(0.9, 1.0, normal(0.0, 0.1)),
            part(0.08, 0.5, normal(10.0, 0.1)),
            part(0.02, 0.0, normal(50.0, 0.1)),
        ]);
        assert!((found.value - 1.8).abs() < 1e-12);
        let variance = 0.01 + 0.9 * 1.8_f64.powi(2) + 0.08 * 8.2_f64.powi(2) + 0.02 * 48.2_f64.powi(2);
        assert!((found.std.unwrap() - variance.sqrt()).abs() < 1e-12);
        assert_eq!(found.ends95, [normal(0.0, 0.1).ends95[0], Some(10.0 + 0.5 * NORMAL_95 * 0.1)]);
    }

    #[test]
    fn an_interval_counts_whole_up_to_the_scatter_of_noise_and_not_at_all_where_no_value_is_allowed() {
        // Four parameters each: no mean, standard deviation 4.
        let share = |above: f64| share_of_interval(above, 4, 4);
        assert_eq!([share(-3.0), share(4.0)], [1.0, 1.0]);
        let half = share(4.0 + 0.75 * NORMAL_95.powi(2));
        assert!((half - 0.5).abs() < 1e-12, "{half}");
        assert_eq!(share(4.0 + NORMAL_95.powi(2) + 1e-9), 0.0);
    }

    #[test]
    fn noise_alone_puts_one_law_that_far_below_another_in_one_of_a_hundred_draws() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let mut squares = |n: usize| (0..n).map(|_| normal().powi(2)).sum::<f64>();
        for (best, other) in [(7, 5), (6, 5), (4, 4), (3, 7)] {
            let limit = within_noise(best, other);
            let above = (0..20_000).filter(|_| squares(best) - squares(other) > limit).count();
            // 200 wanted; the distribution has longer tails than a normal one, and 20 000 draws scatter by 14.
            assert!((100..500).contains(&above), "{best} against {other}: {above} of 20000 above {limit}");
        }
    }

    #[test]
    fn a_curve_of_which_nothing_is_known_leaves_the_average_open() {
        let curve = |std: f64, half: f64| CurveBand {
            jumps: vec![crate::mechanics::cohesive::Jump::default()],
            traction: vec![10.0],
            std: vec![std],
            low: vec![10.0 - half],
            high: vec![10.0 + half],
        };
        let (known, open) = (curve(0.5, 1.0), curve(f64::INFINITY, f64::INFINITY));
        let of = |share: f64| {
            average_curve(&[Part { weight: 0.9, share: 1.0, of: &known }, Part { weight: 0.1, share, of: &open }])
        };
        let both = of(1.0);
        assert_eq!((both.low[0], both.high[0], both.std[0]), (f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY));
        let best = of(0.0);
        assert_eq!((best.low[0], best.high[0]), (9.0, 11.0));
    }

    #[test]
    fn an_open_end_stays_open_unless_its_law_is_told_from_the_best() {
        let open = Spread { value: 1.0, std: None, ends95: [Some(0.5), None] };
        let known = part(0.9, 1.0, normal(1.0, 0.1));
        assert_eq!(average(&[part(0.1, 1.0, open), known]).ends95, [Some(0.5), None]);
        assert_eq!(average(&[part(0.1, 0.0, open), known]).ends95, known.of.ends95);
    }
}
