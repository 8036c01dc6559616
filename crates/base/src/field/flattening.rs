//! What a window of nodes flattens: the slope of its plane less that of a cubic (THEORY 20).

use super::window::StrainWindow;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Powers of x and y in a cubic, lower degrees first, and the gradient of the Laplacian of each.
const TERMS: [([i32; 2], [f64; 2]); 10] = [
    ([0, 0], [0.0, 0.0]),
    ([1, 0], [0.0, 0.0]),
    ([0, 1], [0.0, 0.0]),
    ([2, 0], [0.0, 0.0]),
    ([1, 1], [0.0, 0.0]),
    ([0, 2], [0.0, 0.0]),
    ([3, 0], [6.0, 0.0]),
    ([2, 1], [0.0, 2.0]),
    ([1, 2], [2.0, 0.0]),
    ([0, 3], [0.0, 6.0]),
];
/// A term counts when this part of its square is left beside the terms before it: three points along an axis determine
/// x^2, five x^3.
const LEAST_LEFT: f64 = 0.09;
/// Share of windows that flatten from which on it is said, per cent.
const SAID_PERCENT: f64 = 5.0;
/// A window flattens where its model error is above so many standard uncertainties,
const BEYOND: f64 = 3.0;
/// and its square above so many standard deviations of what noise makes of it. Neighbours share noise: it is more than
/// these are of independent ones.
const SURE: f64 = 10.0;

/// The windows of a frame whose strain is flattened by far more than noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Flattened {
    /// How many.
    pub windows: usize,
    /// Of how many, per cent.
    pub percent: f64,
    /// Node of the one with the largest model error, in the unit of the mesh (of the reference image).
    #[serde(rename = "at_px")]
    pub at: [f64; 2],
    /// Model error of its strain, the largest of exx, eyy and exy.
    pub model_error: f64,
    /// Standard uncertainty of the same component.
    pub sigma: f64,
    /// The largest window with which few would be left, as far as can be told; none where no smaller one does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub would_do: Option<StrainWindow>,
}

impl Flattened {
    /// Whether it is to be said: of more than 5 % of the windows.
    pub fn is_much(&self) -> bool {
        self.percent > SAID_PERCENT
    }

    /// Of `found`, for each window with a strain its node and its three components.
    pub(super) fn of(window: StrainWindow, found: &[([f64; 2], [Slope; 3])]) -> Option<Self> {
        let worst = |slopes: &[Slope; 3]| {
            let flat = slopes.iter().filter(|slope| slope.is_flattened());
            flat.copied().max_by(|a, b| a.model_error().total_cmp(&b.model_error()))
        };
        let flat: Vec<([f64; 2], Slope)> =
            found.iter().filter_map(|(at, slopes)| Some((*at, worst(slopes)?))).collect();
        let (at, slope) = flat.iter().max_by(|(_, a), (_, b)| a.model_error().total_cmp(&b.model_error()))?;
        Some(Self {
            windows: flat.len(),
            percent: 100.0 * flat.len() as f64 / found.len() as f64,
            at: *at,
            model_error: slope.model_error(),
            sigma: slope.sigma,
            would_do: window.smaller().find(|&smaller| {
                // What a plane flattens rises with N^2 - 1, its noise falls about as N^-2.
                let [old, new] = [window, smaller].map(|window| (window.nodes() as f64).powi(2));
                let gain = (new - 1.0) / (old - 1.0) * new / old;
                let left = flat.iter().filter(|(_, slope)| slope.model_error() * gain > BEYOND * slope.sigma);
                100.0 * left.count() as f64 <= SAID_PERCENT * found.len() as f64
            }),
        })
    }
}

impl fmt::Display for Flattened {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { percent, at: [x, y], model_error, sigma, would_do, .. } = self;
        let advice = match would_do {
            Some(window) => format!("a window of {window} would do"),
            None => "no smaller window would do: take smaller elements".to_owned(),
        };
        write!(
            f,
            "{percent:.0} % of the windows flatten the strain by more than {BEYOND} standard uncertainties, most at \
             ({x:.0}, {y:.0}) px, by about {model_error:.1e} with a standard uncertainty of {sigma:.1e}; {advice}"
        )
    }
}

/// A component of the strain over a window, and what it and others are off.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slope {
    /// Standard uncertainty.
    pub sigma: f64,
    /// Square of the strain of the plane less that of the cubic, summed over windows.
    pub off: f64,
    /// What noise makes of it.
    pub noise: f64,
    /// How many windows.
    pub n: f64,
}

impl Slope {
    /// The same over another window more.
    pub fn and(self, other: Self) -> Self {
        Self { off: self.off + other.off, noise: self.noise + other.noise, n: self.n + other.n, ..self }
    }

    /// What the strain is off beyond noise.
    pub fn model_error(self) -> f64 {
        ((self.off - self.noise) / self.n).max(0.0).sqrt()
    }

    fn is_flattened(self) -> bool {
        self.model_error() > BEYOND * self.sigma && self.off - self.noise > SURE * (2.0 / self.n).sqrt() * self.noise
    }
}

/// Weights of points in the slopes, along x and y at the first of them, of the largest polynomial up to a cubic that
/// they determine. The points are the first `ends[0]`, or the first of the next of `ends` that determine more terms.
///
/// What is fitted are coefficients, which overshoot a polynomial q by `-overshoot` times its Laplacian (THEORY 17).
pub(super) fn cubic(points: &[[f64; 2]], ends: &[usize], overshoot: f64) -> Vec<[f64; 2]> {
    let mut best = (0, Vec::new());
    for points in ends.iter().filter_map(|&end| points.get(..end)) {
        let found = polynomial(points, overshoot);
        if found.0 > best.0 {
            best = found;
        }
        if best.0 == TERMS.len() {
            break;
        }
    }
    best.1
}

/// The same of all points, and the number of terms that they determine.
///
/// Terms are made orthonormal over the points one after the other, and their slopes with them.
fn polynomial(points: &[[f64; 2]], overshoot: f64) -> (usize, Vec<[f64; 2]>) {
    let n = points.len() as f64;
    let middle = [0, 1].map(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
    let off = || points.iter().map(|p| [p[0] - middle[0], p[1] - middle[1]]);
    let scale = (off().map(|[x, y]| x * x + y * y).sum::<f64>() / n).sqrt();
    let local: Vec<[f64; 2]> = off().map(|p| p.map(|v| v / scale)).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    // The derivative of a power.
    let rise = |v: f64, i: i32| if i == 0 { 0.0 } else { f64::from(i) * v.powi(i - 1) };
    let mut kept: Vec<(Vec<f64>, [f64; 2])> = Vec::new();
    for ([i, j], bend) in TERMS {
        let mut values: Vec<f64> = local.iter().map(|[x, y]| x.powi(i) * y.powi(j)).collect();
        let [bend_x, bend_y] = bend.map(|bend| overshoot * bend / (scale * scale));
        let mut slopes = local
            .first()
            .map_or([0.0; 2], |&[x, y]| [rise(x, i) * y.powi(j) + bend_x, x.powi(i) * rise(y, j) + bend_y]);
        let size = dot(&values, &values);
        // Twice: what the first time leaves of the others by round-off, the second takes off.
        for (other, of_other) in kept.iter().chain(&kept) {
            let part = dot(&values, other);
            values.iter_mut().zip(other).for_each(|(value, other)| *value -= part * other);
            slopes.iter_mut().zip(of_other).for_each(|(slope, other)| *slope -= part * other);
        }
        let left = dot(&values, &values);
        if left > LEAST_LEFT * size {
            let norm = left.sqrt();
            values.iter_mut().chain(&mut slopes).for_each(|value| *value /= norm);
            kept.push((values, slopes));
        }
    }
    let mut weights = vec![[0.0; 2]; points.len()];
    for (values, slopes) in &kept {
        for (weight, value) in weights.iter_mut().zip(values) {
            weight.iter_mut().zip(slopes).for_each(|(weight, slope)| *weight += value * slope / scale);
        }
    }
    (kept.len(), weights)
}
