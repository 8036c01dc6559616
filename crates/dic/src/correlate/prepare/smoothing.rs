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
/// Pixels that tell how much of the texture is left.
const SAMPLES: usize = 1 << 16;

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

/// The variance of a displacement by its gradient `g`, that of the texture being `t`: `E[g^2] / E[g t]^2`.
struct Trial {
    width_px: f64,
    variance: f64,
    /// Factor on the gradient with which `E[g^2] = E[g t]` but for the noise in it, so that the normal matrix is that of
    /// the steps.
    factor: f64,
    noise_gain: f64,
    pattern_gain: f64,
    grey: Vec<f32>,
}

/// Smooths a reference where that makes displacements clearly more certain.
pub(crate) fn smooth_reference(
    image: &Image,
    pixels: &PixelMap,
    noise: &AssumedNoise,
    interpolation: Interpolation,
) -> Option<Smoothed> {
    let size = [image.width(), image.height()];
    let [width, height] = size;
    let at = sample(pixels);
    let slope = Weights::slope(interpolation);
    let gradients = |grey: &(dyn Fn(usize, usize) -> f32 + Sync)| -> Vec<[f64; 2]> {
        at.par_iter().map(|&[x, y]| slope.gradient(grey, size, [x, y])).collect()
    };
    let mean_product = |a: &[[f64; 2]], b: &[[f64; 2]]| {
        a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum::<f64>() / (2.0 * at.len() as f64)
    };
    let square = noise.of_reference * noise.of_reference;
    let own = gradients(&|x, y| image.grey(x, y));
    let (power, from_noise) = (mean_product(&own, &own), square * interpolation.gradient_noise_gain());
    if at.is_empty() || from_noise < LEAST_NOISE * power {
        return None;
    }
    let inside = Inside::of(image, pixels);
    let trial = |width_px: f64| {
        let gaussian = Weights::gaussian(width_px);
        let grey = gaussian.smooth(&inside.continued(width_px), size);
        let smoothed = gradients(&|x, y| grey[y * width + x]);
        let both = slope.after(&gaussian);
        let pattern_gain = gaussian.at(0) * slope.dot(&both);
        let texture = mean_product(&smoothed, &own) - square * pattern_gain;
        let power = mean_product(&smoothed, &smoothed);
        let noise_gain = gaussian.dot(&gaussian) * both.dot(&both);
        let factor = texture / (power - square * noise_gain);
        let variance = power / (texture * texture);
        let (noise_gain, pattern_gain) = (factor * factor * noise_gain, factor * pattern_gain);
        (texture > 0.0 && factor > 0.0).then_some(Trial { width_px, variance, factor, noise_gain, pattern_gain, grey })
    };
    let trials: Vec<Trial> = WIDTHS_PX.into_iter().filter_map(trial).collect();
    let least = trials.iter().map(|trial| trial.variance).fold(f64::INFINITY, f64::min);
    let best = trials.into_iter().rfind(|trial| trial.variance <= AS_GOOD * least)?;
    if best.variance >= WORTH * power / (power - from_noise).max(0.0).powi(2) {
        return None;
    }
    let grey = best.grey.iter().map(|grey| inside.mean + best.factor as f32 * grey).collect();
    let image = Image::new(width, height, Pixels::F32(grey)).ok()?;
    Some(Smoothed {
        image: Arc::new(image),
        width_px: best.width_px,
        gradient_noise_gain: best.noise_gain,
        gradient_pattern_gain: best.pattern_gain,
    })
}

/// Pixels of the elements, evenly chosen.
fn sample(pixels: &PixelMap) -> Vec<[usize; 2]> {
    let counted: usize = pixels.elements().iter().map(|of| usize::from(of.nx) * usize::from(of.ny)).sum();
    // No divisor of the width of elements is likely to be one of it.
    let step = counted.div_ceil(SAMPLES) | 1;
    let (mut n, mut at) = (0, Vec::with_capacity(counted / step + 1));
    for element in pixels.elements() {
        pixels.for_each(element, |x, y, _, _| {
            if n % step == 0 {
                at.push([x as usize, y as usize]);
            }
            n += 1;
        });
    }
    at
}

/// The pixels of the elements; beyond them another thing may begin.
struct Inside {
    mean: f32,
    size: [usize; 2],
    /// What each pixel is beside the mean, and 1; 0 beyond the elements.
    beside: Vec<f32>,
    is_in: Vec<f32>,
}

impl Inside {
    fn of(image: &Image, pixels: &PixelMap) -> Self {
        let size = [image.width(), image.height()];
        let (mut n, mut sum) = (0.0, 0.0);
        let for_each = |visit: &mut dyn FnMut(usize, usize)| {
            for element in pixels.elements() {
                pixels.for_each(element, |x, y, _, _| visit(x as usize, y as usize));
            }
        };
        for_each(&mut |x, y| (n, sum) = (n + 1.0, sum + f64::from(image.grey(x, y))));
        let mean = (sum / n) as f32;
        let [mut beside, mut is_in] = [0, 1].map(|_| vec![0.0; size[0] * size[1]]);
        for_each(&mut |x, y| {
            let k = y * size[0] + x;
            (beside[k], is_in[k]) = (image.grey(x, y) - mean, 1.0);
        });
        Self { mean, size, beside, is_in }
    }

    /// The same with what is near beyond the elements in the place of what is there: no edge for a Gaussian of
    /// `width_px`. Twice as wide a mean, so that hardly anything of the noise of one pixel comes back to it.
    fn continued(&self, width_px: f64) -> Vec<f32> {
        let wide = Weights::gaussian(2.0 * width_px);
        let [sums, shares] = [&self.beside, &self.is_in].map(|of| wide.smooth(of, self.size));
        let pixels = self.beside.iter().zip(&self.is_in).zip(sums.iter().zip(&shares));
        pixels
            .map(|((own, is_in), (sum, share))| if *is_in > 0.0 || *share < 1e-3 { *own } else { sum / share })
            .collect()
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
