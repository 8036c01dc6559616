//! A piece of an image with its interpolation, on the host, without the coefficients of the whole image.

use crate::backend::{at_pixel, taps};
use crate::imaging::{Image, Interpolation, Levels};

/// Samples beside the piece from which its coefficients are made: poles of 0.27 and 0.43 forget what lies further to
/// below 3e-5.
const SETTLED: isize = 8;
/// Pixels beside the piece that interpolation reaches.
const REACH: isize = 3;

/// Coefficients of a piece of an image, column after column: both passes of the filter run over whole rows of memory.
pub(crate) struct Patch {
    interpolation: Interpolation,
    corner: [isize; 2],
    height: usize,
    coefficients: Vec<f32>,
}

impl Patch {
    /// The piece of `image`, less `offset`, from `low` to `high` px; beyond the image `s(-k) = 2 s(0) - s(k)`.
    pub fn new(image: &Image, offset: f32, low: [isize; 2], high: [isize; 2], interpolation: Interpolation) -> Self {
        let poles = interpolation.poles();
        let margin = if poles.is_empty() { REACH } else { REACH + SETTLED };
        let corner = low.map(|v| v - margin);
        let [width, height] = [0, 1].map(|c| (high[c] - low[c] + 2 * margin + 1).max(1) as usize);
        let (columns, rows) = (image.width() as isize, image.height() as isize);
        let within = corner[0] >= 0 && corner[0] + width as isize <= columns;
        let columns: Vec<Through> = (0..width).map(|k| Through::of(corner[0] + k as isize, columns)).collect();
        let mut coefficients = Vec::with_capacity(width * height);
        for k in 0..height {
            let row = Through::of(corner[1] + k as isize, rows);
            let along = |y: usize| {
                let grey = move |x: usize| image.grey(x, y) - offset;
                columns.iter().map(move |column| column.value(grey))
            };
            match row {
                Through::Pixel(y) if within => {
                    let at = y * image.width() + corner[0] as usize;
                    match image.pixels() {
                        Levels::U8(p) => coefficients.extend(p[at..][..width].iter().map(|&v| f32::from(v) - offset)),
                        Levels::U16(p) => coefficients.extend(p[at..][..width].iter().map(|&v| f32::from(v) - offset)),
                        Levels::F32(p) => coefficients.extend(p[at..][..width].iter().map(|&v| v - offset)),
                    }
                }
                Through::Pixel(y) => coefficients.extend(along(y)),
                Through::End { end, mirrored } => {
                    coefficients.extend(along(end).zip(along(mirrored)).map(|(end, mirrored)| 2.0 * end - mirrored));
                }
            }
        }
        poles.iter().for_each(|&pole| filter_columns(pole as f32, width, &mut coefficients));
        let mut coefficients = transposed(&coefficients, width);
        poles.iter().for_each(|&pole| filter_columns(pole as f32, height, &mut coefficients));
        Self { interpolation, corner, height, coefficients }
    }

    /// The grey level at a point of the piece, given as a whole pixel and a displacement from it.
    pub fn grey(&self, pixel: [usize; 2], u: [f32; 2]) -> f32 {
        let whole = u.map(f32::floor);
        let [(wx, n), (wy, _)] = [0, 1].map(|c| taps(self.interpolation, u[c] - whole[c]));
        let first = [0, 1].map(|c| pixel[c] as isize + whole[c] as isize - self.corner[c] - (n as isize / 2 - 1));
        let at = first[0] as usize * self.height + first[1] as usize;
        match n {
            2 => self.sum::<2>(at, &wx, &wy),
            4 => self.sum::<4>(at, &wx, &wy),
            _ => self.sum::<6>(at, &wx, &wy),
        }
    }

    /// Weighted sum of K x K coefficients: of the columns first, whose values lie side by side.
    fn sum<const K: usize>(&self, at: usize, wx: &[f32; 6], wy: &[f32; 6]) -> f32 {
        let mut along = [0.0; K];
        for k in 0..K {
            let column = &self.coefficients[at + k * self.height..][..K];
            for l in 0..K {
                along[l] += wx[k] * column[l];
            }
        }
        along.iter().zip(wy).map(|(along, wy)| along * wy).sum()
    }

    /// The gradient at a pixel of the piece, made for [`Interpolation::of_gradient`], as the reference has it.
    pub fn gradient(&self, pixel: [usize; 2]) -> [f32; 2] {
        let (value, slope) = at_pixel(self.interpolation);
        let first = [0, 1].map(|c| (pixel[c] as isize - self.corner[c] - 1) as usize);
        let sum = |along_x: &[f32; 3], along_y: &[f32; 3]| -> f32 {
            let columns = along_x.iter().enumerate().map(|(k, wx)| {
                let at = (first[0] + k) * self.height + first[1];
                wx * self.coefficients[at..at + 3].iter().zip(along_y).map(|(c, wy)| c * wy).sum::<f32>()
            });
            columns.sum()
        };
        [sum(&slope, &value), sum(&value, &slope)]
    }
}

/// Where the sample at a place comes from.
enum Through {
    Pixel(usize),
    End { end: usize, mirrored: usize },
}

impl Through {
    fn of(at: isize, n: isize) -> Self {
        let end = if at < 0 { 0 } else { n - 1 };
        match at {
            at if (0..n).contains(&at) => Self::Pixel(at as usize),
            _ => Self::End { end: end as usize, mirrored: (2 * end - at).clamp(0, n - 1) as usize },
        }
    }

    fn value(&self, grey: impl Fn(usize) -> f32) -> f32 {
        match *self {
            Self::Pixel(at) => grey(at),
            Self::End { end, mirrored } => 2.0 * grey(end) - grey(mirrored),
        }
    }
}

/// The values of a piece, stored by rows, by columns.
fn transposed(values: &[f32], width: usize) -> Vec<f32> {
    let mut by_columns = Vec::with_capacity(values.len());
    (0..width).for_each(|x| by_columns.extend(values[x..].iter().step_by(width)));
    by_columns
}

/// The recursive filter of one pole down all columns at once, there and back (Unser 1999); the margin forgets the ends.
fn filter_columns(pole: f32, width: usize, values: &mut [f32]) {
    let gain = (1.0 - pole) * (1.0 - 1.0 / pole);
    let height = values.len() / width;
    values[..width].iter_mut().for_each(|v| *v *= gain / (1.0 - pole));
    for y in 1..height {
        let (before, row) = values[(y - 1) * width..(y + 1) * width].split_at_mut(width);
        row.iter_mut().zip(before).for_each(|(v, before)| *v = gain * *v + pole * *before);
    }
    values[(height - 1) * width..].iter_mut().for_each(|v| *v *= -pole / (1.0 - pole));
    for y in (0..height - 1).rev() {
        let (row, after) = values[y * width..(y + 2) * width].split_at_mut(width);
        row.iter_mut().zip(after).for_each(|(v, after)| *v = pole * (*after - *v));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Pixels;

    #[test]
    fn grey_levels_and_gradients_are_sums_of_cardinal_functions() {
        let (width, height) = (72, 80);
        let greys = (0..width * height).map(|k| (k * 7919 % 251) as f32).collect();
        let image = Image::new(width, height, Pixels::F32(greys)).unwrap();
        for interpolation in
            [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear]
        {
            let patch = Patch::new(&image, 100.0, [33, 36], [38, 43], interpolation);
            let by = |at: [f64; 2], weight: &dyn Fn(f64) -> f64, other: &dyn Fn(f64) -> f64| -> f64 {
                let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
                pixels
                    .map(|(x, y)| {
                        let weight = weight(at[0] - x as f64) * other(at[1] - y as f64);
                        weight * (f64::from(image.grey(x, y)) - 100.0)
                    })
                    .sum()
            };
            let cardinal = |x: f64| interpolation.cardinal(x);
            for u in [[0.0, 0.0], [0.25, -0.5], [1.9, 2.1]] {
                let want = by([35.0 + u[0], 40.0 + u[1]], &cardinal, &cardinal);
                let got = f64::from(patch.grey([35, 40], u.map(|v| v as f32)));
                // What the filter forgets, 3e-5, of 251 grey levels.
                assert!((got - want).abs() < 0.02, "{interpolation:?} {u:?}: {got} instead of {want}");
            }
            let slope = |x: f64| interpolation.gradient_weight(-x as i32);
            let patch = Patch::new(&image, 100.0, [33, 36], [38, 43], interpolation.of_gradient());
            let got = patch.gradient([35, 40]).map(f64::from);
            let want = [by([35.0, 40.0], &slope, &cardinal), by([35.0, 40.0], &cardinal, &slope)];
            (0..2).for_each(|c| assert!((got[c] - want[c]).abs() < 0.02, "{interpolation:?}: {got:?} {want:?}"));
        }
    }
}
