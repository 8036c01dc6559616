//! Images by another renderer than the program's own: Gaussian spots at random places, evaluated one by one at the
//! place of the material and integrated over each pixel (2 x 2 Gauss points), so that no interpolation is in them; and
//! scenes that spoil them.

use quadrille::imaging::{Image, Pixels};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::sync::Arc;

/// Standard deviation of a spot, px; speckles of some 5 px.
pub const SPOT_PX: f64 = 1.9;
const CELL: f64 = 8.0;
const MEAN: f64 = 120.0;

/// A random pattern of Gaussian spots.
pub struct Spots {
    cells: Vec<Vec<[f64; 3]>>,
    across: i64,
    from: f64,
    width: f64,
}

impl Spots {
    /// A pattern that covers `-margin..side + margin` in both directions, its spots of the standard deviation `width`,
    /// px.
    pub fn new(seed: u64, side: usize, width: f64) -> Self {
        let margin = 48.0;
        let across = ((side as f64 + 2.0 * margin) / CELL).ceil() as i64;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut cells = vec![Vec::new(); (across * across) as usize];
        let extent = across as f64 * CELL;
        for _ in 0..(extent * extent / 14.0) as usize {
            let [x, y] = [0, 1].map(|_| random.random::<f64>() * extent);
            let amplitude: f64 = StandardNormal.sample(&mut random);
            cells[((y / CELL) as i64 * across + (x / CELL) as i64) as usize].push([x, y, amplitude]);
        }
        Self { cells, across, from: -margin, width }
    }

    /// The same pattern out of focus: every spot blurred by a Gaussian of `px`.
    pub fn blurred(&self, px: f64) -> Self {
        let width = self.width.hypot(px);
        let weaker = (self.width / width).powi(2);
        let cells = self.cells.iter().map(|cell| cell.iter().map(|[x, y, a]| [*x, *y, a * weaker]).collect());
        Self { cells: cells.collect(), width, ..*self }
    }

    /// About 0, with a standard deviation of about 1, at a place of the material.
    pub fn at(&self, x: [f64; 2]) -> f64 {
        let p = x.map(|x| x - self.from);
        let [i, j] = p.map(|p| (p / CELL).floor() as i64);
        let inverse = 0.5 / (self.width * self.width);
        let mut sum = 0.0;
        for (k, l) in (-1..=1).flat_map(|l| (-1..=1).map(move |k| (i + k, j + l))) {
            if (0..self.across).contains(&k) && (0..self.across).contains(&l) {
                for [x, y, a] in &self.cells[(l * self.across + k) as usize] {
                    let square = (x - p[0]).powi(2) + (y - p[1]).powi(2);
                    if square * inverse < 8.0 {
                        sum += a * (-square * inverse).exp();
                    }
                }
            }
        }
        // Spots of density 1/14 and variance pi width^2 each.
        sum / (std::f64::consts::PI * SPOT_PX * SPOT_PX / 14.0).sqrt()
    }

    /// Grey level at a place of the material.
    pub fn grey(&self, x: [f64; 2]) -> f64 {
        MEAN + 38.0 * self.at(x)
    }
}

/// Grey levels of `side` x `side` px of what `grey` shows at places of the image, integrated over each pixel.
pub fn rendered(side: usize, grey: impl Fn([f64; 2]) -> f64 + Sync) -> Vec<f64> {
    use rayon::prelude::*;
    let offset = 0.5 / 3f64.sqrt();
    let of_pixel = |k: usize| {
        let [x, y] = [(k % side) as f64, (k / side) as f64];
        let points = [[-offset, -offset], [offset, -offset], [-offset, offset], [offset, offset]];
        points.iter().map(|[dx, dy]| grey([x + dx, y + dy])).sum::<f64>() / 4.0
    };
    (0..side * side).into_par_iter().map(of_pixel).collect()
}

/// An 8-bit image of them, with white noise.
pub fn photographed(side: usize, noise: f64, seed: u64, grey: impl Fn([f64; 2]) -> f64 + Sync) -> Arc<Image> {
    let exact = rendered(side, grey);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let pixels = exact.into_iter().map(|grey| {
        let normal: f64 = StandardNormal.sample(&mut random);
        (grey + noise * normal).round().clamp(0.0, 255.0) as u8
    });
    Arc::new(Image::new(side, side, Pixels::U8(pixels.collect())).unwrap())
}

/// An affine motion, whose inverse is exact: `u = shift + gradient (x - centre)`.
#[derive(Debug, Clone, Copy)]
pub struct AffineMotion {
    pub shift: [f64; 2],
    pub gradient: [[f64; 2]; 2],
    pub centre: f64,
}

impl AffineMotion {
    pub fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        let d = x.map(|x| x - self.centre);
        [0, 1].map(|c| self.shift[c] + self.gradient[c][0] * d[0] + self.gradient[c][1] * d[1])
    }

    /// The material that is at `y`.
    pub fn material(&self, y: [f64; 2]) -> [f64; 2] {
        let g = self.gradient;
        let d = [0, 1].map(|c| y[c] - self.centre - self.shift[c]);
        let m = [[1.0 + g[0][0], g[0][1]], [g[1][0], 1.0 + g[1][1]]];
        let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
        let x = [(m[1][1] * d[0] - m[0][1] * d[1]) / determinant, (m[0][0] * d[1] - m[1][0] * d[0]) / determinant];
        x.map(|x| x + self.centre)
    }
}
