//! A picture as a sum of waves, which can be moved by any sub-pixel amount without interpolation.

use crate::imaging::{Image, ImageError, Pixels};
use quadrille_fourier::num_complex::Complex64;
use quadrille_fourier::{Fft, double};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Width of the band along the border in which a picture fades to its mean, px.
pub(super) const FADE: usize = 16;
/// Half side of the square of wave numbers over which a power spectrum is averaged.
const SMOOTH: usize = 8;

/// A picture and its continuation by repetition: a finite sum of waves, defined between the pixels too.
///
/// The border fades to the mean grey level, so that the repetition has no jump and the waves no ringing.
/// Whatever is moved is this sum, and it is moved exactly: a wave changes its phase and nothing else.
pub(super) struct WavePicture {
    width: usize,
    height: usize,
    /// Mean grey level, to which the border fades.
    mean: f64,
    /// Waves, transposed: `spectrum[kx * height + ky]`.
    spectrum: Vec<Complex64>,
    /// The sum at the pixels, less the mean.
    pixels: Vec<f64>,
    fft: Transforms,
}

/// The transforms of rows (`x`) and columns (`y`), there and back.
struct Transforms {
    x: [Arc<dyn Fft<f64>>; 2],
    y: [Arc<dyn Fft<f64>>; 2],
}

/// The weight of pixel `k` of `n`: half a cosine over the first and last `FADE` pixels.
fn fade(k: usize, n: usize) -> f64 {
    let from_border = k.min(n - 1 - k) as f64 + 0.5;
    if from_border >= FADE as f64 { 1.0 } else { 0.5 - 0.5 * (PI * from_border / FADE as f64).cos() }
}

impl WavePicture {
    /// The waves of `image` less the white noise of standard deviation `noise` (grey levels) in it.
    ///
    /// Noise of a picture as recorded would move along with it, as real noise does not, and near the highest wave
    /// numbers bias every interpolation. So the power of each wave is lowered by that of the noise, down to zero: what
    /// is left has the spectrum of the texture, not its exact grey levels.
    pub fn new(image: &Image, noise: f64) -> Self {
        let (width, height) = (image.width(), image.height());
        let fft = Transforms { x: double(width), y: double(height) };
        let weights = |n: usize| -> Vec<f64> { (0..n).map(|k| fade(k, n)).collect() };
        let (by_column, by_row) = (weights(width), weights(height));
        let (mut sum, mut squares) = (0.0, 0.0);
        let weight_sum: f64 = by_column.iter().sum::<f64>() * by_row.iter().sum::<f64>();
        for y in 0..height {
            for x in 0..width {
                let weight = by_column[x] * by_row[y];
                sum += weight * f64::from(image.grey(x, y));
                squares += weight * weight;
            }
        }
        let mean = sum / weight_sum;
        let mut picture = Self { width, height, mean, spectrum: Vec::new(), pixels: vec![0.0; width * height], fft };
        picture.pixels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                *value = by_column[x] * by_row[y] * (f64::from(image.grey(x, y)) - mean);
            }
        });
        picture.spectrum = picture.transform();
        if noise > 0.0 {
            let of_noise = noise * noise * squares;
            let power = picture.smooth_power();
            for (wave, power) in picture.spectrum.iter_mut().zip(power) {
                *wave *= (1.0 - of_noise / power.max(f64::MIN_POSITIVE)).max(0.0).sqrt();
            }
            picture.pixels = picture.back(picture.spectrum.clone());
        }
        picture
    }

    /// White noise that the highest wave numbers of `image` leave room for, grey levels: the median power
    /// beyond 80 % of the Nyquist wave number along both axes. A texture that the camera resolves has
    /// nothing there; sharp or fine speckles have, so the noise is at most this.
    pub fn noise_ceiling(image: &Image) -> f64 {
        let picture = Self::new(image, 0.0);
        let (width, height) = (picture.width, picture.height);
        let high = |k: usize, n: usize| 2 * k.min(n - k) >= n * 4 / 5;
        let squares = |n: usize| (0..n).map(|k| fade(k, n).powi(2)).sum::<f64>();
        let mut powers: Vec<f64> = (0..width * height)
            .filter(|at| high(at / height, width) && high(at % height, height))
            .map(|at| picture.spectrum[at].norm_sqr())
            .collect();
        powers.sort_by(f64::total_cmp);
        let median = powers.get(powers.len() / 2).copied().unwrap_or(0.0);
        // The power of a wave of white noise is exponentially distributed: its median is ln 2 of its mean.
        (median / 2f64.ln() / (squares(width) * squares(height))).sqrt()
    }

    /// The waves of each row of the pixels.
    fn rows(&self) -> Vec<Complex64> {
        let mut rows: Vec<Complex64> = self.pixels.par_iter().map(|&v| Complex64::new(v, 0.0)).collect();
        each_row(&self.fft.x[0], self.width, &mut rows);
        rows
    }

    fn transform(&self) -> Vec<Complex64> {
        let mut columns = transposed(&self.rows(), self.width);
        each_row(&self.fft.y[0], self.height, &mut columns);
        columns
    }

    fn back(&self, mut columns: Vec<Complex64>) -> Vec<f64> {
        each_row(&self.fft.y[1], self.height, &mut columns);
        let mut rows = transposed(&columns, self.height);
        each_row(&self.fft.x[1], self.width, &mut rows);
        let by_n = 1.0 / (self.width * self.height) as f64;
        rows.par_iter().map(|v| v.re * by_n).collect()
    }

    /// Power of each wave, averaged over the neighbours within `SMOOTH` wave numbers along both axes.
    fn smooth_power(&self) -> Vec<f64> {
        let power: Vec<f64> = self.spectrum.iter().map(Complex64::norm_sqr).collect();
        let along_y = running_mean(&power, self.height);
        let turned = transposed(&along_y, self.height);
        transposed(&running_mean(&turned, self.width), self.width)
    }

    /// The picture at rest.
    pub fn at_rest(&self) -> Vec<f32> {
        self.pixels.par_iter().map(|&v| (self.mean + v) as f32).collect()
    }

    /// The picture moved by `u` px: `g(X + u) = f(X)`.
    pub fn moved(&self, u: [f64; 2]) -> Vec<f32> {
        let by_x: Vec<_> = (0..self.width).map(|k| phase(k, self.width, u[0])).collect();
        let by_y: Vec<_> = (0..self.height).map(|k| phase(k, self.height, u[1])).collect();
        let spectrum: Vec<Complex64> = self
            .spectrum
            .par_chunks(self.height)
            .zip(by_x)
            .flat_map_iter(|(column, x)| column.iter().zip(&by_y).map(move |(wave, y)| wave * x * y))
            .collect();
        self.back(spectrum).par_iter().map(|v| (self.mean + v) as f32).collect()
    }

    /// The picture sheared, row y by `u(y)` px along x: each row is a sum of waves, so that this is exact.
    pub fn sheared(&self, u: impl Fn(f64) -> f64 + Sync) -> Vec<f32> {
        let mut rows = self.rows();
        rows.par_chunks_mut(self.width).enumerate().for_each(|(y, row)| {
            let u = u(y as f64);
            for (k, wave) in row.iter_mut().enumerate() {
                *wave *= phase(k, self.width, u);
            }
        });
        each_row(&self.fft.x[1], self.width, &mut rows);
        let by_n = 1.0 / self.width as f64;
        rows.par_iter().map(|v| (self.mean + v.re * by_n) as f32).collect()
    }
}

/// What moving by `u` px does to wave `k` of `n`. At the Nyquist number, without sign, half goes each way: real.
fn phase(k: usize, n: usize, u: f64) -> Complex64 {
    if 2 * k == n {
        return Complex64::new((PI * u).cos(), 0.0);
    }
    let signed = if 2 * k < n { k as f64 } else { k as f64 - n as f64 };
    Complex64::cis(-TAU * signed * u / n as f64)
}

fn each_row(fft: &Arc<dyn Fft<f64>>, length: usize, values: &mut [Complex64]) {
    let scratch = || vec![Complex64::default(); fft.get_inplace_scratch_len()];
    values.par_chunks_mut(length).for_each_init(scratch, |scratch, row| fft.process_with_scratch(row, scratch));
}

/// Rows of `length` values become columns.
fn transposed<T: Copy + Send + Sync>(values: &[T], length: usize) -> Vec<T> {
    let n_rows = values.len() / length;
    (0..length)
        .into_par_iter()
        .flat_map_iter(|column| (0..n_rows).map(move |row| values[row * length + column]))
        .collect()
}

/// Mean over the neighbours within `SMOOTH` places of each row, which closes on itself.
fn running_mean(values: &[f64], length: usize) -> Vec<f64> {
    let reach = SMOOTH.min((length - 1) / 2);
    let by_n = 1.0 / (2 * reach + 1) as f64;
    let mut means = vec![0.0; values.len()];
    means.par_chunks_mut(length).zip(values.par_chunks(length)).for_each(|(means, row)| {
        for (k, mean) in means.iter_mut().enumerate() {
            *mean = (0..=2 * reach).map(|d| row[(k + length + d - reach) % length]).sum::<f64>() * by_n;
        }
    });
    means
}

/// `greys` as an image, with white Gaussian noise of standard deviation `noise` added. Every row has a
/// stream of random numbers of its own, so that the bits do not depend on the number of threads.
pub(super) fn with_noise(greys: &[f32], width: usize, noise: f64, seed: u64) -> Result<Arc<Image>, ImageError> {
    let mut greys = greys.to_vec();
    if noise > 0.0 {
        greys.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            random.set_stream(y as u64);
            for grey in row {
                let normal: f32 = StandardNormal.sample(&mut random);
                *grey += noise as f32 * normal;
            }
        });
    }
    let height = greys.len() / width;
    Ok(Arc::new(Image::new(width, height, Pixels::F32(greys))?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::{Depth, RenderOptions, Texture, Translation, render};

    fn speckles(u: [f64; 2], noise: f32) -> Image {
        let options = RenderOptions { depth: Depth::F32, noise, ..RenderOptions::new(240, 192) };
        render(&Texture::new(5, 4.5).unwrap(), &Translation(u), &options).unwrap()
    }

    /// Root mean square of the difference of two pictures but for the band that fades.
    fn difference(a: &[f32], b: &[f32], width: usize) -> f64 {
        let height = a.len() / width;
        let inside = |k: usize, n: usize| k >= FADE + 2 && k + FADE + 2 < n;
        let pixels = (0..a.len()).filter(|at| inside(at % width, width) && inside(at / width, height));
        let squares: Vec<f64> = pixels.map(|at| f64::from(a[at] - b[at]).powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    fn greys(image: &Image) -> Vec<f32> {
        (0..image.height()).flat_map(|y| (0..image.width()).map(move |x| image.grey(x, y))).collect()
    }

    #[test]
    fn a_moved_picture_is_the_texture_rendered_where_it_has_moved_to() {
        let picture = WavePicture::new(&speckles([0.0; 2], 0.0), 0.0);
        assert!(difference(&picture.at_rest(), &greys(&speckles([0.0; 2], 0.0)), 240) < 1e-4);
        for u in [[1.0, -1.0], [0.5, 0.25], [-0.3, 0.8]] {
            let difference = difference(&picture.moved(u), &greys(&speckles(u, 0.0)), 240);
            // What this texture has beyond the Nyquist wave number, of 40 grey levels rms.
            assert!(difference < 0.1, "{u:?}: {difference}");
        }
    }

    #[test]
    fn a_shear_by_a_constant_is_a_translation() {
        let picture = WavePicture::new(&speckles([0.0; 2], 0.0), 0.0);
        // Round-off of the transforms, and of f32.
        assert!(difference(&picture.sheared(|_| 0.37), &picture.moved([0.37, 0.0]), 240) < 1e-4);
    }

    #[test]
    fn the_noise_is_taken_off_and_the_texture_left() {
        let noisy = speckles([0.0; 2], 2.0);
        let ceiling = WavePicture::noise_ceiling(&noisy);
        // 1/25 of 46 080 waves: 2 % statistical error of the median, and a little texture on top.
        assert!((ceiling / 2.0 - 1.0).abs() < 0.08, "{ceiling}");
        assert!(WavePicture::noise_ceiling(&speckles([0.0; 2], 0.0)) < 0.1);
        // Mean power beyond half the Nyquist wave number, where this texture has next to nothing.
        let power = |picture: &WavePicture| -> f64 {
            let fine = |k: usize, n: usize| 4 * k.min(n - k) > n;
            let waves = picture.spectrum.iter().enumerate();
            let waves = waves.filter(|(at, _)| fine(at / picture.height, 240) || fine(at % picture.height, 192));
            waves.map(|(_, wave)| wave.norm_sqr()).sum()
        };
        let [clean, raw, cleaned] = [(speckles([0.0; 2], 0.0), 0.0), (noisy.clone(), 0.0), (noisy, 2.0)]
            .map(|(image, noise)| power(&WavePicture::new(&image, noise)));
        // The power of neighbouring waves scatters about its mean: some of the noise is left.
        let left = (cleaned - clean) / (raw - clean);
        assert!(left.abs() < 0.1, "{left} of the noise is left");
    }
}
