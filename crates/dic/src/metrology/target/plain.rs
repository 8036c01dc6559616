//! Grey levels of an image, to be looked at in several scales.

use crate::imaging::Image;
use crate::plane::Point;

/// Grey levels row by row.
pub(super) struct Plain {
    pub width: usize,
    pub height: usize,
    pub grey: Vec<f32>,
}

impl Plain {
    pub fn of(image: &Image) -> Self {
        let pixels = image.pixels();
        let mut grey = pixels.floats(0..pixels.len());
        // What is no number is no place of a target either.
        grey.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = 0.0);
        Self { width: image.width(), height: image.height(), grey }
    }

    /// Half as wide and high: means of four pixels.
    pub fn halved(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let at = |x: usize, y: usize| self.grey[y.min(self.height - 1) * self.width + x.min(self.width - 1)];
        let mean = |k: usize| {
            let (x, y) = (2 * (k % width), 2 * (k / width));
            0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1))
        };
        Self { width, height, grey: (0..width * height).map(mean).collect() }
    }

    /// Blurred by a Gaussian.
    pub fn blurred(&self, sigma: f32) -> Self {
        let reach = (3.0 * sigma).ceil() as usize;
        let weights: Vec<f32> = (0..=reach).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect();
        let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f32>();
        let weights: Vec<f32> = weights.into_iter().map(|w| w / sum).collect();
        let (width, height) = (self.width, self.height);
        let along = |grey: &[f32], n: usize, step: usize, start: usize, out: &mut dyn FnMut(usize, f32)| {
            for k in 0..n {
                let at = |k: usize| grey[start + step * k];
                let mut sum = weights[0] * at(k);
                for (far, weight) in weights.iter().enumerate().skip(1) {
                    sum += weight * (at(k.saturating_sub(far)) + at((k + far).min(n - 1)));
                }
                out(start + step * k, sum);
            }
        };
        let mut rows = vec![0.0; self.grey.len()];
        (0..height).for_each(|y| along(&self.grey, width, 1, y * width, &mut |at, v| rows[at] = v));
        let mut grey = vec![0.0; rows.len()];
        (0..width).for_each(|x| along(&rows, height, width, x, &mut |at, v| grey[at] = v));
        Self { width, height, grey }
    }

    /// Between pixels; nothing outside.
    pub fn between(&self, [x, y]: Point) -> Option<f32> {
        let inside = x >= 0.0 && y >= 0.0 && x <= (self.width - 1) as f64 && y <= (self.height - 1) as f64;
        if !inside {
            return None;
        }
        let (i, j) = (x as usize, y as usize);
        let (a, b) = ((x - i as f64) as f32, (y - j as f64) as f32);
        let at = |i: usize, j: usize| self.grey[j.min(self.height - 1) * self.width + i.min(self.width - 1)];
        let upper = (1.0 - a) * at(i, j) + a * at(i + 1, j);
        let lower = (1.0 - a) * at(i, j + 1) + a * at(i + 1, j + 1);
        Some((1.0 - b) * upper + b * lower)
    }

    /// Columns and rows of a square about a place, cut at the border.
    pub fn window(&self, [x, y]: Point, reach: f64) -> impl Iterator<Item = (usize, usize)> {
        let ends = |v: f64, n: usize| {
            let (low, high) = ((v - reach).ceil().max(0.0) as usize, (v + reach).floor().max(-1.0) + 1.0);
            low..(high as usize).min(n)
        };
        let (columns, rows) = (ends(x, self.width), ends(y, self.height));
        rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
    }

    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.grey[y * self.width + x]
    }
}
