//! Whether the noise is correlated from pixel to pixel, and what that does to uncertainties (docs/correlation.md, 2.7).
//!
//! The variance of `b = sum psi grad f r` is `sigma^2 sum (psi grad f)^2` for white noise. The correlation makes `b`
//! vanish; but *another* piece of the texture, laid over the residual of a block, has the same spectrum and does not:
//! the mean square of `sum q r` over many pairs of blocks, beside that for white noise of the residual's size, is the
//! factor on the variance. Smoothing, demosaicing, compression and noise of rows all show.

use crate::backend::{Backend, ElementMoments, GreyTransfer, KernelOptions};
use crate::correlate::{Elements, FixedPattern, Level, Patch, find_pattern, pattern_variance};
use crate::field::{Brightness, NoiseCorrelation};
use crate::imaging::{Image, Interpolation};
use crate::mesh::{Mesh, PixelSet, local_coordinates, shape_functions};
use crate::units::Px;
use rayon::prelude::*;
use std::fmt;

/// Blocks that are looked at, at most: they leave the factor a scatter of about 3 % and cost little beside a frame.
const BLOCKS: usize = 100;
/// Blocks without which nothing is said.
const LEAST_BLOCKS: usize = 12;
/// Side of a block, px, at most and at least.
const SIDES: [usize; 2] = [24, 4];
/// Pieces of texture laid over each block: as many as a block has modes in the band of its texture.
const PIECES: usize = 12;
/// Draws from which the share that the fit takes from the residual is found.
const DRAWS: usize = 3;
/// Lags of the autocorrelations, px.
const LAGS: usize = 4;
const WIDTH: usize = 2 * LAGS + 1;
/// Standard uncertainties are multiplied from this factor on ...
pub(crate) const SEEN: f64 = 1.1;
/// ... where it lies this many of its standard deviations above 1.
const CERTAIN: f64 = 3.5;
/// Blocks whose residual is this many times that of the usual one hold something else than noise.
const LOUD: f64 = 3.0;

/// What the residual of a frame says of its noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseColour {
    /// Factors on the standard uncertainty, for x and y, beside white noise.
    pub factor: [f64; 2],
    /// Their standard deviation.
    pub factor_sigma: f64,
    /// Correlation of neighbouring pixels of the residual along x and y, less that of white noise.
    pub neighbours: [f64; 2],
    /// Whether the residual holds so much displacement that is not followed that it does not tell about the noise.
    pub is_misfit: bool,
    /// What stays with the camera; none where it does not show.
    pub pattern: Option<FixedPattern>,
}

impl NoiseColour {
    /// Factors on standard uncertainties: none where the noise is white as far as can be seen, or misfit hides it.
    pub fn to_apply(&self) -> Option<[f64; 2]> {
        let largest = self.factor[0].max(self.factor[1]);
        let seen = largest > SEEN && largest > 1.0 + CERTAIN * self.factor_sigma;
        (seen && !self.is_misfit).then(|| self.factor.map(|factor| factor.max(1.0)))
    }
}

impl fmt::Display for NoiseColour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [along_x, along_y] = self.neighbours;
        let [x, y] = self.factor.map(|factor| factor.max(1.0));
        write!(
            f,
            "the noise is not white (correlation of neighbouring pixels {along_x:.2} along x, {along_y:.2} along y): standard \
             uncertainties are multiplied by {x:.2} (x) and {y:.2} (y)"
        )
    }
}

/// Factors on the standard uncertainties of both components for noise that is not white.
pub(crate) fn factors(asked: NoiseCorrelation, found: Option<&NoiseColour>) -> [f64; 2] {
    match asked {
        NoiseCorrelation::Off => [1.0; 2],
        NoiseCorrelation::Factor(factor) => [factor; 2],
        NoiseCorrelation::Auto => found.and_then(NoiseColour::to_apply).unwrap_or([1.0; 2]),
    }
}

/// A square of pixels inside one element.
struct Block {
    element: usize,
    corner: [usize; 2],
    /// Shape functions of the element at the pixels.
    psi: Vec<[f32; 4]>,
    grey: Vec<f32>,
    /// Its gradient in both directions, without mean and slope, of unit length.
    pieces: [Vec<f32>; 2],
}

/// Autocorrelation at lags up to [`LAGS`], row by row.
type Lags = [f64; WIDTH * WIDTH];

pub(crate) struct NoiseProbe {
    side: usize,
    offset: f32,
    interpolation: Interpolation,
    gradient_noise_gain: f64,
    gradient_pattern_gain: f64,
    own_transfer: bool,
    blocks: Vec<Block>,
    /// Mean autocorrelation of the pieces of texture, for both components.
    of_pieces: [Lags; 2],
    /// Share of a piece's mean square that the fit leaves in the residual.
    left: [f64; 2],
    /// Autocorrelation of the interpolation's weights over the sub-pixel offset.
    filter: Vec<[f64; LAGS + 1]>,
    /// Noise variance of the reference in that of one image.
    of_reference: f64,
    /// Mean square of a component of the reference's gradient, (grey levels / px)^2.
    gradient: f64,
}

pub(crate) struct Prepared<'a, B: Backend> {
    pub image: &'a Image,
    /// What the gradient is made of.
    pub texture: &'a Image,
    pub kernel: &'a KernelOptions,
    pub n_references: usize,
    pub level: &'a Level<B>,
    pub pixels: &'a [PixelSet],
}

/// Sums of one block of a frame, the residual's size taken off.
struct BlockSums {
    /// Mean square of the residual over that of white noise of one grey level.
    level: f64,
    /// The same of the pieces laid over it, per component.
    pieces: [f64; 2],
    /// Correlation of neighbours along x and y less that of white noise.
    neighbours: [f64; 2],
    /// Variance of what stays with the camera, where the block has moved far enough to show it.
    pattern: Option<f64>,
}

impl NoiseProbe {
    /// Chooses blocks and prepares them; `None` where too few whole ones lie in the zones.
    pub fn new<B: Backend>(of: &Prepared<'_, B>) -> Option<Self> {
        let (Level { mesh, moments, .. }, interpolation) = (of.level, of.kernel.interpolation);
        let side = side(mesh)?;
        let eligible: Vec<(usize, [usize; 2])> = (0..mesh.n_elements())
            .filter(|&element| moments[element].n > 0.0)
            .filter_map(|element| Some((element, corner(of, element, side)?)))
            .collect();
        let n = eligible.len().min(BLOCKS);
        if n < LEAST_BLOCKS {
            return None;
        }
        let chosen: Vec<_> = (0..n).map(|k| eligible[k * eligible.len() / n]).collect();
        let own_transfer = of.kernel.brightness == Brightness::Element;
        let (blocks, gradients): (Vec<Block>, Vec<[Vec<f32>; 2]>) =
            chosen.into_par_iter().filter_map(|(element, corner)| Block::new(of, element, corner, side)).unzip();
        if blocks.len() < LEAST_BLOCKS {
            return None;
        }
        let mean_lags = |parts: Vec<&Vec<f32>>| {
            let lags: Vec<Lags> = parts.par_iter().map(|part| autocorrelation(part, side)).collect();
            let mut sum = [0.0; WIDTH * WIDTH];
            for lags in &lags {
                sum.iter_mut().zip(lags).for_each(|(sum, value)| *sum += value);
            }
            sum.map(|sum| sum / f64::max(lags.len() as f64, 1.0))
        };
        let of_pieces = [0, 1].map(|c| mean_lags(blocks.iter().map(|block| &block.pieces[c]).collect()));
        let left_by_fit = |c| left_by_fit(of, &blocks, &gradients, c, own_transfer);
        let left = rayon::join(|| left_by_fit(0), || left_by_fit(1)).into();
        // `sum_k eta(t + k) eta(t + k + lag)` per lag.
        let filter_lags = |t: f64| -> [f64; LAGS + 1] {
            let weight: Vec<f64> = (-12..=12 + LAGS as i32).map(|k| interpolation.cardinal(t + f64::from(k))).collect();
            std::array::from_fn(|lag| weight.iter().zip(&weight[lag..]).map(|(a, b)| a * b).sum())
        };
        let filter = (0..=64).map(|k| filter_lags(f64::from(k) / 64.0)).collect();
        Some(Self {
            side,
            offset: of.kernel.grey_offset,
            interpolation,
            gradient_noise_gain: of.kernel.gradient_noise_gain,
            gradient_pattern_gain: of.kernel.gradient_pattern_gain,
            own_transfer,
            blocks,
            of_pieces,
            left,
            filter,
            of_reference: 1.0 / of.n_references.max(1) as f64,
            gradient: mean_gradient(moments),
        })
    }

    /// Looks at the residual of `image` in a frame: `None` where too few blocks are whole. `freedom` is the share of
    /// the residual's degrees of freedom that the unknowns of each zone leave. Below half of the standard deviation of
    /// rounding (identical images) there is round-off, whose colour means nothing. `light` comes before the transfer of
    /// the zone at each node, where it varies; of a block in the mean. `is_misfit`: displacements are not followed.
    pub fn look(
        &self,
        frame: &Elements<'_>,
        image: &Image,
        light: Option<&[GreyTransfer]>,
        freedom: &[f64],
        is_misfit: bool,
    ) -> Option<NoiseColour> {
        let &Elements { mesh, matched, displacement, transfer, least, .. } = frame;
        let of_block = |(at, block): (usize, &Block)| {
            if matched[block.element].n == 0.0 {
                return None;
            }
            let zone = mesh.element_zone()[block.element] as usize;
            let nodes = mesh.elements()[block.element];
            let of_zone = transfer[zone];
            let by_light = light.map_or(of_zone, |light| {
                let mean = |of: &dyn Fn(&GreyTransfer) -> f64| {
                    nodes.iter().map(|&node| 0.25 * of(&light[node as usize])).sum::<f64>()
                };
                GreyTransfer {
                    gain: of_zone.gain * mean(&|t| t.gain),
                    offset: of_zone.gain * mean(&|t| t.offset) + of_zone.offset,
                }
            });
            let nodes = nodes.map(|node| displacement[node as usize]);
            let (residual, gain, u) = self.residual(block, image, nodes, by_light)?;
            Some(self.sums(at, &residual, gain, u, freedom[zone]))
        };
        let sums: Vec<Option<BlockSums>> = self.blocks.par_iter().enumerate().map(of_block).collect();
        let sums: Vec<BlockSums> = sums.into_iter().flatten().filter(|sums| sums.level > 0.25 * least).collect();
        let mut levels: Vec<f64> = sums.iter().map(|sums| sums.level).collect();
        levels.sort_by(f64::total_cmp);
        let loud = LOUD * *levels.get(levels.len() / 2)?;
        let quiet: Vec<&BlockSums> = sums.iter().filter(|sums| sums.level <= loud).collect();
        if quiet.len() < LEAST_BLOCKS {
            return None;
        }
        let n = quiet.len() as f64;
        let mean = |of: &dyn Fn(&BlockSums) -> f64| quiet.iter().map(|sums| of(sums)).sum::<f64>() / n;
        let square = [0, 1].map(|c| mean(&|sums| sums.pieces[c]));
        let scatter = [0, 1].map(|c| (mean(&|sums| (sums.pieces[c] - square[c]).powi(2)) / n).sqrt());
        let factor = square.map(|square| square.max(0.0).sqrt());
        let relative = |c: usize| if square[c] > 0.0 { 0.5 * scatter[c] / square[c] } else { 0.0 };
        let patterns: Vec<f64> = quiet.iter().filter_map(|sums| sums.pattern).collect();
        let gain = self.gradient_noise_gain;
        let texture = self.gradient - gain * mean(&|sums| sums.level);
        let colour = NoiseColour {
            factor,
            factor_sigma: relative(0).max(relative(1)),
            neighbours: [0, 1].map(|c| mean(&|sums| sums.neighbours[c])),
            is_misfit,
            pattern: find_pattern(&patterns, texture, self.gradient_pattern_gain),
        };
        let numbers = [colour.factor[0], colour.factor[1], colour.factor_sigma];
        numbers.iter().all(|v| v.is_finite()).then_some(colour)
    }

    /// The residual of a block, its gain, and the displacement of its middle; `None` where it has left the image.
    fn residual(
        &self,
        block: &Block,
        image: &Image,
        nodes: [[f64; 2]; 4],
        transfer: GreyTransfer,
    ) -> Option<(Vec<f32>, f64, [f64; 2])> {
        let side = self.side;
        if !nodes.as_flattened().iter().all(|u| u.is_finite() && u.abs() < 1e6) {
            return None;
        }
        // All pixels by the same whole displacement, so that no digits are lost.
        let whole = nodes[0].map(f64::floor);
        let nodes = nodes.map(|u| [0, 1].map(|c| (u[c] - whole[c]) as f32));
        let u: Vec<[f32; 2]> = block
            .psi
            .iter()
            .map(|psi| [0, 1].map(|c| nodes.iter().zip(psi).map(|(u, psi)| u[c] * psi).sum::<f32>()))
            .collect();
        let corner = [0, 1].map(|c| block.corner[c] as isize + whole[c] as isize);
        let range = |c: usize| {
            u.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), u| (low.min(u[c]), high.max(u[c])))
        };
        let [low, high] = {
            let (x, y) = (range(0), range(1));
            // A displacement of any size, saturating: it is judged below.
            let at = |c: usize, v: f32, more: usize| (corner[c] + more as isize).saturating_add(v.floor() as isize);
            [[at(0, x.0, 0), at(1, y.0, 0)], [at(0, x.1, side), at(1, y.1, side)]]
        };
        let size = [image.width() as isize, image.height() as isize];
        // A block that was stretched over the whole image follows nothing.
        let stretched = (0..2).any(|c| high[c].saturating_sub(low[c]) > 4 * side as isize + 8);
        if stretched || (0..2).any(|c| low[c] < 0 || high[c] > size[c] - 1) {
            return None;
        }
        let patch = Patch::new(image, self.offset, low, high, self.interpolation);
        let corner = corner.map(|v| v as usize);
        let deformed: Vec<f32> =
            // A corner before the image, where the displacement leads back into it, is counted round.
            (0..side * side)
                .map(|k| patch.grey([corner[0].wrapping_add(k % side), corner[1].wrapping_add(k / side)], u[k]))
                .collect();
        let (gain, offset) =
            if self.own_transfer { own_transfer(&block.grey, &deformed) } else { (transfer.gain, transfer.offset) };
        let left = |(f, g): (&f32, &f32)| (f64::from(*f) - gain * f64::from(*g) - offset) as f32;
        let residual = block.grey.iter().zip(&deformed).map(left).collect();
        let middle = u[side / 2 * side + side / 2];
        Some((residual, gain, [0, 1].map(|c| whole[c] + f64::from(middle[c]))))
    }

    fn sums(&self, at: usize, residual: &[f32], gain: f64, u: [f64; 2], freedom: f64) -> BlockSums {
        let (n, side) = (self.blocks.len(), self.side);
        let [filter_x, filter_y] = u.map(|u| {
            let t = 64.0 * (u - u.floor());
            let k = (t as usize).min(63);
            let t = t - k as f64;
            let between = |lag: usize| self.filter[k][lag] + t * (self.filter[k + 1][lag] - self.filter[k][lag]);
            std::array::from_fn::<f64, { LAGS + 1 }, _>(between)
        });
        // Mean square that white noise of one grey level in each image leaves along what autocorrelates by `lags`.
        let white = |lags: &Lags| {
            let mut sum = 0.0;
            for (k, value) in lags.iter().enumerate() {
                let (x, y) = ((k % WIDTH).abs_diff(LAGS), (k / WIDTH).abs_diff(LAGS));
                sum += filter_x[x] * filter_y[y] * value;
            }
            self.of_reference * lags[LAGS * WIDTH + LAGS] + gain * gain * sum
        };
        let at_rest = self.of_reference + gain * gain * filter_x[0] * filter_y[0];
        let square = residual.iter().map(|&r| f64::from(r) * f64::from(r)).sum::<f64>() / residual.len() as f64;
        let level = square / (at_rest * freedom.max(1e-3));
        let unit = level.max(f64::MIN_POSITIVE);
        let along = |part: &[f32]| dot(part, residual).powi(2) / unit;
        let n_pieces = PIECES.min(n - 1);
        let pieces = [0, 1].map(|c| {
            let others = (0..n_pieces).map(|j| (at + 1 + j * (n - 1) / n_pieces) % n);
            let sum: f64 = others.map(|other| along(&self.blocks[other].pieces[c])).sum();
            sum / (n_pieces as f64 * white(&self.of_pieces[c]) * self.left[c])
        });
        let lag = |step: usize, inside: &dyn Fn(usize) -> bool| {
            let pairs = (0..residual.len() - step).filter(|&k| inside(k));
            let (sum, n) = pairs.fold((0.0, 0.0), |(sum, n), k| {
                (sum + f64::from(residual[k]) * f64::from(residual[k + step]), n + 1.0)
            });
            sum / f64::max(n, 1.0) / square.max(f64::MIN_POSITIVE)
        };
        let of_white = |x: usize, y: usize| gain * gain * filter_x[x] * filter_y[y] / at_rest;
        let neighbours = [lag(1, &|k| k % side + 1 < side) - of_white(1, 0), lag(side, &|_| true) - of_white(0, 1)];
        let pattern = pattern_variance(residual, side, u, gain, |x| self.interpolation.cardinal(x));
        BlockSums { level, pieces, neighbours, pattern }
    }
}

impl Block {
    /// The block with its raw gradient; `None` without texture.
    fn new<B: Backend>(
        of: &Prepared<'_, B>,
        element: usize,
        corner: [usize; 2],
        side: usize,
    ) -> Option<(Self, [Vec<f32>; 2])> {
        let low = corner.map(|v| v as isize);
        let (offset, high) = (of.kernel.grey_offset, low.map(|v| v + side as isize));
        let patch = Patch::new(of.texture, offset, low, high, of.kernel.interpolation.of_gradient());
        let pixels = || (0..side * side).map(|k| [corner[0] + k % side, corner[1] + k / side]);
        let grey: Vec<f32> = pixels().map(|[x, y]| of.image.grey(x, y) - offset).collect();
        let gradient: Vec<[f32; 2]> = pixels().map(|pixel| patch.gradient(pixel)).collect();
        let corners = of.level.mesh.corners(element);
        let psi: Vec<[f32; 4]> = pixels()
            .map(|[x, y]| {
                let [xi, eta] = local_coordinates(corners, [x as f64, y as f64])?;
                Some(shape_functions(xi, eta).map(|v| v as f32))
            })
            .collect::<Option<_>>()?;
        let gradients = [0, 1].map(|c| gradient.iter().map(|g| g[c]).collect::<Vec<f32>>());
        // Along each axis of the block from -1 to 1.
        let axis = |k: usize| (2.0 * k as f32 + 1.0) / side as f32 - 1.0;
        let [x, y] = [|k: usize, side: usize| k % side, |k: usize, side: usize| k / side]
            .map(|of| (0..side * side).map(|k| axis(of(k, side))).collect::<Vec<f32>>());
        let mut flat = Basis::default();
        flat.add(vec![1.0; side * side], 0.0);
        flat.add(x.clone(), 0.0);
        flat.add(y.clone(), 0.0);
        let piece = |c: usize| flat.rest(gradients[c].clone(), 1e-3);
        let pieces = [piece(0)?, piece(1)?];
        Some((Self { element, corner, psi, grey, pieces }, gradients))
    }
}

fn mean_gradient(moments: &[ElementMoments]) -> f64 {
    let (sum, n) = moments
        .iter()
        .fold((0.0, 0.0), |(sum, n), m| (sum + 0.5 * (m.gradient_power(0) + m.gradient_power(2)), n + m.n));
    sum / f64::max(n, 1.0)
}

/// Vectors of unit length at right angles to each other.
#[derive(Clone, Default)]
struct Basis {
    parts: Vec<Vec<f32>>,
}

impl Basis {
    /// Adds what `vector` has beside the others, unless that is less than a share `least` of it.
    fn add(&mut self, vector: Vec<f32>, least: f64) {
        self.parts.extend(self.rest(vector, least));
    }

    /// What `vector` has beside them, of unit length; `None` when that is less than a share `least` of it.
    fn rest(&self, mut vector: Vec<f32>, least: f64) -> Option<Vec<f32>> {
        let whole = dot(&vector, &vector).sqrt();
        for _ in 0..2 {
            for part in &self.parts {
                let along = dot(part, &vector) as f32;
                vector.iter_mut().zip(part).for_each(|(v, part)| *v -= along * part);
            }
        }
        let length = dot(&vector, &vector).sqrt();
        if !(length > least * whole && length > 0.0) {
            return None;
        }
        vector.iter_mut().for_each(|v| *v = (f64::from(*v) / length) as f32);
        Some(vector)
    }
}

/// Side of the blocks: a square that the elements hold.
fn side(mesh: &Mesh<Px>) -> Option<usize> {
    let regular = (0..mesh.zones().len()).all(|zone| mesh.grid(zone).is_some());
    // Half of the side lies inside any element that is not very distorted, and inside a triangle.
    let side = if regular { mesh.element_size() } else { 0.5 * mesh.element_size() };
    let side = (side.floor() as usize).min(SIDES[0]);
    (side >= SIDES[1]).then_some(side)
}

/// The first pixel of the block in the middle of an element, when all its pixels belong to it.
fn corner<B: Backend>(of: &Prepared<'_, B>, element: usize, side: usize) -> Option<[usize; 2]> {
    let corners = of.level.mesh.corners(element);
    let zone = of.level.mesh.element_zone()[element] as usize;
    // A triangle has its last corner twice, and its middle is that of three.
    let n = if corners[2] == corners[3] { 3 } else { 4 };
    let middle = [0, 1].map(|c| corners[..n].iter().map(|p| p[c]).sum::<f64>() / n as f64);
    let first = middle.map(|v| (v - 0.5 * side as f64 - 1e-9).ceil());
    let size = [of.image.width(), of.image.height()];
    if (0..2).any(|c| first[c] < 0.0 || first[c] + side as f64 > size[c] as f64) {
        return None;
    }
    let first = first.map(|v| v as usize);
    let bounds = [first[0], first[1], first[0] + side, first[1] + side];
    if of.pixels[zone].count(bounds) < side * side {
        return None;
    }
    let within = |x: usize, y: usize| {
        local_coordinates(corners, [x as f64, y as f64])
            .is_some_and(|local| local.iter().all(|v| (-1e-6..=1.0 + 1e-6).contains(v)))
    };
    let (x, y) = (first[0] + side - 1, first[1] + side - 1);
    let inside = within(first[0], first[1]) && within(x, first[1]) && within(x, y) && within(first[0], y);
    inside.then_some(first)
}

/// Share of the mean square of the pieces (of component `c`), laid over other blocks, that the fit leaves in the
/// residual `(I - G A^-1 G^T) e`: `1 - (2 b . a - a . M a)`, `a = A^-1 b`, for pieces with a random sign each.
fn left_by_fit<B: Backend>(
    of: &Prepared<'_, B>,
    blocks: &[Block],
    gradients: &[[Vec<f32>; 2]],
    c: usize,
    own_transfer: bool,
) -> f64 {
    let Level { mesh, solver, .. } = of.level;
    let n = blocks.len();
    let (mut whole, mut taken) = (0.0, 0.0);
    for draw in 0..DRAWS {
        let mut b = vec![[0.0; 2]; mesh.n_nodes()];
        for (at, (block, gradient)) in blocks.iter().zip(gradients).enumerate() {
            // Multiplicative hashing: as good as chance, and the same every time.
            let negative = ((at * DRAWS + draw) as u32).wrapping_mul(2_654_435_769) >> 31 == 1;
            let sign = if negative { -1.0 } else { 1.0 };
            let mut piece = blocks[(at + 1 + draw * (n - 1) / DRAWS) % n].pieces[c].clone();
            if own_transfer {
                let mut light = Basis::default();
                light.add(vec![1.0; piece.len()], 0.0);
                light.add(block.grey.clone(), 1e-3);
                for part in &light.parts {
                    let along = dot(part, &piece) as f32;
                    piece.iter_mut().zip(part).for_each(|(v, part)| *v -= along * part);
                }
                taken += 1.0 - dot(&piece, &piece);
            }
            whole += 1.0;
            let nodes = mesh.elements()[block.element];
            for (k, psi) in block.psi.iter().enumerate() {
                for (&node, &psi) in nodes.iter().zip(psi) {
                    for (b, gradient) in b[node as usize].iter_mut().zip(gradient) {
                        *b += sign * f64::from(psi * gradient[k] * piece[k]);
                    }
                }
            }
        }
        let a = solver.solve(b.clone());
        let product = |u: &[[f64; 2]], v: &[[f64; 2]]| -> f64 {
            u.as_flattened().iter().zip(v.as_flattened()).map(|(u, v)| u * v).sum()
        };
        solver.matrix().held().iter().for_each(|&node| b[node as usize] = [0.0; 2]);
        taken += 2.0 * product(&b, &a) - product(&a, &solver.data().multiply(&a));
    }
    (1.0 - taken / whole).clamp(0.05, 1.0)
}

fn own_transfer(reference: &[f32], deformed: &[f32]) -> (f64, f64) {
    let n = reference.len() as f64;
    let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
        reference.iter().zip(deformed).map(|(&f, &g)| of(f64::from(f), f64::from(g))).sum::<f64>() / n
    };
    let (f, g) = (sum(&|f, _| f), sum(&|_, g| g));
    let (fg, gg) = (sum(&|a, b| (a - f) * (b - g)), sum(&|_, b| (b - g).powi(2)));
    let gain = if gg > 0.0 && fg > 0.0 { fg / gg } else { 1.0 };
    (gain, f - gain * g)
}

/// Of a square of values, at lags up to [`LAGS`] in both directions, row by row, the lags of a row side by side; beyond
/// the square there are zeros. A lag and its opposite have the same products.
fn autocorrelation(values: &[f32], side: usize) -> Lags {
    let stride = side + 2 * LAGS;
    let mut padded = vec![0.0; side * stride];
    for (row, values) in padded.chunks_exact_mut(stride).zip(values.chunks_exact(side)) {
        row[LAGS..][..side].iter_mut().zip(values).for_each(|(to, &value)| *to = f64::from(value));
    }
    let mut lags = [0.0; WIDTH * WIDTH];
    for dy in 0..=LAGS {
        let mut sums = [0.0; WIDTH];
        for y in 0..side.saturating_sub(dy) {
            let (here, there) = (&padded[y * stride + LAGS..][..side], &padded[(y + dy) * stride..][..stride]);
            for (here, there) in here.iter().zip(there.array_windows::<WIDTH>()) {
                for k in 0..WIDTH {
                    sums[k] += here * there[k];
                }
            }
        }
        for (k, sum) in sums.into_iter().enumerate() {
            lags[(LAGS + dy) * WIDTH + k] = sum;
            lags[(LAGS - dy) * WIDTH + (WIDTH - 1 - k)] = sum;
        }
    }
    lags
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    let n = a.len() - a.len() % 8;
    let rest: f32 = a[n..].iter().zip(&b[n..]).map(|(a, b)| a * b).sum();
    strands(a, b).iter().map(|&sum| f64::from(sum)).sum::<f64>() + f64::from(rest)
}

/// The strands alone. Not inlined: beside their sum the compiler would not keep them in whole vectors.
#[inline(never)]
fn strands(a: &[f32], b: &[f32]) -> [f32; 8] {
    let mut strands = [0.0f32; 8];
    for (a, b) in a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0) {
        for k in 0..8 {
            strands[k] += a[k] * b[k];
        }
    }
    strands
}
