//! The gradient of the reference at its pixels.

use super::plane::{Plane, Pool, View};
use crate::backend::BackendError;
use crate::backend::spline::at_pixel;
use crate::imaging::Interpolation;
use crate::isa::{Isa, mul_add, multiversioned};
use rayon::prelude::*;

/// Gradient of a reference at its pixels, in whole `unit`s of grey levels per px: 16 bits are half the bytes of `f32` that every
/// pass over the pixels reads, and as many digits as a gradient has (see [`KernelOptions`](crate::backend::KernelOptions)).
#[derive(Debug)]
pub(super) struct Gradient {
    pub x: Plane<i16>,
    pub y: Plane<i16>,
    pub unit: f32,
}

/// Added to a number below 2^22, it leaves the nearest whole one in the low bits of the sum. Twin: shaders/gradient.wgsl.
const NEAREST: f32 = 12_582_912.0; // 1.5 * 2^23

impl Gradient {
    /// Of the spline with these coefficients.
    pub fn of(
        pool: &Pool,
        isa: Isa,
        coefficients: &Plane,
        interpolation: Interpolation,
        unit: f32,
    ) -> Result<Self, BackendError> {
        let (width, height) = (coefficients.width, coefficients.height);
        let (mut fx, mut fy) = (pool.plane::<i16>(width, height)?, pool.plane::<i16>(width, height)?);
        let (stride, first, c) = (fx.stride, fx.at(0, 0), coefficients.view());
        let (value, derivative) = at_pixel(interpolation);
        fx.data_mut()[first..]
            .par_chunks_mut(stride)
            .take(height)
            .with_min_len(16)
            .zip(fy.data_mut()[first..].par_chunks_mut(stride))
            .enumerate()
            .for_each_init(
                || (vec![0.0; stride], vec![0.0; stride]),
                |(smooth, slope), (y, (fx, fy))| {
                    gradient_row(isa, c, y, &value, &derivative, 1.0 / unit, smooth, slope, fx, fy);
                },
            );
        Ok(Self { x: fx, y: fy, unit })
    }
}

multiversioned! {
    fn gradient_row[][](c: View<'_>, y: usize, value: &[f32; 5], derivative: &[f32; 5], per_unit: f32, smooth: &mut [f32], slope: &mut [f32], fx: &mut [i16], fy: &mut [i16])
        => gradient_row_body
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "kernels take their operands one by one, so that they stay in registers")]
fn gradient_row_body<const FMA: bool>(
    c: View<'_>,
    y: usize,
    value: &[f32; 5],
    derivative: &[f32; 5],
    per_unit: f32,
    smooth: &mut [f32],
    slope: &mut [f32],
    fx: &mut [i16],
    fy: &mut [i16],
) {
    // Along y first, two pixels beyond both ends, then along x.
    let n = c.width + 4;
    let rows: [&[f32]; 5] = std::array::from_fn(|k| &c.data[c.at(-2, y as isize + k as isize - 2)..][..n]);
    let (smooth, slope) = (&mut smooth[..n], &mut slope[..n]);
    for x in 0..n {
        let (mut v, mut d) = (0.0, 0.0);
        for k in 0..5 {
            v = mul_add::<FMA>(value[k], rows[k][x], v);
            d = mul_add::<FMA>(derivative[k], rows[k][x], d);
        }
        smooth[x] = v;
        slope[x] = d;
    }
    let (fx, fy) = (&mut fx[..c.width], &mut fy[..c.width]);
    for x in 0..c.width {
        let (mut gx, mut gy) = (0.0, 0.0);
        for k in 0..5 {
            gx = mul_add::<FMA>(derivative[k], smooth[x + k], gx);
            gy = mul_add::<FMA>(value[k], slope[x + k], gy);
        }
        fx[x] = whole(per_unit * gx);
        fy[x] = whole(per_unit * gy);
    }
}

/// The nearest whole number.
#[inline(always)]
fn whole(value: f32) -> i16 {
    (value.clamp(-32767.0, 32767.0) + NEAREST).to_bits() as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::KernelOptions;
    use crate::backend::cpu::prefilter::coefficients;
    use crate::field::Brightness;

    const SIZE: usize = 40;
    const INTERPOLATIONS: [Interpolation; 4] =
        [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear];

    /// The gradient along x of an image whose rows are all `row`, grey levels between 0 and 255, in its middle row.
    fn along(row: &[f32], interpolation: Interpolation, unit: f32) -> Vec<f64> {
        let (pool, isa) = (Pool::default(), Isa::detect());
        let image = row.repeat(SIZE);
        let plane = coefficients(&pool, isa, &image, SIZE, SIZE, 0.0, interpolation).unwrap();
        let Gradient { x, .. } = Gradient::of(&pool, isa, &plane, interpolation, unit).unwrap();
        let at = x.at(0, SIZE as isize / 2);
        x.data()[at..at + SIZE].iter().map(|whole| f64::from(*whole) * f64::from(unit)).collect()
    }

    #[test]
    fn no_image_is_too_steep_for_the_unit_of_its_gradients_and_what_is_ends_at_the_largest() {
        for interpolation in INTERPOLATIONS {
            let KernelOptions { gradient_unit: unit, .. } =
                KernelOptions::new((0.0, 255.0), interpolation, Brightness::Zone);
            // What each white column does to each pixel.
            let white =
                |column: usize| (0..SIZE).map(move |x| if x == column { 255.0 } else { 0.0 }).collect::<Vec<f32>>();
            let by: Vec<Vec<f64>> = (0..SIZE).map(|column| along(&white(column), interpolation, unit)).collect();
            for pixel in 0..SIZE {
                // The image that is steepest there: white wherever that makes it steeper.
                let steepest: f64 = by.iter().map(|of| of[pixel].max(0.0)).sum();
                let border = !(2..SIZE - 2).contains(&pixel);
                assert!(steepest < if border { 2.16 } else { 1.5 } * 255.0, "{interpolation:?}, {pixel}: {steepest}");
                let row: Vec<f32> = by.iter().map(|of| if of[pixel] > 0.0 { 255.0 } else { 0.0 }).collect();
                let got = along(&row, interpolation, unit)[pixel];
                // Each of the 40 columns was rounded by half a unit.
                let want = steepest.min(32_767.0 * f64::from(unit));
                assert!((got - want).abs() <= 20.5 * f64::from(unit), "{interpolation:?}, {pixel}: {got} for {want}");
            }
        }
    }

    #[test]
    fn a_gradient_is_right_to_half_its_unit_on_every_instruction_path() {
        let image: Vec<f32> = (0..SIZE * SIZE).map(|k| (255.0 * (12.9898 * k as f32).sin().abs()).round()).collect();
        for (interpolation, isa) in
            INTERPOLATIONS.into_iter().flat_map(|of| Isa::available().into_iter().map(move |isa| (of, isa)))
        {
            let (pool, unit) = (Pool::default(), 1.0 / 64.0);
            let plane = coefficients(&pool, isa, &image, SIZE, SIZE, 127.5, interpolation).unwrap();
            let gradient = Gradient::of(&pool, isa, &plane, interpolation, unit).unwrap();
            let (value, derivative) = at_pixel(interpolation);
            let sum = |at: [isize; 2], along_x: [f32; 5], along_y: [f32; 5]| -> f64 {
                let terms = (0..25).map(|k| {
                    let c = plane.data()[plane.at(at[0] + k as isize % 5 - 2, at[1] + k as isize / 5 - 2)];
                    f64::from(along_x[k % 5]) * f64::from(along_y[k / 5]) * f64::from(c)
                });
                terms.sum()
            };
            for at in (0..SIZE * SIZE).map(|k| [k % SIZE, k / SIZE].map(|k| k as isize)) {
                let place = plane.at(at[0], at[1]);
                let got = [&gradient.x, &gradient.y].map(|of| f64::from(unit) * f64::from(of.data()[place]));
                let want = [sum(at, derivative, value), sum(at, value, derivative)];
                // Sums of `f32` products of coefficients up to some thousands, beside half a unit.
                let allowed = 0.5 * f64::from(unit) + 1e-3;
                assert!(
                    (0..2).all(|c| (got[c] - want[c]).abs() <= allowed),
                    "{interpolation:?}, {isa}, {at:?}: {got:?}, {want:?}"
                );
            }
        }
    }
}
