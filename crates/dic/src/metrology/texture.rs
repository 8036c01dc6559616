//! What the reference image is like.

use super::grey_levels;
use super::region::Region;
use crate::imaging::{Image, Interpolation, Levels};
use serde::Serialize;

/// Texture of the zone.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TextureFigures {
    /// Root mean square gradient along x and y of the cubic spline, less what noise adds, grey levels per px.
    pub gradient_grey_per_px: [f64; 2],
    /// The same with the noise in it: what the correlation sees.
    pub gradient_with_noise_grey_per_px: [f64; 2],
    /// Speckle size along x and y: full width at half maximum of the autocorrelation, px; the median over
    /// squares of 64 px. `None` where it does not fall to a half within 16 px: coarser than 32 px.
    pub speckle_px: [Option<f64>; 2],
    /// Standard deviation of the grey levels.
    pub contrast_grey: f64,
    /// Grey levels that 1 % and 99 % of the pixels do not exceed.
    pub percentiles_grey: [f64; 2],
    /// Smallest and largest grey level.
    pub range_grey: [f64; 2],
    /// Distance of the percentiles in per cent of 8 or 16 bits; `None` for floats, and 16 bits that hold fewer.
    pub range_used_percent: Option<f64>,
    /// Pixels that are saturated, in per cent: at the dark and at the bright end.
    pub saturated_percent: [f64; 2],
}

/// Largest lag of the autocorrelation, px.
const LAGS: usize = 16;
/// Side of the squares whose speckles are measured apart, px: light that varies over the specimen is not
/// texture, and the edge of the specimen only spoils the squares that it crosses.
const SQUARE: usize = 64;
/// A square of which noise makes more than this share of the variance says nothing about speckles.
const NOISE_SHARE: f64 = 0.25;
/// Weights of the spline's slope beyond this distance are below 1e-7.
const TAPS: usize = 12;

impl TextureFigures {
    pub(super) fn new(image: &Image, region: &Region, noise: f64) -> Self {
        let sorted = grey_levels(image, region);
        let with_noise = gradient_squares(image, region);
        let of_noise = noise * noise * Interpolation::Cubic.gradient_noise_gain();
        let percentiles_grey = Self::percentiles(&sorted);
        let full = match image.pixels() {
            Levels::U8(_) => Some(255.0),
            // Camera data of 10 to 14 bits are often stored in 16.
            Levels::U16(_) if sorted.last().is_some_and(|&v| v > 32767.0) => Some(65535.0),
            Levels::U16(_) | Levels::F32(_) => None,
        };
        let mean = sorted.iter().map(|&v| f64::from(v)).sum::<f64>() / sorted.len() as f64;
        let squares = sorted.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>();
        Self {
            gradient_grey_per_px: with_noise.map(|square| without(of_noise, square).sqrt()),
            gradient_with_noise_grey_per_px: with_noise.map(f64::sqrt),
            speckle_px: speckles(image, region, noise),
            contrast_grey: (squares / sorted.len() as f64).sqrt(),
            percentiles_grey,
            range_grey: [sorted[0], sorted[sorted.len() - 1]].map(f64::from),
            range_used_percent: full.map(|full| 100.0 * (percentiles_grey[1] - percentiles_grey[0]) / full),
            saturated_percent: [saturated(sorted.iter().copied()), saturated(sorted.iter().rev().copied())],
        }
    }

    /// The smaller of both gradients: the direction that is measured worse.
    pub fn weaker_gradient(&self) -> f64 {
        self.gradient_grey_per_px[0].min(self.gradient_grey_per_px[1])
    }

    /// The larger speckle size of both directions; `None` where one is not found.
    pub fn larger_speckle_px(&self) -> Option<f64> {
        Some(self.speckle_px[0]?.max(self.speckle_px[1]?))
    }

    /// The 1 % and 99 % percentiles of sorted grey levels.
    pub(super) fn percentiles(sorted: &[f32]) -> [f64; 2] {
        [0.01, 0.99].map(|share| f64::from(sorted[((sorted.len() - 1) as f64 * share).round() as usize]))
    }
}

/// What is left of a mean square when the share of noise is taken off; nothing where noise alone could have
/// made it. (The texture check refuses nodes with less than 1.5 times the share of noise.)
fn without(of_noise: f64, square: f64) -> f64 {
    if square <= 1.2 * of_noise { 0.0 } else { square - of_noise }
}

/// Mean squares of the spline's slopes along x and y over the zone.
///
/// The slope of the cubic spline is a sum over both sides of a pixel whose weights fall by its pole:
/// `s'(0) = sum_k w_k (f_k - f_-k)`, since its symbol is `3 i sin t / (2 + cos t)`.
fn gradient_squares(image: &Image, region: &Region) -> [f64; 2] {
    let [x0, y0, x1, y1] = region.zone;
    let pole = Interpolation::Cubic.poles()[0];
    let series = |k: usize| pole.powi(k as i32) / 3f64.sqrt();
    let weights: [f64; TAPS] = std::array::from_fn(|k| 1.5 * (series(k) - series(k + 2)));
    let (mut sums, mut n) = ([0.0; 2], 0usize);
    for y in y0..y1 {
        for x in x0..x1 {
            let mut slope = [0.0; 2];
            for (k, weight) in weights.iter().enumerate().map(|(k, w)| (k + 1, w)) {
                slope[0] += weight * f64::from(image.grey(x + k, y) - image.grey(x - k, y));
                slope[1] += weight * f64::from(image.grey(x, y + k) - image.grey(x, y - k));
            }
            (0..2).for_each(|c| sums[c] += slope[c] * slope[c]);
            n += 1;
        }
    }
    sums.map(|sum| sum / n as f64)
}

/// Widths of the autocorrelation along x and y: medians over the squares that have texture.
fn speckles(image: &Image, region: &Region, noise: f64) -> [Option<f64>; 2] {
    let [x0, y0, x1, y1] = region.zone;
    let cuts = |low: usize, high: usize| -> Vec<usize> {
        let n = ((high - low) / SQUARE).max(1);
        (0..=n).map(|k| low + k * (high - low) / n).collect()
    };
    let (columns, rows) = (cuts(x0, x1), cuts(y0, y1));
    let mut widths = [Vec::new(), Vec::new()];
    for ys in rows.windows(2) {
        for xs in columns.windows(2) {
            let (width, height) = (xs[1] - xs[0], ys[1] - ys[0]);
            let mut square: Vec<f64> = Vec::with_capacity(width * height);
            for y in ys[0]..ys[1] {
                square.extend((xs[0]..xs[1]).map(|x| f64::from(image.grey(x, y))));
            }
            let mean = square.iter().sum::<f64>() / square.len() as f64;
            square.iter_mut().for_each(|v| *v -= mean);
            let variance = square.iter().map(|v| v * v).sum::<f64>() / square.len() as f64;
            // White noise is in the variance, and in no other lag.
            let peak = variance - noise * noise;
            if peak <= (1.0 - NOISE_SHARE) * variance || peak <= 0.0 {
                continue;
            }
            for (c, widths) in widths.iter_mut().enumerate() {
                // Infinite: wider than can be seen, which the median must know.
                widths.push(full_width(peak, &covariance(&square, width, c)).unwrap_or(f64::INFINITY));
            }
        }
    }
    widths.map(|mut widths| {
        widths.sort_by(f64::total_cmp);
        widths.get(widths.len() / 2).copied().filter(|width| width.is_finite())
    })
}

/// Covariance of the values of a square, `width` to a row, at lags from 1 on along x (0) or y (1).
fn covariance(square: &[f64], width: usize, axis: usize) -> Vec<f64> {
    let height = square.len() / width;
    let mean_product = |lag: usize| {
        let (rows, columns, step) =
            if axis == 0 { (height, width - lag, lag) } else { (height - lag, width, lag * width) };
        let row = |row: usize| {
            let at = row * width;
            let (near, far) = (&square[at..at + columns], &square[at + step..at + step + columns]);
            near.iter().zip(far).map(|(a, b)| a * b).sum::<f64>()
        };
        (0..rows).map(row).sum::<f64>() / (rows * columns) as f64
    };
    (1..=LAGS.min([width, height][axis] / 2)).map(mean_product).collect()
}

/// Twice the lag at which the covariance has fallen to half of its `peak` at lag 0, which holds no noise.
fn full_width(peak: f64, covariance: &[f64]) -> Option<f64> {
    let at = covariance.iter().position(|&c| c < 0.5 * peak)?;
    let before = if at == 0 { peak } else { covariance[at - 1] };
    Some(2.0 * (at as f64 + (before - 0.5 * peak) / (before - covariance[at])))
}

/// Per cent of the pixels at the first grey level of a sorted list, if that is an end of an integer scale (0, 255,
/// 1023, 4095, 16383, 65535), or holds so many more pixels than those next to it that something cut them off.
fn saturated(mut levels: impl Iterator<Item = f32>) -> f64 {
    const ENDS: [f32; 6] = [0.0, 255.0, 1023.0, 4095.0, 16383.0, 65535.0];
    /// Occupied levels that are compared.
    const NEXT: usize = 4;
    let Some(end) = levels.next() else { return 0.0 };
    let (mut at_end, mut n) = (1usize, 1usize);
    let (mut last, mut next_levels, mut next_pixels) = (end, 0usize, 0usize);
    for level in levels {
        n += 1;
        if level == end {
            at_end += 1;
        } else {
            if level != last {
                next_levels += 1;
                last = level;
            }
            next_pixels += usize::from(next_levels <= NEXT);
        }
    }
    let usual = next_pixels as f64 / next_levels.clamp(1, NEXT) as f64;
    let cut_off = at_end as f64 > 4.0 * usual && at_end as f64 > 1e-4 * n as f64;
    if cut_off || ENDS.contains(&end) { 100.0 * at_end as f64 / n as f64 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saturated_pixels_are_counted_at_the_ends_of_scales_and_where_levels_pile_up() {
        let ramp = || (0..1000).map(|k| 10.0 + (k / 10) as f32);
        assert_eq!(saturated(ramp()), 0.0);
        assert_eq!(saturated([0.0; 10].into_iter().chain(ramp())), 100.0 * 10.0 / 1010.0);
        assert_eq!(saturated([5.0; 100].into_iter().chain(ramp())), 100.0 * 100.0 / 1100.0);
        assert_eq!(saturated([5.0; 10].into_iter().chain(ramp())), 0.0);
    }

    #[test]
    fn the_width_of_a_triangle_is_found_between_lags() {
        // 1 - lag / 5 is a half at 2.5.
        let covariance: Vec<f64> = (1..=5).map(|lag| 1.0 - f64::from(lag) / 5.0).collect();
        assert_eq!(full_width(1.0, &covariance), Some(5.0));
        assert_eq!(full_width(1.0, &[0.9, 0.8]), None);
        assert_eq!(full_width(1.0, &[0.2]), Some(2.0 * (0.5 / 0.8)));
    }
}
