//! Bias of the interpolation (THEORY 21): a displacement by a fraction t of a pixel is measured as `t + b(t)`, alike at
//! all nodes. It follows from the power spectrum S of the reference along each axis. Of a wave number w the kernel makes
//! `E(w, t) exp(i w (x + t))`, and `b(t) = sum S D Im E / sum S D w`, D the response of the gradient.

use crate::imaging::{Image, Interpolation};
use crate::mesh::Mesh;
use crate::units::Px;
use quadrille_fourier::num_complex::Complex32;
use quadrille_fourier::single;
use std::f64::consts::PI;

/// Pixels of a piece of a row whose spectrum is taken, the most that a zone holds.
const LENGTHS: [usize; 3] = [64, 32, 16];
/// Rows of a zone that are taken, and pieces of a row, at most.
const ROWS: usize = 32;
const PIECES: usize = 16;
/// Fractions of a pixel that are tabulated, and as many mirrored: `b(1 - t) = -b(t)`.
const FRACTIONS: usize = 32;
/// Pixels on either side that a cardinal spline reaches, but for 4e-5 of the quintic one.
const REACH: i32 = 12;

/// Size of the bias for displacements along x and y over the fraction of a pixel.
pub(crate) struct InterpolationBias([[f64; FRACTIONS + 1]; 2]);

impl InterpolationBias {
    /// Of a reference whose white noise has the standard deviation `noise`, grey levels, and whose gradient is that of
    /// grey levels smoothed by a Gaussian of `smoothing_px`.
    pub fn new(
        image: &Image,
        mesh: &Mesh<Px>,
        (interpolation, smoothing_px): (Interpolation, f64),
        noise: f64,
    ) -> Self {
        let waves = |k: usize, length: usize| PI * k as f64 / (length / 2) as f64;
        let of_gradient: Vec<(f64, f64)> =
            (-REACH..=REACH).map(|k| (f64::from(k), interpolation.gradient_weight(k))).collect();
        let gradient = |w: f64| {
            let slope: f64 = of_gradient.iter().map(|(k, weight)| weight * (w * k).sin()).sum();
            slope * (-0.5 * (w * smoothing_px).powi(2)).exp()
        };
        let spectra = [0, 1].map(|axis| {
            let power = LENGTHS.into_iter().find_map(|length| power_spectrum(image, mesh, axis, length, noise));
            let power = power.unwrap_or_default();
            let length = 2 * power.len().saturating_sub(1).max(1);
            let terms = power.into_iter().enumerate().map(|(k, power)| (waves(k, length), power));
            terms.map(|(w, power)| (w, power * gradient(w))).collect::<Vec<_>>()
        });
        let mut bias = Self([[0.0; FRACTIONS + 1]; 2]);
        for k in 0..=FRACTIONS {
            let t = 0.5 * k as f64 / FRACTIONS as f64;
            let weights: Vec<(f64, f64)> =
                (-REACH..=REACH).map(|n| (f64::from(n) - t, interpolation.cardinal(t - f64::from(n)))).collect();
            for (bias, spectrum) in bias.0.iter_mut().zip(&spectra) {
                let of_wave = |w: f64| weights.iter().map(|(x, weight)| weight * (w * x).sin()).sum::<f64>();
                let sum: f64 = spectrum.iter().map(|&(w, power)| power * of_wave(w)).sum();
                let whole: f64 = spectrum.iter().map(|&(w, power)| power * w).sum();
                bias[k] = if whole > 0.0 { (sum / whole).abs() } else { 0.0 };
            }
        }
        bias
    }

    /// Its size at a displacement, px.
    pub fn at(&self, displacement: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|c| {
            let fraction = displacement[c] - displacement[c].floor();
            let t = 2.0 * FRACTIONS as f64 * fraction.min(1.0 - fraction);
            let k = (t as usize).min(FRACTIONS - 1);
            let bias = &self.0[c];
            if t.is_finite() { bias[k] + (t - k as f64) * (bias[k + 1] - bias[k]) } else { 0.0 }
        })
    }
}

/// Power of the waves along an axis, up to the highest, without that of the noise; none where no zone is as wide.
fn power_spectrum(image: &Image, mesh: &Mesh<Px>, axis: usize, length: usize, noise: f64) -> Option<Vec<f64>> {
    let window: Vec<f64> = (0..length).map(|k| (PI * (k as f64 + 0.5) / length as f64).sin().powi(2)).collect();
    let (sum, squares) = (window.iter().sum::<f64>(), window.iter().map(|w| w * w).sum::<f64>());
    let size = [image.width(), image.height()];
    let [forward, _] = single(length);
    let mut power = vec![0.0; length / 2 + 1];
    let mut n = 0.0;
    for zone in 0..mesh.zones().len() {
        let bounds = mesh.bounds(zone);
        let from = [bounds.x0, bounds.y0].map(|v| v.max(0.0) as usize);
        let to = [0, 1].map(|c| ([bounds.x1, bounds.y1][c] as usize).min(size[c]));
        let across = 1 - axis;
        let step = (to[across].saturating_sub(from[across])).div_ceil(ROWS).max(1);
        for row in (from[across]..to[across]).step_by(step) {
            let starts = from[axis]..(to[axis] + 1).saturating_sub(length);
            let apart = starts.len().div_ceil(PIECES).max(length / 2);
            for first in starts.step_by(apart) {
                let grey = |k: usize| match axis {
                    0 => f64::from(image.grey(first + k, row)),
                    _ => f64::from(image.grey(row, first + k)),
                };
                let mean = (0..length).map(|k| window[k] * grey(k)).sum::<f64>() / sum;
                let mut piece: Vec<Complex32> =
                    (0..length).map(|k| ((window[k] * (grey(k) - mean)) as f32).into()).collect();
                forward.process(&mut piece);
                power.iter_mut().zip(&piece).for_each(|(power, wave)| *power += f64::from(wave.norm_sqr()));
                n += 1.0;
            }
        }
    }
    (n > 0.0).then(|| power.into_iter().map(|power| (power / n - noise * noise * squares).max(0.0)).collect())
}
