//! Speckle images that owe nothing to quadrille's own renderer: sums of Gaussian spots, drawn where a motion puts them.

use quadrille::imaging::{Image, Pixels};
use std::sync::Arc;

/// Gaussian spots.
#[derive(Clone)]
pub struct Spots {
    /// Centre, and height in grey levels.
    pub at: Vec<([f64; 2], f64)>,
    /// Standard deviation, px.
    pub sigma: f64,
}

/// Numbers evenly spread over 0..1, from a seed (xorshift).
pub fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

impl Spots {
    /// Spots anywhere in the square `-side..2 side`, so that what comes into the image is as speckled as what leaves
    /// it.
    pub fn random(side: usize, sigma: f64, seed: u64) -> Self {
        let mut number = numbers(seed);
        let length = 3.0 * side as f64;
        let n = (length * length / (7.0 * sigma * sigma)) as usize;
        let mut place = || length * number() - side as f64;
        let places: Vec<[f64; 2]> = (0..n).map(|_| [place(), place()]).collect();
        Self { at: places.into_iter().map(|at| (at, 60.0 + 100.0 * number())).collect(), sigma }
    }

    /// A square lattice of equal spots.
    pub fn lattice(side: usize, sigma: f64, period: f64) -> Self {
        let n = (side as f64 / period).ceil() as i64 + 1;
        let place = |k: i64| k as f64 * period + 3.3;
        let at = (-n..2 * n).flat_map(|i| (-n..2 * n).map(move |j| ([place(i), place(j)], 150.0))).collect();
        Self { at, sigma }
    }

    /// The image of the spots where `motion` puts them, 8 bit, with noise of `noise` grey levels.
    pub fn image(
        &self,
        [width, height]: [usize; 2],
        noise: f64,
        seed: u64,
        motion: impl Fn([f64; 2]) -> [f64; 2],
    ) -> Arc<Image> {
        let mut grey = vec![40.0f64; width * height];
        let reach = 5.0 * self.sigma;
        for (at, high) in &self.at {
            let [x, y] = motion(*at);
            let range =
                |v: f64, n: usize| ((v - reach).ceil().max(0.0) as usize)..((v + reach).max(-1.0) as usize + 1).min(n);
            if x < -reach || y < -reach {
                continue;
            }
            for row in range(y, height) {
                for column in range(x, width) {
                    let r2 = (column as f64 - x).powi(2) + (row as f64 - y).powi(2);
                    grey[row * width + column] += high * (-0.5 * r2 / (self.sigma * self.sigma)).exp();
                }
            }
        }
        let mut number = numbers(seed);
        let mut normal = || (0..12).map(|_| number()).sum::<f64>() - 6.0;
        let pixels = grey.iter().map(|g| (g + noise * normal()).round().clamp(0.0, 255.0) as u8).collect();
        Arc::new(Image::new(width, height, Pixels::U8(pixels)).unwrap())
    }
}

/// Rotation by `degrees` about `centre`, then `shift`.
pub fn moved(degrees: f64, centre: [f64; 2], shift: [f64; 2]) -> impl Fn([f64; 2]) -> [f64; 2] + Copy {
    let (sin, cos) = degrees.to_radians().sin_cos();
    move |x| {
        let d = [x[0] - centre[0], x[1] - centre[1]];
        [centre[0] + shift[0] + cos * d[0] - sin * d[1], centre[1] + shift[1] + sin * d[0] + cos * d[1]]
    }
}
