//! From a texture and its motion to an image.

use super::inverse::{Axis, TILE, TileMap};
use super::kernel::{Patch, integrate_row, texture_at};
use super::{Motion, SynthError, Texture};
use crate::imaging::{Image, ImageError, Pixels};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// The depth of a rendered image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Depth {
    /// 0..255, rounded; the default.
    #[default]
    U8,
    /// 0..65535, rounded: 257 times the grey level.
    U16,
    /// The 0..255 scale, neither rounded nor clipped.
    F32,
}

/// How an image is rendered. Grey levels are those of the 0..255 scale, whatever the depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderOptions {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Depth of the image.
    pub depth: Depth,
    /// Standard deviation of the Gaussian noise, grey levels; 0 for none.
    pub noise: f32,
    /// Seed of the noise.
    pub seed: u64,
    /// Number of the image in its series: each has noise of its own.
    pub frame: u64,
    /// Gauss points along the side of a pixel, 1 (the grey level at its centre) to 6.
    pub points: usize,
    /// Grey level where there is no material.
    pub dark: f32,
}

impl RenderOptions {
    /// 8 bit, no noise, 2 x 2 points, dark grey level 12.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, depth: Depth::U8, noise: 0.0, seed: 1, frame: 0, points: 2, dark: 12.0 }
    }
}

/// Points and weights of Gauss's rules on -0.5..0.5, one to six points; the positive half, outermost
/// first. The points are rounded to 2^-20 px, so that shifts by whole pixels are free of rounding.
const GAUSS: [&[[f64; 2]]; 6] = [
    &[[0.0, 1.0]],
    &[[0.288_675_134_594_812_9, 0.5]],
    &[[0.387_298_334_620_741_7, 0.277_777_777_777_777_8], [0.0, 0.444_444_444_444_444_4]],
    &[[0.430_568_155_797_026_3, 0.173_927_422_568_726_9], [0.169_990_521_792_428_1, 0.326_072_577_431_273_1]],
    &[
        [0.453_089_922_969_331_9, 0.118_463_442_528_094_5],
        [0.269_234_655_052_841_5, 0.239_314_335_249_683_2],
        [0.0, 0.284_444_444_444_444_4],
    ],
    &[
        [0.466_234_757_101_576_1, 0.085_662_246_189_585_2],
        [0.330_604_693_233_132_3, 0.180_380_786_524_069_3],
        [0.119_309_593_041_598_5, 0.233_956_967_286_345_5],
    ],
];

/// Offsets (px) and weights of the rule with `points` points.
fn gauss(points: usize) -> Option<(Vec<f64>, Vec<f32>)> {
    let half = GAUSS.get(points.checked_sub(1)?)?;
    let round = |x: f64| (x * 1_048_576.0).round() / 1_048_576.0;
    let left = half.iter().map(|&[x, weight]| (-round(x), weight as f32));
    let right = half.iter().rev().filter(|p| p[0] > 0.0).map(|&[x, weight]| (round(x), weight as f32));
    Some(left.chain(right).unzip())
}

/// Renders `texture` as moved by `motion`.
///
/// A pixel is the mean of the moved texture over its area by Gauss's rule; each point is followed back to its material
/// point to 1e-12 px, and belongs to one body or the dark between. The bits do not depend on the number of threads.
///
/// # Errors
/// A size of zero, noise or a rule that do not exist, or a motion that folds within the image.
pub fn render<M: Motion + ?Sized>(texture: &Texture, motion: &M, options: &RenderOptions) -> Result<Image, SynthError> {
    let &RenderOptions { width, height, noise, points, .. } = options;
    if !(noise.is_finite() && noise >= 0.0) {
        return Err(SynthError::Noise { noise });
    }
    let (offsets, weights) = gauss(points).ok_or(SynthError::Points(points))?;
    if width == 0 || height == 0 {
        return Err(ImageError::Empty { width, height }.into());
    }
    let too_large = SynthError::TooLarge(width, height);
    let n_pixels = width.checked_mul(height).ok_or(too_large.clone())?;
    let mut greys: Vec<f32> = Vec::new();
    greys.try_reserve_exact(n_pixels).map_err(|_| too_large)?;
    greys.resize(n_pixels, 0.0);

    let columns = AxisPair::new(width, &offsets);
    let rows = AxisPair::new(height, &offsets);
    greys.par_chunks_mut(width * TILE).enumerate().try_for_each_init(Scratch::default, |scratch, (band, greys)| {
        let y = band * TILE;
        let row_axis = rows.of(y);
        // What one band learns stays within it: the bits must not depend on who renders it.
        scratch.orders.clear();
        scratch.orders.resize(motion.n_bodies(), 0);
        for x in (0..width).step_by(TILE) {
            let axes = [columns.of(x), row_axis];
            scratch.tile(texture, motion, options.dark, [x, y], axes)?;
            scratch.integrate(&weights, axes, &mut greys[x..], width, TILE.min(width - x));
        }
        if noise > 0.0 {
            let mut seed = [0; 32];
            seed[..8].copy_from_slice(&options.seed.to_le_bytes());
            seed[8..16].copy_from_slice(&options.frame.to_le_bytes());
            for (row, greys) in greys.chunks_exact_mut(width).enumerate() {
                // Every row has its own stream, so that rows can be made in any order.
                let mut random = ChaCha8Rng::from_seed(seed);
                random.set_stream((y + row) as u64);
                for grey in greys {
                    let normal: f32 = StandardNormal.sample(&mut random);
                    *grey += noise * normal;
                }
            }
        }
        Ok::<_, SynthError>(())
    })?;

    let pixels = match options.depth {
        // `as` cuts off and saturates: rounds half up, clips at both ends.
        Depth::U8 => Pixels::U8(greys.par_iter().map(|grey| (grey + 0.5) as u8).collect()),
        Depth::U16 => Pixels::U16(greys.par_iter().map(|grey| (257.0 * grey + 0.5) as u16).collect()),
        Depth::F32 => Pixels::F32(greys),
    };
    Ok(Image::new(width, height, pixels)?)
}

/// The sample positions of whole tiles and of the last one.
struct AxisPair {
    whole: Axis,
    last: Axis,
    start_of_last: usize,
}

impl AxisPair {
    fn new(n_pixels: usize, offsets: &[f64]) -> Self {
        let start_of_last = (n_pixels - 1) / TILE * TILE;
        Self { whole: Axis::new(TILE, offsets), last: Axis::new(n_pixels - start_of_last, offsets), start_of_last }
    }

    fn of(&self, start: usize) -> &Axis {
        if start == self.start_of_last { &self.last } else { &self.whole }
    }
}

/// The arrays of one tile, reused.
#[derive(Default)]
struct Scratch {
    map: TileMap,
    patch: Patch,
    /// The order of interpolation that served each body last.
    orders: Vec<usize>,
    owned: Vec<bool>,
    taken: Vec<bool>,
    values: Vec<f32>,
    /// Grey levels at the sample points.
    greys: Vec<f32>,
}

impl Scratch {
    /// Fills `greys` for the tile whose first pixel is `corner`.
    fn tile<M: Motion + ?Sized>(
        &mut self,
        texture: &Texture,
        motion: &M,
        dark: f32,
        corner: [usize; 2],
        axes: [&Axis; 2],
    ) -> Result<(), SynthError> {
        let constants = texture.constants();
        let n_points = axes[0].positions.len() * axes[1].positions.len();
        let n_bodies = motion.n_bodies();
        self.values.resize(n_points, 0.0);
        self.greys.clear();
        self.greys.resize(n_points, dark);
        self.taken.clear();
        self.taken.resize(n_points, false);
        for body in 0..n_bodies {
            if body > 0 && !self.taken.contains(&false) {
                break;
            }
            self.map.invert(motion, body, corner.map(|k| k as f64), axes, &mut self.orders[body])?;
            let points = || self.map.x.iter().zip(&self.map.y).map(|(&x, &y)| [x, y]);
            self.owned.clear();
            if n_bodies > 1 {
                self.owned.extend(points().zip(&self.taken).map(|(x, &taken)| !taken && motion.body_holds(body, x)));
                if !self.owned.contains(&true) {
                    continue;
                }
            }
            let (low, high) = self.map.bounds;
            if texture.patch(low, high, &mut self.patch).is_some() {
                let values = &mut self.values;
                texture_at(&self.patch, &constants, &self.map.x, &self.map.y, &self.owned, values);
            } else {
                // Only a motion that tears a tile apart comes here: slow, but right.
                for (value, x) in self.values.iter_mut().zip(points()) {
                    *value = texture.value(x) as f32;
                }
            }
            if n_bodies == 1 {
                std::mem::swap(&mut self.greys, &mut self.values);
            } else {
                for (at, _) in self.owned.iter().enumerate().filter(|(_, owned)| **owned) {
                    self.greys[at] = self.values[at];
                    self.taken[at] = true;
                }
            }
        }
        Ok(())
    }

    /// Sums the sample points of each pixel into `out`, an image `stride` wide.
    fn integrate(&self, weights: &[f32], axes: [&Axis; 2], out: &mut [f32], stride: usize, n_columns: usize) {
        let width = axes[0].positions.len();
        for (out, samples) in out.chunks_mut(stride).zip(self.greys.chunks_exact(width * weights.len())) {
            for (samples, &by_row) in samples.chunks_exact(width).zip(weights) {
                integrate_row(samples, weights, by_row, &mut out[..n_columns]);
            }
        }
    }
}
