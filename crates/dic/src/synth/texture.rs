//! The speckle pattern: a grey level at every point of the plane.

use super::SynthError;
use super::kernel::{Blob, Constants, Patch};
use std::f64::consts::PI;

/// Mean grey level of the texture, on the 0..255 scale.
const MEAN: f64 = 120.0;
/// Grey levels lie within `MEAN - SPAN .. MEAN + SPAN`: they never clip.
const SPAN: f64 = 112.0;
/// Grey levels per unit of the blob sum where it is small; gives a standard deviation of 40.
const GAIN: f64 = 47.0;
/// Mean square of a blob's amplitude, whose magnitude is uniform in `0.75..1.25`.
const MEAN_SQUARE_AMPLITUDE: f64 = (1.25 * 1.25 * 1.25 - 0.75 * 0.75 * 0.75) / 1.5;

/// An analytic speckle pattern `F(X)` in grey levels of the 0..255 scale, defined on the whole plane.
///
/// One blob `a (1 - r^2/R^2)^8` (exactly zero beyond `R`; seven continuous derivatives) lies in each square cell;
/// place, sign and height are hashed from seed and cell. The sum `z` has unit variance and becomes the grey level
/// `120 + 47 z / sqrt(1 + (47 z / 112)^2)`: mean 120, standard deviation about 40, never outside 8..232.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    seed: u64,
    /// Side of a cell: whole pixels, so that a shift by whole pixels changes no rounding.
    cell: i64,
    /// Radius of a blob, px.
    radius: f64,
    /// Height of a blob of amplitude one.
    height: f64,
    /// Positions are multiples of `2^-shift` px when they are rounded for the kernel.
    shift: i32,
}

impl Texture {
    /// The texture of `seed` with speckles of mean size `speckle_px` (2 to 32 px; 4 to 5 is usual).
    ///
    /// The size is the full width at half maximum of one blob; the autocorrelation is `sqrt(2)` times wider. The rms of
    /// each gradient component is about `67 / speckle_px` grey levels per pixel (15 at 4.5 px).
    ///
    /// # Errors
    /// [`SynthError::Speckle`] for a size outside 2..=32 px.
    pub fn new(seed: u64, speckle_px: f64) -> Result<Self, SynthError> {
        if !(2.0..=32.0).contains(&speckle_px) {
            return Err(SynthError::Speckle(speckle_px));
        }
        // (1 - r^2/R^2)^8 = 1/2 at r = R sqrt(1 - 2^(-1/8)).
        let radius = 0.5 * speckle_px / (1.0 - 0.5_f64.powf(0.125)).sqrt();
        let cell = (0.9 * speckle_px).round().max(2.0);
        // Variance of the sum: mean square of a, times integral of (1 - r^2/R^2)^16 per cell.
        let variance = MEAN_SQUARE_AMPLITUDE * PI * radius * radius / (17.0 * cell * cell);
        let shift = 24 - (speckle_px / 6.0).log2().ceil().max(0.0) as i32;
        Ok(Self { seed, cell: cell as i64, radius, height: 1.0 / variance.sqrt(), shift })
    }

    /// The grey level at the point `x` of the plane, in double precision.
    ///
    /// Rendering evaluates the same function in single precision, within 1e-4 grey levels.
    pub fn value(&self, x: [f64; 2]) -> f64 {
        let first = x.map(|x| self.cell_of(x - self.radius));
        let last = x.map(|x| self.cell_of(x + self.radius));
        let whole = x.map(f64::floor);
        let mut sum = 0.0;
        for row in first[1]..=last[1] {
            for column in first[0]..=last[0] {
                let (place, amplitude) = self.blob(column, row);
                let corner = [column, row].map(|k| k as f64 * self.cell as f64);
                let [dx, dy] = [0, 1].map(|k| (whole[k] - corner[k]) + (x[k] - whole[k] - place[k]));
                let rest = (1.0 - (dx * dx + dy * dy) / (self.radius * self.radius)).max(0.0);
                sum += amplitude * rest.powi(8);
            }
        }
        let signal = GAIN * self.height * sum;
        MEAN + signal / (1.0 + (signal / SPAN).powi(2)).sqrt()
    }

    fn cell_of(&self, x: f64) -> i64 {
        // A point at infinity has no neighbours to visit: keep the range of cells small and in range.
        (x / self.cell as f64).floor().clamp(-1e15, 1e15) as i64
    }

    /// Place within its cell (px, multiples of 2^-16) and amplitude of the blob of a cell.
    fn blob(&self, column: i64, row: i64) -> ([f64; 2], f64) {
        let bits = self.hash(column, row);
        let place = [bits & 0xffff, (bits >> 16) & 0xffff].map(|k| k as f64 * self.cell as f64 / 65536.0);
        let size = 0.75 + ((bits >> 32) & 0xffff) as f64 / 131072.0;
        (place, if bits >> 63 == 0 { size } else { -size })
    }

    /// The finaliser of SplitMix64, once per coordinate.
    fn hash(&self, column: i64, row: i64) -> u64 {
        fn mix(z: u64) -> u64 {
            let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        }
        let by_column = mix(self.seed.wrapping_add(0x9e37_79b9_7f4a_7c15) ^ mix(column as u64));
        mix(by_column.wrapping_add((row as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// The blobs that reach into `low..high`, for the kernel; `None` when that is too large for its positions.
    pub(super) fn patch(&self, low: [f64; 2], high: [f64; 2], patch: &mut Patch) -> Option<()> {
        let first = low.map(|x| self.cell_of(x - self.radius));
        let last = high.map(|x| self.cell_of(x + self.radius));
        let n = [0, 1].map(|k| last[k] - first[k] + 1);
        let reach = (1_i64 << (31 - self.shift)) / self.cell;
        if !(low[0] <= high[0] && low[1] <= high[1]) || n[0] >= reach || n[1] >= reach {
            return None;
        }
        patch.origin = first.map(|k| (k * self.cell) as f64);
        patch.n_columns = n[0] as usize;
        patch.n_rows = n[1] as usize;
        patch.blobs.clear();
        let quanta = f64::from(self.shift).exp2();
        let height = GAIN * self.height;
        for row in first[1]..=last[1] {
            for column in first[0]..=last[0] {
                let (place, amplitude) = self.blob(column, row);
                let at = |k: i64, first: i64, place: f64| (((k - first) * self.cell) as f64 + place) * quanta;
                patch.blobs.push(Blob {
                    x: at(column, first[0], place[0]) as i32,
                    y: at(row, first[1], place[1]) as i32,
                    height: (height * amplitude) as f32,
                });
            }
        }
        Some(())
    }

    pub(super) fn constants(&self) -> Constants {
        let quanta = f64::from(self.shift).exp2();
        Constants {
            quanta,
            radius: self.radius * quanta,
            per_cell: 1.0 / (self.cell as f64 * quanta),
            by_radius_2: (self.radius * quanta).powi(-2) as f32,
            mean: MEAN as f32,
            by_span: (1.0 / SPAN) as f32,
        }
    }
}
