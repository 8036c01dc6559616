//! The shear traction along a lap from the displacements of its adherends (THEORY 23): `dN/ds = T_t` in the upper one and
//! `-T_t` in the lower, `N = E t du/ds`, u being the mean over the thickness; N is zero at a free end. T is a spline whose
//! smoothness the evidence chooses, u its double integral and what it does not tell.

use super::traction::{Basis, N, log_determinant};
use crate::field::Value;
use crate::linalg::Dense;
use serde::Serialize;

/// Unknowns: the spline, and displacement and strain where the lap begins, of each adherend.
const ALL: usize = N + 4;
/// Points of the second integral.
const FINE: usize = 600;
/// Evidences that differ by less, in natural logarithms, tell nothing: a factor of e^2.
const ALIKE: f64 = 2.0;
/// Samples, at least.
const FEWEST: usize = 8;

/// The shear traction along a lap.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LapCurve {
    /// Places along the lap, mm.
    pub along_mm: Vec<f64>,
    /// Shear traction, MPa: positive where it resists that the upper adherend slides along the joint.
    #[serde(rename = "traction_MPa")]
    pub traction_mpa: Vec<f64>,
    /// Its standard uncertainty, MPa, of images.
    #[serde(rename = "std_MPa")]
    pub std_mpa: Vec<f64>,
    /// Mean over the lap, MPa.
    #[serde(skip)]
    pub mean_mpa: Value,
    /// The largest, MPa.
    #[serde(skip)]
    pub largest_mpa: Value,
}

/// What is measured of an adherend along the lap.
#[derive(Debug, Clone, PartialEq)]
pub struct Adherend {
    /// Places along it (mm), and the mean displacement over the thickness there (mm).
    pub samples: Vec<(f64, Value)>,
    /// Which of its ends carries nothing: that where the lap begins (0), or the other (1). `None` where both may.
    pub free: Option<usize>,
}

/// The traction along a lap between 0 and `length` (mm) whose `adherends`, the upper and, where it is measured, the lower
/// one, have the stiffness `E t` (N/mm, by unit of width). The curve is at the places of the upper one. `None` where
/// there are fewer than 8.
pub fn shear_along(adherends: &[Adherend], length: f64, stiffness: f64) -> Option<LapCurve> {
    let upper = adherends.first().filter(|upper| upper.samples.len() >= FEWEST && length > 0.0)?;
    let samples: Vec<(usize, f64, Value)> = (adherends.iter().take(2).enumerate())
        .flat_map(|(of, adherend)| adherend.samples.iter().map(move |(at, u)| (of, *at, *u)))
        .collect();
    let least = samples.iter().map(|(_, _, u)| u.sigma).fold(0.0, f64::max) * 1e-6;
    // Even knots.
    let basis = Basis::new(length, 1e3);
    let step = length / FINE as f64;
    let mut twice = vec![[0.0; N]; FINE + 1];
    for k in 1..=FINE {
        let middle = basis.integrals(step * (k as f64 - 0.5));
        twice[k] = std::array::from_fn(|f| twice[k - 1][f] + step * middle[f]);
    }
    let whole = basis.integrals(length);
    let row = |(of, at, _): &(usize, f64, Value)| -> [f64; ALL] {
        let at = at.clamp(0.0, length);
        let place = (at / step).min(FINE as f64 - 1e-9);
        let (k, t) = (place as usize, place.fract());
        let free = adherends[*of].free;
        let sign = if *of == 0 { 1.0 } else { -1.0 };
        // Where the other end is free, N begins with all that the lap takes.
        let from_start = if free == Some(1) { at } else { 0.0 };
        let mut row = [0.0; ALL];
        for f in 0..N {
            row[f] = sign * ((1.0 - t) * twice[k][f] + t * twice[k + 1][f] - from_start * whole[f]) / stiffness;
        }
        row[N + 2 * of] = 1.0;
        row[N + 2 * of + 1] = if free.is_none() { at / length } else { 0.0 };
        row
    };
    let rows: Vec<[f64; ALL]> = samples.iter().map(row).collect();
    let weights: Vec<f64> = samples.iter().map(|(_, _, u)| 1.0 / u.sigma.max(least).max(1e-12).powi(2)).collect();
    let sum = |of: &dyn Fn(usize) -> f64| (0..rows.len()).map(|k| weights[k] * of(k)).sum::<f64>();
    let normal = Dense::from_fn(ALL, ALL, |a, b| sum(&|k| rows[k][a] * rows[k][b]));
    let right = Dense::from_fn(ALL, 1, |a, _| sum(&|k| rows[k][a] * samples[k].2.value));
    let bend = |c: &[f64]| (0..N - 2).map(|k| (c[k] - 2.0 * c[k + 1] + c[k + 2]).powi(2)).sum::<f64>();
    let fit = |lambda: f64| {
        let mut matrix = normal.clone();
        let by = [1.0, -2.0, 1.0];
        (0..N - 2).for_each(|k| {
            (0..3).for_each(|a| (0..3).for_each(|b| matrix[(k + a, k + b)] += lambda * by[a] * by[b]));
        });
        let trace = (0..N).map(|k| normal[(k, k)]).sum::<f64>();
        // Held just so that what nothing tells is no singular matrix.
        (0..N).for_each(|k| matrix[(k, k)] += 1e-12 * trace / N as f64);
        (N..ALL).filter(|&k| normal[(k, k)] == 0.0).for_each(|k| matrix[(k, k)] = 1.0);
        let factor = matrix.cholesky().ok()?;
        let values = factor.solve(&right).column(0).to_vec();
        let off = |k: usize| samples[k].2.value - rows[k].iter().zip(&values).map(|(a, b)| a * b).sum::<f64>();
        let misfit = sum(&|k| off(k).powi(2));
        let prior = (N - 2) as f64 * lambda.ln() - lambda * bend(&values);
        Some((0.5 * (prior - log_determinant(&factor, ALL) - misfit), values, factor))
    };
    let tried: Vec<_> = (-24..=24).filter_map(|third| fit(10f64.powf(f64::from(third) / 3.0))).collect();
    let most = tried.iter().map(|(evidence, ..)| *evidence).fold(f64::NEG_INFINITY, f64::max);
    // The roughest that the evidence does not tell from the best: a straight line that noise allows claims too much.
    let (_, values, factor) = tried.into_iter().find(|(evidence, ..)| *evidence >= most - ALIKE)?;
    let covariance = factor.inverse();
    let read = |weights: &[f64; N]| -> Value {
        let value = weights.iter().zip(&values).map(|(w, c)| w * c).sum();
        let through = |a: usize| (0..N).map(|b| covariance[(a, b)] * weights[b]).sum::<f64>();
        let variance: f64 = (0..N).map(|a| weights[a] * through(a)).sum();
        Value { value, sigma: variance.max(0.0).sqrt() }
    };
    let mut along_mm: Vec<f64> = upper.samples.iter().map(|(at, _)| at.clamp(0.0, length)).collect();
    along_mm.sort_by(f64::total_cmp);
    let curve: Vec<Value> = along_mm.iter().map(|at| read(&basis.row(*at))).collect();
    let largest_mpa = *curve.iter().max_by(|a, b| a.value.abs().total_cmp(&b.value.abs()))?;
    Some(LapCurve {
        along_mm,
        traction_mpa: curve.iter().map(|t| t.value).collect(),
        std_mpa: curve.iter().map(|t| t.sigma).collect(),
        mean_mpa: read(&whole.map(|v| v / length)),
        largest_mpa,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const STIFFNESS: f64 = 112_000.0;
    const LENGTH: f64 = 12.0;

    /// Volkersen's lap: `T = A cosh(w (s - l/2))`; and the displacements of the upper adherend, whose left end is free, and
    /// of the lower one, whose right end is.
    fn lap(s: f64) -> [f64; 3] {
        let (a, w) = (5.0, 0.35);
        let x = |s: f64| w * (s - 0.5 * LENGTH);
        let force = |s: f64| a / w * (x(s).sinh() - x(0.0).sinh());
        let twice = a / (w * w) * (x(s).cosh() - x(0.0).cosh()) - a / w * x(0.0).sinh() * s;
        [a * x(s).cosh(), twice / STIFFNESS, (force(LENGTH) * s - twice) / STIFFNESS]
    }

    fn adherends(frees: [Option<usize>; 2], mut noise: impl FnMut() -> f64, sigma: f64) -> Vec<Adherend> {
        let mut samples = |of: usize| {
            let at = (0..41).map(|k| 0.3 * f64::from(k));
            at.map(|s| (s, Value { value: lap(s)[1 + of] + sigma * noise(), sigma })).collect()
        };
        let [upper, lower] = [samples(0), samples(1)];
        vec![Adherend { samples: upper, free: frees[0] }, Adherend { samples: lower, free: frees[1] }]
    }

    #[test]
    fn the_traction_of_a_lap_is_that_of_volkersen_within_what_is_stated() {
        // The mean of cosh.
        let mean = 5.0 / 2.1 * f64::sinh(2.1);
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut widths = Vec::new();
        for frees in [[None, None], [Some(0), Some(1)]] {
            let (mut off, mut held, mut n, mut width) = (0.0, 0, 0, 0.0);
            for _ in 0..40 {
                let of = adherends(frees, || StandardNormal.sample(&mut random), 2e-5);
                let found = shear_along(&of, LENGTH, STIFFNESS).unwrap();
                for k in 0..found.along_mm.len() {
                    let z = (found.traction_mpa[k] - lap(found.along_mm[k])[0]) / found.std_mpa[k];
                    (off, held, n) = (off + z * z, held + usize::from(z.abs() < 1.96), n + 1);
                    width += found.std_mpa[k];
                }
                assert!((found.mean_mpa.value - mean).abs() < 4.0 * found.mean_mpa.sigma, "{:?}", found.mean_mpa);
            }
            let (rms, share) = ((off / n as f64).sqrt(), held as f64 / n as f64);
            assert!((0.5..1.3).contains(&rms) && share > 0.88, "{rms} {share}");
            widths.push(width);
        }
        // Free ends tell the force itself, not its slope alone.
        assert!(widths[1] < 0.7 * widths[0], "{widths:?}");
    }

    #[test]
    fn without_noise_the_traction_is_exact_and_few_places_give_none() {
        let of = adherends([Some(0), Some(1)], || 0.0, 1e-9);
        let found = shear_along(&of, LENGTH, STIFFNESS).unwrap();
        for (at, traction) in found.along_mm.iter().zip(&found.traction_mpa) {
            assert!((traction - lap(*at)[0]).abs() < 0.02 * lap(*at)[0], "{at}: {traction} for {}", lap(*at)[0]);
        }
        let few = Adherend { samples: of[0].samples[..7].to_vec(), free: None };
        assert!(shear_along(&[few], LENGTH, STIFFNESS).is_none());
    }
}
