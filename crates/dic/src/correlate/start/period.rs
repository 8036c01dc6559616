//! Textures that repeat: the shifts at which a reference looks like itself, and what is said of a displacement then.

use crate::imaging::Image;
use crate::mesh::PixelSet;
use quadrille_fourier::num_complex::Complex32;
use quadrille_fourier::{Fft, single};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

/// Longest side of the window that is compared with itself, px.
const WINDOW: usize = 256;
/// Its side is a multiple of this, as transforms like it.
const STEP: usize = 32;
/// A shift counts when the correlation coefficient there is at least this,
const LIKE: f32 = 0.5;
/// this much above what it falls to on the way,
const ABOVE: f32 = 0.15;
/// and at least this share of that of the best shift.
const AMONG: f32 = 0.85;
/// Shares of the window that must overlap.
const OVERLAP: f32 = 0.25;

/// A displacement that the images tell but for multiples of a period.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ambiguity {
    /// Name of the zone.
    pub zone: String,
    /// Length of the shortest period, px.
    pub period_px: f64,
    /// The periods, px along x and y: moved by any of these, the reference matches the deformed image as well.
    pub vectors_px: Vec<[f64; 2]>,
    /// Correlation coefficient at the displacement given.
    pub correlation: f64,
    /// and the best of the displacements that are a period off.
    pub correlation_beside: f64,
    /// Mean distance of the displacement from the one that was expected, px.
    pub from_expected_px: f64,
    /// Whether that is below a third of the period: of all that match it is clearly the nearest to expectation.
    pub confirmed: bool,
    /// Whether the frames before were what it was expected from; rest else.
    pub from_series: bool,
}

impl fmt::Display for Ambiguity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { zone, period_px, from_expected_px, from_series, .. } = self;
        let from = if *from_series { "what the frames before lead to" } else { "rest" };
        write!(
            f,
            "zone {zone}: the texture repeats every {period_px:.1} px: the displacement is known only up to multiples of that; "
        )?;
        if self.confirmed {
            return write!(f, "the one given is the nearest to {from} ({from_expected_px:.1} px away)");
        }
        write!(
            f,
            "the nearest to {from} is {from_expected_px:.1} px away, too far to tell it from others: give images between \
             these, less than {:.1} px apart, or mark the specimen with a texture that does not repeat",
            period_px / 3.0
        )
    }
}

/// The shifts, px, at which a zone of the reference looks like itself: the shortest, and the shortest in another
/// direction; none of a texture that does not repeat. What they mean for a frame the correlation has to say.
pub(crate) fn periods(image: &Image, zone: &PixelSet) -> Vec<[f64; 2]> {
    let Some([x0, y0, x1, y1]) = zone.bounds() else { return Vec::new() };
    let longest = (x1 - x0).max(y1 - y0);
    // In the middle at full resolution; then all of it, halved until it fits.
    let middle = |a: usize, b: usize| (a + b).saturating_sub(WINDOW) / 2;
    let first =
        [if x1 - x0 > WINDOW { middle(x0, x1) } else { x0 }, if y1 - y0 > WINDOW { middle(y0, y1) } else { y0 }];
    let fine = repeats(image, zone, first, 1, longest.min(WINDOW).next_multiple_of(STEP));
    if !fine.is_empty() || longest <= WINDOW {
        return fine;
    }
    repeats(image, zone, [x0, y0], longest.div_ceil(WINDOW), WINDOW)
}

/// The shifts of the window from `first` on, one pixel of which is `step x step` of the image.
fn repeats(image: &Image, zone: &PixelSet, first: [usize; 2], step: usize, window: usize) -> Vec<[f64; 2]> {
    let side = 2 * window;
    let mut pixels = vec![(0.0f32, 0.0f32); window * window];
    pixels.par_iter_mut().enumerate().with_min_len(window).for_each(|(at, pixel)| {
        let [x, y] = [first[0] + step * (at % window), first[1] + step * (at / window)];
        let (mut sum, mut n) = (0.0f32, 0.0f32);
        for v in (y..y + step).take_while(|v| *v < image.height()) {
            for u in (x..x + step).take_while(|u| *u < image.width()) {
                if zone.contains(u, v) {
                    sum += image.grey(u, v);
                    n += 1.0;
                }
            }
        }
        if 2.0 * n > (step * step) as f32 {
            *pixel = (sum / n, 1.0);
        }
    });
    let count: f32 = pixels.iter().map(|p| p.1).sum();
    if count < 32.0 * 32.0 {
        return Vec::new();
    }
    let mean = pixels.iter().map(|p| p.0).sum::<f32>() / count;
    let [forward, inverse] = single(side);
    let spread = |value: &dyn Fn(f32, f32) -> Complex32| {
        let mut out = vec![Complex32::default(); side * side];
        for (at, &(grey, inside)) in pixels.iter().enumerate() {
            out[at / window * side + at % window] = value((grey - mean) * inside, inside);
        }
        transform(&mut out, side, &forward);
        out
    };
    let (grey, (inside, square)) = rayon::join(
        || spread(&|f, _| f.into()),
        || rayon::join(|| spread(&|_, m| m.into()), || spread(&|f, _| (f * f).into())),
    );
    // Two real results in one transform: products and overlaps.
    let unit = Complex32::new(0.0, 1.0);
    let mut products: Vec<Complex32> =
        grey.iter().zip(&inside).map(|(f, m)| Complex32::from(f.norm_sqr()) + unit * m.norm_sqr()).collect();
    let mut powers: Vec<Complex32> = square.iter().zip(&inside).map(|(q, m)| q.conj() * m).collect();
    rayon::join(|| transform(&mut products, side, &inverse), || transform(&mut powers, side, &inverse));
    let whole = products[0].im;
    let like = |dx: isize, dy: isize| -> Option<f32> {
        let index =
            |dx: isize, dy: isize| dy.rem_euclid(side as isize) as usize * side + dx.rem_euclid(side as isize) as usize;
        let at = products[index(dx, dy)];
        let power = powers[index(dx, dy)].re * powers[index(-dx, -dy)].re;
        (at.im > OVERLAP * whole && power > 0.0).then(|| at.re / power.sqrt())
    };
    let reach = window as isize - 1;
    let of_row = |dy: isize| {
        let mut found: Vec<(f64, [f64; 2], f32)> = Vec::new();
        for dx in -reach + 1..reach {
            if dx * dx + dy * dy < 4 || (dy == 0 && dx < 0) {
                continue;
            }
            let Some(here) = like(dx, dy).filter(|here| *here >= LIKE) else { continue };
            let around = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
            if around.iter().any(|(x, y)| like(dx + x, dy + y).is_some_and(|v| v > here)) {
                continue;
            }
            // A slope, as of a shaded image, has bumps but no valleys.
            let on_the_way = |t: f32| like((dx as f32 * t).round() as isize, (dy as f32 * t).round() as isize);
            let lowest = (1..10).filter_map(|k| on_the_way(0.1 * k as f32)).fold(1.0f32, f32::min);
            if lowest > here - ABOVE {
                continue;
            }
            let top = |before: Option<f32>, after: Option<f32>| match (before, after) {
                (Some(a), Some(b)) if a + b < 2.0 * here => f64::from(0.5 * (a - b) / (a - 2.0 * here + b)),
                _ => 0.0,
            };
            let shift = [
                dx as f64 + top(like(dx - 1, dy), like(dx + 1, dy)),
                dy as f64 + top(like(dx, dy - 1), like(dx, dy + 1)),
            ];
            found.push((shift[0].hypot(shift[1]), shift.map(|v| v * step as f64), here));
        }
        found
    };
    let mut found = (0..reach).into_par_iter().map(of_row).collect::<Vec<_>>().concat();
    let best = found.iter().map(|found| found.2).fold(0.0, f32::max);
    found.retain(|found| found.2 >= AMONG * best);
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(_, first, _)) = found.first() else { return Vec::new() };
    let across =
        |v: &[f64; 2]| (first[0] * v[1] - first[1] * v[0]).abs() > 0.3 * first[0].hypot(first[1]) * v[0].hypot(v[1]);
    let second = found.iter().map(|found| found.1).find(across);
    [Some(first), second].into_iter().flatten().collect()
}

/// Two-dimensional transform in place: rows, then columns as rows of the transpose, twice.
fn transform(values: &mut [Complex32], side: usize, fft: &Arc<dyn Fft<f32>>) {
    /// Rows that are transformed one after the other.
    const ROWS: usize = 32;
    for _ in 0..2 {
        values.par_chunks_mut(ROWS * side).for_each(|rows| fft.process(rows));
        transpose(values, side);
    }
}

/// The transpose of a square in place, tile by tile: a column of a power of two of rows has one place in a small cache.
pub(crate) fn transpose(values: &mut [Complex32], side: usize) {
    /// Side of a tile, numbers of 8 bytes: a row of it is a line of the cache.
    const TILE: usize = 8;
    for v in (0..side).step_by(TILE) {
        for u in (0..=v).step_by(TILE) {
            for y in v..(v + TILE).min(side) {
                for x in u..(u + TILE).min(y) {
                    values.swap(y * side + x, x * side + y);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Pixels;

    fn drawn(grey: impl Fn(f64, f64) -> f64) -> Image {
        const SIDE: usize = 300;
        let pixels = (0..SIDE * SIDE).map(|k| grey((k % SIDE) as f64, (k / SIDE) as f64) as f32).collect();
        Image::new(SIDE, SIDE, Pixels::F32(pixels)).unwrap()
    }

    const ZONE: PixelSet = PixelSet::Box { x0: 10, y0: 10, x1: 290, y1: 290 };

    #[test]
    fn a_grid_repeats_by_its_period_and_a_shaded_noise_by_none() {
        let grid = drawn(|x, y| (x * std::f64::consts::TAU / 17.3).cos() + (y * std::f64::consts::TAU / 23.0).cos());
        let found = periods(&grid, &ZONE);
        assert_eq!(found.len(), 2, "{found:?}");
        // A parabola through three values of a cosine is off by some hundredths.
        assert!((found[0][0].abs() - 17.3).abs() < 0.1 && found[0][1].abs() < 0.1, "{found:?}");
        assert!((found[1][1] - 23.0).abs() < 0.1 && found[1][0].abs() < 0.1, "{found:?}");
        let mut state = 1u64;
        let noise: Vec<f64> = (0..90_000)
            .map(|_| {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                (state >> 40) as f64 / 65536.0
            })
            .collect();
        let shaded = drawn(|x, y| noise[(y * 300.0 + x) as usize] + 3.0 * x);
        assert_eq!(periods(&shaded, &ZONE), Vec::<[f64; 2]>::new());
    }
}
