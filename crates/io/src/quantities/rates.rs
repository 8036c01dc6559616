//! Quantities smoothed over time, and their rates: local polynomials in time (Savitzky and Golay 1964; here on the times
//! of the frames, which need not be even).

use crate::field::Value;

/// Degree of the polynomial.
pub(super) const DEGREE: usize = 2;

/// A quantity at one time, by the polynomial around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Smooth {
    pub value: Value,
    /// Per second.
    pub rate: Value,
}

/// What `values` at `times` come to at each of these times, by the polynomial through those in a window of `window_s`
/// seconds: around the time, or at the ends of the series the first and the last such window; nothing where fewer than
/// three are known there.
///
/// `common` is the share of each variance that is the same in all frames: that of the reference. It stays in a smoothed
/// value, and goes out of a rate.
pub(super) fn smooth(
    times: &[Option<f64>],
    values: &[Option<Value>],
    window_s: f64,
    common: f64,
) -> Vec<Option<Smooth>> {
    let known: Vec<(f64, Value)> = times.iter().zip(values).filter_map(|(t, v)| Some(((*t)?, (*v)?))).collect();
    let ends = |by: fn(f64, f64) -> f64| known.iter().map(|(t, _)| *t).reduce(by);
    let (Some(first), Some(last)) = (ends(f64::min), ends(f64::max)) else { return vec![None; times.len()] };
    let half = 0.5 * window_s * (1.0 + 1e-9);
    let at = |time: f64| {
        let middle = time.min(last - half).max(first + half);
        let near: Vec<(f64, Value)> = (known.iter())
            .filter(|(t, _)| (t - middle).abs() <= half)
            .map(|(t, v)| ((t - time) / window_s, *v))
            .collect();
        let [of_value, of_slope] = weights(&near.iter().map(|(t, _)| *t).collect::<Vec<_>>())?;
        let sum = |weights: &[f64], scale: f64| {
            let (mut value, mut own, mut shared) = (0.0, 0.0, 0.0);
            for (w, (_, v)) in weights.iter().zip(&near) {
                value += w * v.value;
                own += (w * v.sigma).powi(2);
                shared += w * v.sigma;
            }
            let variance = (1.0 - common) * own + common * shared * shared;
            Value { value: value / scale, sigma: variance.sqrt() / scale }
        };
        Some(Smooth { value: sum(&of_value, 1.0), rate: sum(&of_slope, window_s) })
    };
    times.iter().map(|time| at((*time)?)).collect()
}

/// Weights of values at `times` in the value at 0 and in the slope there of the polynomial that fits them best; `None`
/// where they do not determine it.
fn weights(times: &[f64]) -> Option<[Vec<f64>; 2]> {
    let moment = |power: i32| times.iter().map(|t| t.powi(power)).sum::<f64>();
    let [m0, m1, m2, m3, m4] = [0, 1, 2, 3, 4].map(moment);
    let minors = [m2 * m4 - m3 * m3, m2 * m3 - m1 * m4, m1 * m3 - m2 * m2];
    let det = m0 * minors[0] + m1 * minors[1] + m2 * minors[2];
    // Two times that differ, or one, leave nothing but rounding.
    if times.len() <= DEGREE || det <= 1e-12 * m0 * m2 * m4 {
        return None;
    }
    let slope = [minors[1], m0 * m4 - m2 * m2, m1 * m2 - m0 * m3];
    let row = |of: [f64; 3]| times.iter().map(|t| (of[0] + of[1] * t + of[2] * t * t) / det).collect();
    Some([row(minors), row(slope)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_times_have_the_weights_of_savitzky_and_golay() {
        let [value, slope] = weights(&[-2.0, -1.0, 0.0, 1.0, 2.0]).unwrap();
        for (found, exact) in value.iter().zip([-3.0, 12.0, 17.0, 12.0, -3.0]) {
            assert!((found - exact / 35.0).abs() < 1e-14, "{value:?}");
        }
        for (found, exact) in slope.iter().zip([-2.0, -1.0, 0.0, 1.0, 2.0]) {
            assert!((found - exact / 10.0).abs() < 1e-14, "{slope:?}");
        }
        assert_eq!(weights(&[-1.0, 1.0]), None);
        assert_eq!(weights(&[0.1, 0.1, 0.1, 0.1]), None);
    }

    #[test]
    fn a_parabola_at_uneven_times_is_kept_up_to_both_ends() {
        let times: Vec<f64> = (0..12).map(|k| f64::from(k) * 0.7 + 0.2 * f64::from(k % 3)).collect();
        let of = |t: f64| 2.0 - 0.3 * t + 0.05 * t * t;
        let values: Vec<_> = times.iter().map(|&t| Some(Value { value: of(t), sigma: 0.1 })).collect();
        let known: Vec<_> = times.iter().map(|&t| Some(t)).collect();
        for (t, found) in times.iter().zip(smooth(&known, &values, 3.0, 0.5)) {
            let found = found.unwrap();
            assert!((found.value.value - of(*t)).abs() < 1e-12 && (found.rate.value + 0.3 - 0.1 * t).abs() < 1e-12);
        }
        // Frames without a value are passed over; a window with two of them has nothing.
        let mut few = values.clone();
        few.iter_mut().skip(2).for_each(|value| *value = None);
        assert!(smooth(&known, &few, 3.0, 0.5).iter().all(Option::is_none));
    }

    #[test]
    fn the_printed_uncertainty_is_the_scatter_and_the_reference_goes_out_of_a_rate() {
        // Noise of the reference, common to all frames, and of each frame, alike large: a share of a half is common.
        let times: Vec<_> = (0..9).map(|k| Some(f64::from(k))).collect();
        let mut state = 7u64;
        let mut normal = || {
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
            };
            (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
        };
        let (mut squares, mut n) = ([0.0; 2], 0.0);
        for _ in 0..4000 {
            let reference = normal();
            let values: Vec<_> =
                times.iter().map(|_| Some(Value { value: reference + normal(), sigma: 2f64.sqrt() })).collect();
            let found = smooth(&times, &values, 6.0, 0.5)[4].unwrap();
            squares[0] += (found.value.value / found.value.sigma).powi(2);
            squares[1] += (found.rate.value / found.rate.sigma).powi(2);
            n += 1.0;
        }
        // 4000 draws know a ratio to 1.1 %.
        assert!(squares.iter().all(|s| ((s / n).sqrt() - 1.0).abs() < 0.04), "{squares:?}");
    }
}
