//! The gradient of the reference at its pixels.

use super::plane::{Plane, Pool, View};
use crate::backend::BackendError;
use crate::backend::spline::at_pixel;
use crate::imaging::Interpolation;
use crate::isa::{Isa, mul_add, multiversioned};
use rayon::prelude::*;

/// Gradient at the pixels of the spline with these coefficients: d/dx and d/dy, grey levels per px.
pub(super) fn gradient(
    pool: &Pool,
    isa: Isa,
    coefficients: &Plane,
    interpolation: Interpolation,
) -> Result<(Plane, Plane), BackendError> {
    let (width, height) = (coefficients.width, coefficients.height);
    let (mut fx, mut fy) = (pool.plane(width, height)?, pool.plane(width, height)?);
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
                gradient_row(isa, c, y, &value, &derivative, smooth, slope, fx, fy);
            },
        );
    Ok((fx, fy))
}

multiversioned! {
    fn gradient_row[][](c: View<'_>, y: usize, value: &[f32; 5], derivative: &[f32; 5], smooth: &mut [f32], slope: &mut [f32], fx: &mut [f32], fy: &mut [f32])
        => gradient_row_body
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "kernels take their operands one by one, so that they stay in registers")]
fn gradient_row_body<const FMA: bool>(
    c: View<'_>,
    y: usize,
    value: &[f32; 5],
    derivative: &[f32; 5],
    smooth: &mut [f32],
    slope: &mut [f32],
    fx: &mut [f32],
    fy: &mut [f32],
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
        fx[x] = gx;
        fy[x] = gy;
    }
}
