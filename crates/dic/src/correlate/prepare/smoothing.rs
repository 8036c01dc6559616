//! The gradient of a noisy reference (THEORY 10). What noise adds to the gradient makes every displacement less certain.
//! The gradient of the reference smoothed by a Gaussian holds far less of it, and less of the texture as well: the width
//! is taken that leaves the smallest variance. The residual stays that of the images as they are, so that nothing
//! that is measured is smoothed.

use crate::backend::KernelOptions;
use crate::correlate::AssumedNoise;
use crate::imaging::{Image, Interpolation, Pixels};
use crate::mesh::PixelMap;
use rayon::prelude::*;
use std::sync::Arc;

/// Standard deviations of the Gaussians that are tried, px.
const WIDTHS_PX: [f64; 6] = [0.7, 1.0, 1.4, 2.0, 2.8, 4.0];
/// Share of noise in the mean square gradient below which none is tried: it costs 7 % of a standard uncertainty. Sharp
/// dots without noise look like a tenth (scripts/verdicts.py).
const LEAST_NOISE: f64 = 0.15;
/// The variance that is left, in that without smoothing, is at most this: what gains less changes nothing.
const WORTH: f64 = 0.9;
/// Of widths that leave up to so many times the least variance the largest is taken: it holds the least noise.
const AS_GOOD: f64 = 1.03;
/// Pixels that tell how much of the texture is left, at most.
const SAMPLES: usize = 1 << 16;
/// A part of the image tells as much as all of it where so many of these are in it.
const LEAST_SAMPLES: usize = 256;
/// Side of the part of the image on which the widths are tried, px.
const SIDE: usize = 768;

/// What the gradient of a reference is made of in place of its own grey levels.
pub(crate) struct Smoothed {
    pub image: Arc<Image>,
    /// Standard deviation of the Gaussian, px.
    pub width_px: f64,
    /// What white noise of variance one adds to the mean square of each component of the gradient.
    pub gradient_noise_gain: f64,
    /// And to the mean product of the gradient and that of the image as it is.
    pub gradient_pattern_gain: f64,
}

impl Smoothed {
    /// `kernel` for the gradient of this in place of the reference's own.
    pub fn kernel(&self, kernel: KernelOptions) -> KernelOptions {
        let &Self { gradient_noise_gain, gradient_pattern_gain, .. } = self;
        KernelOptions { gradient_noise_gain, gradient_pattern_gain, ..kernel }
    }
}

/// What a Gaussian makes of the gradient. The variance of a displacement by its gradient `g`, that of the texture being
/// `t`, goes with `E[g^2] / E[g t]^2`.
struct Trial {
    width_px: f64,
    variance: f64,
    /// Factor on the gradient with which `E[g^2] = E[g t]` but for the noise in it, so that the normal matrix is that of
    /// the steps.
    factor: f64,
    noise_gain: f64,
    pattern_gain: f64,
}

/// Smooths a reference where that makes displacements clearly more certain.
pub(crate) fn smooth_reference(
    image: &Image,
    pixels: &PixelMap,
    noise: &AssumedNoise,
    interpolation: Interpolation,
) -> Option<Smoothed> {
    let size = [image.width(), image.height()];
    let slope = Weights::slope(interpolation);
    let all = [0, 0, size[0], size[1]];
    let at = sample(pixels, all);
    let own = slope.gradients(&at, size, |x, y| image.grey(x, y));
    let square = noise.of_reference * noise.of_reference;
    let (power, from_noise) = (mean_product(&own, &own), square * interpolation.gradient_noise_gain());
    if at.is_empty() || from_noise < LEAST_NOISE * power {
        return None;
    }
    // Part of a large image tells as much.
    let window = window_of(&at, size);
    let part = Inside::of(image, pixels, window);
    let [x0, y0, ..] = window;
    let at: Vec<[usize; 2]> = sample(pixels, window).into_iter().map(|[x, y]| [x - x0, y - y0]).collect();
    let own = slope.gradients(&at, part.size, |x, y| image.grey(x + x0, y + y0));
    let trial = |width_px: f64| {
        let gaussian = Weights::gaussian(width_px);
        let grey = part.smooth(width_px);
        let smoothed = slope.gradients(&at, part.size, |x, y| grey[y * part.size[0] + x]);
        let both = slope.after(&gaussian);
        let pattern_gain = gaussian.at(0) * slope.dot(&both);
        let texture = mean_product(&smoothed, &own) - square * pattern_gain;
        let power = mean_product(&smoothed, &smoothed);
        let noise_gain = gaussian.dot(&gaussian) * both.dot(&both);
        let factor = texture / (power - square * noise_gain);
        let variance = power / (texture * texture);
        let (noise_gain, pattern_gain) = (factor * factor * noise_gain, factor * pattern_gain);
        (texture > 0.0 && factor > 0.0).then_some(Trial { width_px, variance, factor, noise_gain, pattern_gain })
    };
    let trials: Vec<Trial> = WIDTHS_PX.into_iter().filter_map(trial).collect();
    let least = trials.iter().map(|trial| trial.variance).fold(f64::INFINITY, f64::min);
    let best = trials.into_iter().rfind(|trial| trial.variance <= AS_GOOD * least)?;
    let power = mean_product(&own, &own);
    if best.variance >= WORTH * power / (power - from_noise).max(0.0).powi(2) {
        return None;
    }
    let whole = Inside::of(image, pixels, all);
    let grey = whole.smooth(best.width_px).iter().map(|grey| whole.mean + best.factor as f32 * grey).collect();
    let image = Image::new(size[0], size[1], Pixels::F32(grey)).ok()?;
    Some(Smoothed {
        image: Arc::new(image),
        width_px: best.width_px,
        gradient_noise_gain: best.noise_gain,
        gradient_pattern_gain: best.pattern_gain,
    })
}

fn mean_product(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum::<f64>() / (2.0 * a.len() as f64)
}

/// A square of [`SIDE`] px about the middle of the places `at`, `[x0, y0, x1, y1]`; all of the image where few of them
/// are in it.
fn window_of(at: &[[usize; 2]], size: [usize; 2]) -> [usize; 4] {
    let middle = [0, 1].map(|c| at.iter().map(|at| at[c]).sum::<usize>() / at.len().max(1));
    let low = [0, 1].map(|c| middle[c].saturating_sub(SIDE / 2));
    let high = [0, 1].map(|c| (middle[c] + SIDE / 2).min(size[c]));
    let window = [low[0], low[1], high[0], high[1]];
    let n = at.iter().filter(|at| is_within(**at, window)).count();
    if n >= LEAST_SAMPLES { window } else { [0, 0, size[0], size[1]] }
}

fn is_within([x, y]: [usize; 2], [x0, y0, x1, y1]: [usize; 4]) -> bool {
    (x0..x1).contains(&x) && (y0..y1).contains(&y)
}

/// Pixels of the elements in a window, evenly chosen.
fn sample(pixels: &PixelMap, window: [usize; 4]) -> Vec<[usize; 2]> {
    let [x0, y0, x1, y1] = window;
    let counted: usize = pixels.elements().iter().map(|of| usize::from(of.nx) * usize::from(of.ny)).sum();
    let counted = counted.min((x1 - x0) * (y1 - y0));
    // No divisor of the width of elements is likely to be one of it.
    let step = counted.div_ceil(SAMPLES) | 1;
    let (mut n, mut at) = (0, Vec::with_capacity(counted / step + 1));
    for element in pixels.elements() {
        pixels.for_each(element, |x, y, _, _| {
            let place = [x as usize, y as usize];
            if is_within(place, window) {
                if n % step == 0 {
                    at.push(place);
                }
                n += 1;
            }
        });
    }
    at
}

/// The pixels of the elements in a window of the image; beyond them another thing may begin.
struct Inside {
    mean: f32,
    size: [usize; 2],
    /// What each pixel is beside the mean, and 1; 0 beyond the elements.
    beside: Vec<f32>,
    is_in: Vec<f32>,
}

impl Inside {
    fn of(image: &Image, pixels: &PixelMap, window: [usize; 4]) -> Self {
        let [x0, y0, x1, y1] = window;
        let size = [x1 - x0, y1 - y0];
        let [beside, is_in] = [0, 1].map(|_| vec![0.0; size[0] * size[1]]);
        let mut inside = Self { mean: 0.0, size, beside, is_in };
        let (mut n, mut sum) = (0.0, 0.0);
        for element in pixels.elements() {
            pixels.for_each(element, |x, y, _, _| {
                let at = [x as usize, y as usize];
                if is_within(at, window) {
                    let k = (at[1] - y0) * size[0] + at[0] - x0;
                    (inside.beside[k], inside.is_in[k]) = (image.grey(at[0], at[1]), 1.0);
                    (n, sum) = (n + 1.0, sum + f64::from(inside.beside[k]));
                }
            });
        }
        inside.mean = (sum / n) as f32;
        inside.beside.iter_mut().zip(&inside.is_in).for_each(|(grey, is_in)| *grey -= is_in * inside.mean);
        inside
    }

    /// Smoothed by a Gaussian of `width_px`, with what is near beyond the elements in the place of what is there: no
    /// edge. A mean twice as wide, so that hardly anything of the noise of one pixel comes back to it.
    fn smooth(&self, width_px: f64) -> Vec<f32> {
        let wide = Weights::gaussian(2.0 * width_px);
        let [sums, shares] = [&self.beside, &self.is_in].map(|of| wide.smooth(of, self.size));
        let pixels = self.beside.iter().zip(&self.is_in).zip(sums.iter().zip(&shares));
        let continued: Vec<f32> = pixels
            .map(|((own, is_in), (sum, share))| if *is_in > 0.0 || *share < 1e-3 { *own } else { sum / share })
            .collect();
        Weights::gaussian(width_px).smooth(&continued, self.size)
    }
}

/// Weights of the pixels around one along an axis, from the first to the last.
struct Weights(Vec<f64>);

impl Weights {
    /// Those of the gradient of the spline.
    fn slope(interpolation: Interpolation) -> Self {
        /// Beyond, they are below 1e-6.
        const REACH: i32 = 10;
        Self((-REACH..=REACH).map(|k| interpolation.gradient_weight(k)).collect())
    }

    fn gaussian(width_px: f64) -> Self {
        let reach = (4.0 * width_px).ceil();
        let weights: Vec<f64> =
            (0..=2 * reach as usize).map(|k| (-0.5 * ((k as f64 - reach) / width_px).powi(2)).exp()).collect();
        let sum: f64 = weights.iter().sum();
        Self(weights.into_iter().map(|weight| weight / sum).collect())
    }

    fn reach(&self) -> usize {
        self.0.len() / 2
    }

    /// The weight of the pixel `k` px away.
    fn at(&self, k: isize) -> f64 {
        usize::try_from(k + self.reach() as isize).ok().and_then(|at| self.0.get(at)).copied().unwrap_or(0.0)
    }

    /// These weights of what `first` makes of the pixels.
    fn after(&self, first: &Self) -> Self {
        let reach = (self.reach() + first.reach()) as isize;
        let of = |k: isize| self.offsets().map(|j| self.at(j) * first.at(k - j)).sum();
        Self((-reach..=reach).map(of).collect())
    }

    fn offsets(&self) -> std::ops::RangeInclusive<isize> {
        let reach = self.reach() as isize;
        -reach..=reach
    }

    fn dot(&self, other: &Self) -> f64 {
        self.offsets().map(|k| self.at(k) * other.at(k)).sum()
    }

    /// [`Weights::gradient`] at the places `at`.
    fn gradients(
        &self,
        at: &[[usize; 2]],
        size: [usize; 2],
        grey: impl Fn(usize, usize) -> f32 + Sync,
    ) -> Vec<[f64; 2]> {
        at.par_iter().map(|&at| self.gradient(&grey, size, at)).collect()
    }

    /// The sums along both axes at a pixel; beyond the image its last pixels go on.
    fn gradient(
        &self,
        grey: impl Fn(usize, usize) -> f32,
        [width, height]: [usize; 2],
        [x, y]: [usize; 2],
    ) -> [f64; 2] {
        let beside = |at: usize, k: isize, n: usize| at.saturating_add_signed(k).min(n - 1);
        self.offsets().zip(&self.0).fold([0.0; 2], |[along_x, along_y], (k, weight)| {
            let [right, below] = [grey(beside(x, k, width), y), grey(x, beside(y, k, height))];
            [along_x + weight * f64::from(right), along_y + weight * f64::from(below)]
        })
    }

    /// The sums of an image along both axes, one after the other, with nothing beyond it.
    fn smooth(&self, grey: &[f32], [width, height]: [usize; 2]) -> Vec<f32> {
        let weights: Vec<f32> = self.0.iter().map(|weight| *weight as f32).collect();
        let reach = self.reach();
        let mut along_y = vec![0.0; width * height];
        along_y.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (k, weight) in weights.iter().enumerate() {
                let Some(from) = (y + k).checked_sub(reach).filter(|from| *from < height) else { continue };
                row.iter_mut().zip(&grey[from * width..]).for_each(|(sum, grey)| *sum += weight * grey);
            }
        });
        let mut along_both = vec![0.0; width * height];
        along_both.par_chunks_mut(width).zip(along_y.par_chunks(width)).for_each(|(row, from)| {
            for (k, weight) in weights.iter().enumerate() {
                let (skip, ahead) = (k.saturating_sub(reach), reach.saturating_sub(k));
                let sums = row.iter_mut().skip(ahead);
                sums.zip(from.iter().skip(skip)).for_each(|(sum, grey)| *sum += weight * grey);
            }
        });
        along_both
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::correlate::Options;
    use crate::mesh::{PixelMesh, Roi, Zone};

    const SIDE: usize = 256;
    const ALL: [usize; 4] = [0, 0, SIDE, SIDE];

    fn draw(k: usize) -> f64 {
        let mixed = (k as u64 ^ 0x9E37_79B9).wrapping_mul(0xD6E8_FEB8_6659_FD93);
        ((mixed ^ (mixed >> 32)).wrapping_mul(0xD6E8_FEB8_6659_FD93) >> 40) as f64 / 2f64.powi(24)
    }

    /// Of standard deviation one.
    fn normal(k: usize) -> f64 {
        (0..12).map(|j| draw(12 * k + j)).sum::<f64>() - 6.0
    }

    /// Speckles of some 5 px with a contrast of 43 grey levels: 80 waves.
    fn texture(x: usize, y: usize) -> f64 {
        let wave = |k: usize| {
            let [kx, ky] = [2 * k, 2 * k + 1].map(|k| 0.45 * normal(90_000 + k));
            (kx * x as f64 + ky * y as f64 + std::f64::consts::TAU * draw(5 * k)).cos()
        };
        43.0 * (2.0f64 / 80.0).sqrt() * (0..80).map(wave).sum::<f64>()
    }

    #[test]
    fn a_noisy_reference_has_a_smoothed_gradient_of_less_variance_and_a_quiet_one_its_own() {
        let clean: Vec<f64> = (0..SIDE * SIDE).map(|k| texture(k % SIDE, k / SIDE)).collect();
        let image = |noise: f64| {
            let grey = |(k, clean): (usize, &f64)| (128.0 + clean + noise * normal(k)) as f32;
            Image::new(SIDE, SIDE, Pixels::F32(clean.iter().enumerate().map(grey).collect())).unwrap()
        };
        let zone = Zone::rectangle("all", Roi { x0: 16.0, y0: 16.0, x1: 240.0, y1: 240.0 });
        let PixelMesh { pixels, zone_pixels, .. } = PixelMesh::on_zones(&[zone], 16, 0.5, [SIDE, SIDE]).unwrap();
        let options = Options::default();
        let noise = |image: &Image| AssumedNoise::of(image, &zone_pixels, &options);
        let smoothed = |image: &Image| smooth_reference(image, &pixels, &noise(image), options.interpolation);
        assert!(smoothed(&image(2.0)).is_none());
        let noisy = image(14.0);
        let found = smoothed(&noisy).expect("a third of the contrast");
        let (slope, at, size) = (Weights::slope(options.interpolation), sample(&pixels, ALL), [SIDE, SIDE]);
        let gradients = |grey: &(dyn Fn(usize, usize) -> f32 + Sync)| slope.gradients(&at, size, grey);
        let truth = gradients(&|x, y| clean[y * SIDE + x] as f32);
        let [own, better] = [&noisy, &*found.image].map(|image| gradients(&|x, y| image.grey(x, y)));
        let variance = |g: &[[f64; 2]]| mean_product(g, g) / mean_product(g, &truth).powi(2);
        let ratio = variance(&better) / variance(&own);
        // Noise is 0.42 of the square of its own gradient: without any noise 0.58 would be left.
        assert!((0.58..0.65).contains(&ratio), "{ratio}");
        // The matrix is that of the steps, but for the noise in it.
        let [power, texture] = [mean_product(&better, &better), mean_product(&better, &truth)];
        let without_noise = power - 14.0 * 14.0 * found.gradient_noise_gain;
        assert!((without_noise / texture - 1.0).abs() < 0.03, "{without_noise} for {texture}");
        // What the noise of the image adds to the product of both gradients.
        let pattern = (mean_product(&better, &own) - texture) / (14.0 * 14.0);
        assert!((pattern / found.gradient_pattern_gain - 1.0).abs() < 0.1, "{pattern}");
    }
}
