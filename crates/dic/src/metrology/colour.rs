//! How the noise goes with the grey level and from pixel to pixel, from the residuals of images at rest.

use crate::imaging::{GreyDepth, Image, Interpolation};
use serde::Serialize;

/// Lags of the autocorrelation, px.
pub(super) const LAGS: usize = 4;
/// Bins of the grey level from which the variance is fitted.
const BINS: usize = 32;
/// Pixels without which a bin says nothing.
const LEAST_PIXELS: usize = 100;

/// Variance of the noise of one image, `a + b grey`, `grey` in its scale, from the residuals of static images.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PhotonFit {
    /// Variance of black, grey levels squared.
    pub a_grey2: f64,
    /// Its rise per grey level, grey levels.
    pub b_grey: f64,
    /// Standard uncertainty of `a_grey2`.
    pub a_sigma_grey2: f64,
    /// Standard uncertainty of `b_grey`.
    pub b_sigma_grey: f64,
}

impl PhotonFit {
    /// Whether the noise rises with the grey level beyond doubt.
    pub fn is_certain(&self) -> bool {
        self.b_grey > 4.0 * self.b_sigma_grey
    }
}

/// Correlation of the noise from pixel to pixel, from the residuals of static images.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NoiseCorrelation {
    /// Normalised autocorrelation of the residual at 0 to 4 px along x, less that of interpolated white noise.
    pub along_x: [f64; LAGS + 1],
    /// The same along y.
    pub along_y: [f64; LAGS + 1],
    /// By how much the standard uncertainty of displacements, x and y, exceeds that for white noise of the same size.
    pub factor: Option<[f64; 2]>,
    /// Standard deviation of the factors.
    pub factor_sigma: Option<f64>,
}

/// Squared residuals by grey level.
pub(super) struct ByGrey {
    low: f64,
    width: f64,
    /// Highest grey level of the depth, where pixels are saturated; none for floats.
    white: Option<f64>,
    sum: [f64; BINS],
    grey: [f64; BINS],
    n: [usize; BINS],
}

impl ByGrey {
    pub fn new(image: &Image, [low, high]: [f64; 2]) -> Self {
        let width = ((high - low) / BINS as f64).max(f64::MIN_POSITIVE);
        let white = GreyDepth::of(image).map(|depth| f64::from(depth.highest()));
        Self { low, width, white, sum: [0.0; BINS], grey: [0.0; BINS], n: [0; BINS] }
    }

    /// Adds a pixel: its grey level, and the square of its residual as that of one image.
    pub fn add(&mut self, grey: f64, square: f64) {
        let saturated = self.white.is_some_and(|white| grey < 0.5 || grey > white - 0.5);
        let bin = (grey - self.low) / self.width;
        if saturated || !(0.0..BINS as f64).contains(&bin) {
            return;
        }
        let bin = bin as usize;
        self.sum[bin] += square;
        self.grey[bin] += grey;
        self.n[bin] += 1;
    }

    /// Weighted least squares over the bins: a mean square of n values has the relative variance 2/n.
    pub fn fit(&self) -> Option<PhotonFit> {
        let bins = (0..BINS).filter(|&k| self.n[k] >= LEAST_PIXELS && self.sum[k] > 0.0);
        let rows: Vec<[f64; 3]> = bins
            .map(|k| {
                let n = self.n[k] as f64;
                let square = self.sum[k] / n;
                [self.grey[k] / n, square, n / (2.0 * square * square)]
            })
            .collect();
        if rows.len() < 4 {
            return None;
        }
        let sum = |of: &dyn Fn(&[f64; 3]) -> f64| rows.iter().map(|row| row[2] * of(row)).sum::<f64>();
        let total = sum(&|_| 1.0);
        let (grey, square) = (sum(&|row| row[0]) / total, sum(&|row| row[1]) / total);
        let spread = sum(&|row| (row[0] - grey).powi(2));
        let slope = sum(&|row| (row[0] - grey) * (row[1] - square)) / spread;
        let left = sum(&|row| (row[1] - square - slope * (row[0] - grey)).powi(2));
        // A curve that is no line leaves more than the bins' own scatter: then the uncertainties grow with it.
        let excess = (left / (rows.len() - 2) as f64).max(1.0);
        let fit = PhotonFit {
            a_grey2: square - slope * grey,
            b_grey: slope,
            a_sigma_grey2: (excess * (1.0 / total + grey * grey / spread)).sqrt(),
            b_sigma_grey: (excess / spread).sqrt(),
        };
        [fit.a_grey2, fit.b_grey, fit.a_sigma_grey2, fit.b_sigma_grey].iter().all(|v| v.is_finite()).then_some(fit)
    }
}

/// Products of residuals some pixels apart.
#[derive(Debug, Clone, Default)]
pub(super) struct Products {
    found: [[f64; LAGS + 1]; 2],
    n: [[f64; LAGS + 1]; 2],
    white: [[f64; LAGS + 1]; 2],
    weight: f64,
}

impl Products {
    /// Adds the residuals of a rectangle, row by row, whose deformed image is displaced by `u` and has this `gain`.
    pub fn add(
        &mut self,
        residual: &[Option<f64>],
        width: usize,
        u: [f64; 2],
        gain: f64,
        interpolation: Interpolation,
    ) {
        for (k, one) in residual.iter().enumerate() {
            let Some(one) = one else { continue };
            for lag in 0..=LAGS {
                let right = (k % width + lag < width).then(|| k + lag);
                for (axis, other) in [right, Some(k + lag * width)].into_iter().enumerate() {
                    let Some(Some(other)) = other.and_then(|at| residual.get(at)) else { continue };
                    self.found[axis][lag] += one * other;
                    self.n[axis][lag] += 1.0;
                }
            }
        }
        // Where the weights of the interpolation overlap, white noise of g is correlated as well.
        let through = u.map(|u| {
            let t = u - u.floor();
            let overlap = |lag: usize| {
                let weight = |k: i32| interpolation.cardinal(t + f64::from(k));
                (-16..=16).map(|k| weight(k) * weight(k + lag as i32)).sum::<f64>()
            };
            std::array::from_fn::<f64, { LAGS + 1 }, _>(overlap)
        });
        let pixels = residual.len() as f64;
        let rest = 1.0 + gain * gain * through[0][0] * through[1][0];
        for lag in 0..=LAGS {
            let of_reference = f64::from(u8::from(lag == 0));
            for axis in 0..2 {
                let both = gain * gain * through[axis][lag] * through[1 - axis][0];
                self.white[axis][lag] += pixels * (of_reference + both) / rest;
            }
        }
        self.weight += pixels;
    }

    /// Autocorrelation along x and y, less that of white noise but for lag 0.
    pub fn finish(&self) -> [[f64; LAGS + 1]; 2] {
        [0, 1].map(|axis| {
            std::array::from_fn(|lag| {
                let mean = |lag: usize| self.found[axis][lag] / self.n[axis][lag].max(1.0);
                if lag == 0 || mean(0) <= 0.0 {
                    return f64::from(u8::from(lag == 0));
                }
                mean(lag) / mean(0) - self.white[axis][lag] / self.weight.max(1.0)
            })
        })
    }
}
