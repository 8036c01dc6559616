//! B-spline coefficients of an image: the exact recursive prefilter. Beyond its borders
//! the image is continued through its outermost pixels, `s(-k) = 2 s(0) - s(k)`: value and slope go on,
//! where mirroring would bend every border to slope zero.
//!
//! Rows: sixteen rows are transposed into a band so that the recursion along x runs in sixteen lanes.
//! Columns: strips narrow enough that a strip of the whole height stays in the cache, lanes along x.
//! Both run over the full length from the exact boundary value, so nothing depends on a tiling.

#![allow(unsafe_code, reason = "threads filter disjoint columns of one plane")]

use super::memory::Pool;
use super::plane::Plane;
use crate::backend::BackendError;
use crate::backend::pyramid::Grey;
use crate::backend::spline::causal_start;
use crate::imaging::Interpolation;
use crate::isa::{Isa, mul_add, multiversioned};
use crate::parts;

const BAND: usize = 16;
const STRIP: usize = 32;

/// Coefficients of `grey - offset`, border included.
#[allow(clippy::too_many_arguments, reason = "kernels take their operands one by one, so that they stay in registers")]
pub(super) fn coefficients<G: Grey>(
    pool: &Pool,
    isa: Isa,
    grey: &[G],
    width: usize,
    height: usize,
    offset: f32,
    interpolation: Interpolation,
) -> Result<Plane, BackendError> {
    let mut plane = Plane::new(pool, width, height)?;
    let poles = interpolation.poles();
    let (stride, first) = (plane.stride, plane.at(0, 0));
    let inner = &mut plane.data_mut()[first..];
    let bands = height.div_ceil(BAND);
    let of_rows = inner.chunks_mut(BAND * stride).take(bands).enumerate().collect();
    parts::for_each_init(
        of_rows,
        || vec![[0.0; BAND]; width],
        |band, (k, out)| {
            let rows = &grey[k * BAND * width..((k + 1) * BAND).min(height) * width];
            filter_rows(isa.for_shuffles(), rows, width, offset, poles, band, out, stride);
        },
    );
    let columns = Columns { data: plane.data_mut()[first..].as_mut_ptr(), stride, height };
    let columns = &columns; // as a whole, which may be shared
    let strips = (0..width.div_ceil(STRIP)).collect();
    parts::for_each(strips, |strip: usize| {
        // SAFETY: strips are disjoint columns of the plane, which outlives the loop and is not touched
        // elsewhere meanwhile; a strip past `width` ends at the stride, inside the row.
        unsafe { filter_columns(isa, columns, strip * STRIP, (width - strip * STRIP).min(STRIP), poles) };
    });
    plane.continue_border();
    Ok(plane)
}

multiversioned! {
    fn filter_rows[G: Grey][G](rows: &[G], width: usize, offset: f32, poles: &[f64], band: &mut [[f32; BAND]], out: &mut [f32], stride: usize)
        => filter_rows_body
}

#[inline(always)]
fn filter_rows_body<const FMA: bool, G: Grey>(
    rows: &[G],
    width: usize,
    offset: f32,
    poles: &[f64],
    band: &mut [[f32; BAND]],
    out: &mut [f32],
    stride: usize,
) {
    let n_rows = rows.len() / width;
    let whole = width - width % BAND;
    if n_rows == BAND {
        // Whole 16 x 16 tiles: fixed sizes let the compiler transpose in registers.
        for x in (0..whole).step_by(BAND) {
            let mut tile = [[0.0; BAND]; BAND];
            for (r, tile) in tile.iter_mut().enumerate() {
                let row = &rows[r * width + x..][..BAND];
                for i in 0..BAND {
                    tile[i] = row[i].value() - offset;
                }
            }
            transpose(&tile, &mut band[x..x + BAND]);
        }
    }
    let first = if n_rows == BAND { whole } else { 0 };
    for r in 0..n_rows {
        for x in first..width {
            band[x][r] = rows[r * width + x].value() - offset;
        }
    }
    for &pole in poles {
        recurse::<FMA, BAND>(band, pole);
    }
    if n_rows == BAND {
        for x in (0..whole).step_by(BAND) {
            let mut tile = [[0.0; BAND]; BAND];
            transpose(&band[x..x + BAND], &mut tile);
            for (r, tile) in tile.iter().enumerate() {
                out[r * stride + x..][..BAND].copy_from_slice(tile);
            }
        }
    }
    for r in 0..n_rows {
        for x in first..width {
            out[r * stride + x] = band[x][r];
        }
    }
}

#[inline(always)]
fn transpose(from: &[[f32; BAND]], to: &mut [[f32; BAND]]) {
    // Four passes of a butterfly: each interleaves rows k and k + 8, which is a vector shuffle.
    let mut a: [[f32; BAND]; BAND] = [[0.0; BAND]; BAND];
    a.copy_from_slice(&from[..BAND]);
    for _ in 0..4 {
        let mut b = [[0.0; BAND]; BAND];
        for k in 0..BAND / 2 {
            for i in 0..BAND / 2 {
                b[2 * k][2 * i] = a[k][i];
                b[2 * k][2 * i + 1] = a[k + 8][i];
                b[2 * k + 1][2 * i] = a[k][i + 8];
                b[2 * k + 1][2 * i + 1] = a[k + 8][i + 8];
            }
        }
        a = b;
    }
    to[..BAND].copy_from_slice(&a);
}

/// The recursion for one pole along `line`, `W` independent signals side by side.
#[inline(always)]
fn recurse<const FMA: bool, const W: usize>(line: &mut [[f32; W]], pole: f64) {
    let n = line.len();
    if n < 2 {
        return; // a constant is its own coefficient
    }
    let (z, gain) = (pole as f32, ((1.0 - pole) * (1.0 - 1.0 / pole)) as f32);
    let mut last = [0.0; W];
    for (weight, sample) in causal_start(pole, n).iter().zip(line.iter()) {
        for i in 0..W {
            last[i] = mul_add::<FMA>(*weight, sample[i], last[i]);
        }
    }
    for i in 0..W {
        last[i] *= gain;
    }
    let end = line[n - 1];
    line[0] = last;
    for sample in line[1..].iter_mut() {
        for i in 0..W {
            last[i] = mul_add::<FMA>(z, last[i], gain * sample[i]);
        }
        *sample = last;
    }
    // Continued through its end, the signal keeps its end value under a symmetric filter of gain 1.
    last = end;
    line[n - 1] = last;
    for sample in line[..n - 1].iter_mut().rev() {
        for i in 0..W {
            last[i] = z * (last[i] - sample[i]);
        }
        *sample = last;
    }
}

/// The plane seen as columns, shared between threads that each take their own.
struct Columns {
    data: *mut f32,
    stride: usize,
    height: usize,
}

// SAFETY: threads touch disjoint columns only (see `coefficients`).
unsafe impl Sync for Columns {}

/// # Safety
/// Columns `first..first + count` must lie inside the plane and belong to the caller alone.
unsafe fn filter_columns(isa: Isa, columns: &Columns, first: usize, count: usize, poles: &[f64]) {
    if poles.is_empty() || columns.height < 2 {
        return;
    }
    filter_columns_path(isa, columns, first, count, poles);
}

multiversioned! {
    fn filter_columns_path[][](columns: &Columns, first: usize, count: usize, poles: &[f64]) => filter_columns_body
}

#[inline(always)]
fn filter_columns_body<const FMA: bool>(columns: &Columns, first: usize, count: usize, poles: &[f64]) {
    // SAFETY: rows 0..height of the caller's own columns; see `filter_columns`. Each slice lives for one
    // row's work only, and no two overlap.
    let row = |y: usize| unsafe { std::slice::from_raw_parts_mut(columns.data.add(y * columns.stride + first), count) };
    let n = columns.height;
    for &pole in poles {
        let (z, gain) = (pole as f32, ((1.0 - pole) * (1.0 - 1.0 / pole)) as f32);
        let mut last = [0.0; STRIP];
        for (y, weight) in causal_start(pole, n).iter().enumerate() {
            for (l, s) in last.iter_mut().zip(row(y).iter()) {
                *l = mul_add::<FMA>(*weight, *s, *l);
            }
        }
        for (l, s) in last.iter_mut().zip(row(0)) {
            *l *= gain;
            *s = *l;
        }
        let end: [f32; STRIP] = std::array::from_fn(|i| row(n - 1).get(i).copied().unwrap_or(0.0));
        for y in 1..n {
            causal_row::<FMA>(&mut last, row(y), z, gain);
        }
        row(n - 1).copy_from_slice(&end[..count]);
        last = end;
        for y in (0..n - 1).rev() {
            anticausal_row::<FMA>(&mut last, row(y), z);
        }
    }
}

#[inline(always)]
fn causal_row<const FMA: bool>(last: &mut [f32; STRIP], row: &mut [f32], z: f32, gain: f32) {
    if let Ok(row) = <&mut [f32; STRIP]>::try_from(&mut *row) {
        for i in 0..STRIP {
            last[i] = mul_add::<FMA>(z, last[i], gain * row[i]);
            row[i] = last[i];
        }
    } else {
        for (l, s) in last.iter_mut().zip(row) {
            *l = mul_add::<FMA>(z, *l, gain * *s);
            *s = *l;
        }
    }
}

#[inline(always)]
fn anticausal_row<const FMA: bool>(last: &mut [f32; STRIP], row: &mut [f32], z: f32) {
    let _ = FMA;
    if let Ok(row) = <&mut [f32; STRIP]>::try_from(&mut *row) {
        for i in 0..STRIP {
            last[i] = z * (last[i] - row[i]);
            row[i] = last[i];
        }
    } else {
        for (l, s) in last.iter_mut().zip(row) {
            *l = z * (*l - *s);
            *s = *l;
        }
    }
}
