//! Grey levels between pixels in double precision: the quintic B-spline, one point at a time.

use crate::imaging::{Image, Interpolation};

/// Distance from the border, px, beyond which its continuation is not felt: 0.43 per pixel leaves 4e-5.
const REACH: f64 = 12.0;

/// The spline through the grey levels of an image.
pub(super) struct Spline {
    width: usize,
    height: usize,
    coefficients: Vec<f64>,
}

impl Spline {
    /// The coefficients by the recursive prefilter (Unser 1999).
    pub fn new(image: &Image) -> Self {
        let (width, height) = (image.width(), image.height());
        let mut coefficients: Vec<f64> =
            (0..height).flat_map(|y| (0..width).map(move |x| f64::from(image.grey(x, y)))).collect();
        for &pole in Interpolation::Quintic.poles() {
            for y in 0..height {
                filter(pole, width, |k| y * width + k, &mut coefficients);
            }
            for x in 0..width {
                filter(pole, height, |k| k * width + x, &mut coefficients);
            }
        }
        Self { width, height, coefficients }
    }

    /// The grey level at (x, y) px; `None` near the border and beyond it.
    pub fn grey(&self, x: f64, y: f64) -> Option<f64> {
        let inside = |v: f64, n: usize| v >= REACH && v < n as f64 - 1.0 - REACH;
        if !(inside(x, self.width) && inside(y, self.height)) {
            return None;
        }
        let (wx, wy) = (weights(x.fract()), weights(y.fract()));
        let (column, row) = (x as usize - 2, y as usize - 2);
        let rows = wy.iter().enumerate().map(|(j, wy)| {
            let at = (row + j) * self.width + column;
            let along: f64 = self.coefficients[at..at + 6].iter().zip(wx).map(|(c, wx)| c * wx).sum();
            wy * along
        });
        Some(rows.sum())
    }
}

/// The recursive filter of one pole, there and back, over the `n` values at `place(0..n)`; the end goes on as constant.
fn filter(pole: f64, n: usize, place: impl Fn(usize) -> usize, values: &mut [f64]) {
    let gain = (1.0 - pole) * (1.0 - 1.0 / pole);
    let by_sum = 1.0 / (1.0 - pole);
    values[place(0)] *= gain * by_sum;
    for k in 1..n {
        values[place(k)] = gain * values[place(k)] + pole * values[place(k - 1)];
    }
    values[place(n - 1)] *= -pole * by_sum;
    for k in (0..n - 1).rev() {
        values[place(k)] = pole * (values[place(k + 1)] - values[place(k)]);
    }
}

/// Weights of the coefficients at -2..=3 for a point `t` (0..1) beyond a pixel, by the recursion of de Boor.
fn weights(t: f64) -> [f64; 6] {
    let mut w = [0.0; 6];
    w[0] = 1.0;
    for degree in 1..=5 {
        let by_degree = 1.0 / degree as f64;
        for j in (0..=degree).rev() {
            // The pieces that begin j knots before the one that holds the point.
            let left = if j > 0 { (t + (degree - j) as f64) * w[j - 1] } else { 0.0 };
            let right = if j < degree { (1.0 - t + j as f64) * w[j] } else { 0.0 };
            w[j] = (left + right) * by_degree;
        }
    }
    w
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Pixels;

    #[test]
    fn the_spline_is_the_sum_of_cardinal_functions() {
        let (width, height) = (64, 64);
        let greys = (0..width * height).map(|k| (k * 7919 % 251) as f32).collect();
        let image = Image::new(width, height, Pixels::F32(greys)).unwrap();
        let spline = Spline::new(&image);
        assert_eq!(spline.grey(5.0, 30.0), None);
        for [x, y] in [[30.0, 31.0], [30.25, 31.5], [33.9, 29.1]] {
            let mut want = 0.0;
            for row in 0..height {
                for column in 0..width {
                    let weight = Interpolation::Quintic.cardinal(x - column as f64)
                        * Interpolation::Quintic.cardinal(y - row as f64);
                    want += weight * f64::from(image.grey(column, row));
                }
            }
            // The cardinal function is cut at 30 px and so is the image: 0.43^30 of 251 grey levels.
            assert!((spline.grey(x, y).unwrap() - want).abs() < 1e-6, "({x}, {y})");
        }
    }
}
