//! Grey levels of the deformed image between its pixels: where a row of pixels lands, which of them count,
//! and the interpolation itself.

#![allow(unsafe_code, reason = "one comparison for all taps of a kernel; prefetching")]

use super::plane::{BORDER, View};
use crate::backend::spline::Spline;
use crate::isa::mul_add;

/// A pixel that lands beyond the outermost pixel centres fades out over this distance, px. A sharp edge
/// would let pixels flicker in and out as the field settles, and the iteration never end; further out
/// there is nothing to read.
const EDGE: f32 = 0.25;

/// Where a pixel lands along one axis: tap column of its floor and the fraction beyond it.
#[inline(always)]
pub(super) fn place(pixel: i32, u: f32) -> (i32, f32) {
    let floor = u.floor();
    (pixel + floor as i32, u - floor)
}

/// Whether a position lies between the first and the last pixel centre of an axis of `n` pixels.
#[inline(always)]
fn inside(at: i32, t: f32, n: usize) -> bool {
    let last = n as i32 - 1;
    // Without short-circuits, here and in `weight`: a branch per lane would undo the vectors.
    (at >= 0) & ((at < last) | ((at == last) & (t == 0.0)))
}

/// Weight of a position on an axis of `n` pixels: 1 inside, 0 from [`EDGE`] outside on.
#[inline(always)]
pub(super) fn weight(at: i32, t: f32, n: usize) -> f32 {
    // Whole pixels and fraction apart: the sum would lose the fraction far from zero.
    let [below, above] = [(-1 - at) as f32 + (1.0 - t), (at - (n as i32 - 1)) as f32 + t];
    let faded = (1.0 - if at < 0 { below } else { above } / EDGE).max(0.0);
    if inside(at, t, n) { 1.0 } else { faded }
}

/// The [`weight`] of each lane, `u` beyond its `pixel`, times what is in `weights`.
#[inline(always)]
fn times_weights<const L: usize>(pixel: impl Fn(i32) -> i32, u: &[f32; L], n: usize, weights: &mut [f32; L]) {
    for i in 0..L {
        let (at, t) = place(pixel(i as i32), u[i]);
        weights[i] *= weight(at, t, n);
    }
}

/// `L` lanes at `at`.
///
/// # Panics
/// Beyond the end: maps of pixels and planes are made so that this does not happen.
#[inline(always)]
pub(super) fn load<T, const L: usize>(values: &[T], at: usize) -> &[T; L] {
    assert!(at < values.len() && values.len() - at >= L, "lanes beyond the end of a plane");
    // SAFETY: there are `L` values from `at` on.
    unsafe { load_unchecked(values, at) }
}

/// `L` lanes at `at`, for loops whose farthest load has been compared with the length.
///
/// # Safety
/// `at + L <= values.len()`.
#[inline(always)]
unsafe fn load_unchecked<T, const L: usize>(values: &[T], at: usize) -> &[T; L] {
    debug_assert!(at + L <= values.len());
    // SAFETY: the caller's promise; an array is aligned as the slice of its values is.
    unsafe { &*values.as_ptr().add(at).cast::<[T; L]>() }
}

/// Asks the cache for the line of `values` at `at`; a hint, so any index will do.
#[inline(always)]
pub(super) fn prefetch<T>(values: &[T], at: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch never faults, and the address is formed without leaving the wrapping rules.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(values.as_ptr().wrapping_add(at).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (values, at);
}

/// Grey levels of the deformed image at one row of lanes, and which of them count.
pub(super) struct Row<const L: usize> {
    pub g: [f32; L],
    pub counted: [f32; L],
    pub all_counted: bool,
}

/// Where the lanes of a row land: whether all of them inside the image, and the range of their floors, along x
/// relative to their own columns.
struct Landing {
    all_inside: bool,
    shift_x: (i32, i32),
    y: (i32, i32),
}

/// Interpolates the row of `lanes` pixels from column `x`, row `y`, with displacements (less the whole
/// offset, which `x` and `y` already contain) `ux`, `uy` that are affine along the row.
#[inline(always)]
pub(super) fn sample_row<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    c: View<'_>,
    scalar: bool,
    [x, y]: [i32; 2],
    lanes: usize,
    ux: &[f32; L],
    uy: &[f32; L],
) -> Row<L> {
    let (first_x, last_x) = (place(x, ux[0]), place(x + lanes as i32 - 1, ux[lanes - 1]));
    let (first_y, last_y) = (place(y, uy[0]), place(y, uy[lanes - 1]));
    // u is affine along the row: if both ends are inside, all lanes are, and floors lie between the ends'.
    let all_inside = inside(first_x.0, first_x.1, c.width)
        && inside(last_x.0, last_x.1, c.width)
        && inside(first_y.0, first_y.1, c.height)
        && inside(last_y.0, last_y.1, c.height);
    let shift_ends = (first_x.0 - x, last_x.0 - x - (lanes as i32 - 1));
    let landing = Landing {
        all_inside,
        shift_x: (shift_ends.0.min(shift_ends.1), shift_ends.0.max(shift_ends.1)),
        y: (first_y.0.min(last_y.0), first_y.0.max(last_y.0)),
    };
    sample::<FMA, S, K, L>(c, scalar, [x, y], lanes, ux, uy, &landing)
}

/// As [`sample_row`] for displacements that run along the row as they like.
#[inline(always)]
pub(super) fn sample_lanes<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    c: View<'_>,
    scalar: bool,
    [x, y]: [i32; 2],
    lanes: usize,
    ux: &[f32; L],
    uy: &[f32; L],
) -> Row<L> {
    let mut landing = Landing { all_inside: true, shift_x: (i32::MAX, i32::MIN), y: (i32::MAX, i32::MIN) };
    for i in 0..lanes {
        let (at_x, at_y) = (place(x + i as i32, ux[i]), place(y, uy[i]));
        landing.all_inside &= inside(at_x.0, at_x.1, c.width) && inside(at_y.0, at_y.1, c.height);
        let shift = at_x.0 - x - i as i32;
        landing.shift_x = (landing.shift_x.0.min(shift), landing.shift_x.1.max(shift));
        landing.y = (landing.y.0.min(at_y.0), landing.y.1.max(at_y.0));
    }
    sample::<FMA, S, K, L>(c, scalar, [x, y], lanes, ux, uy, &landing)
}

#[inline(always)]
fn sample<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    c: View<'_>,
    scalar: bool,
    [x, y]: [i32; 2],
    lanes: usize,
    ux: &[f32; L],
    uy: &[f32; L],
    landing: &Landing,
) -> Row<L> {
    let before = (K / 2 - 1) as isize;
    let Landing { all_inside, shift_x: (sx0, sx1), y: (y0, y1) } = *landing;
    // A wild field lands everywhere.
    let combinations = (sx1 - sx0 + 1).saturating_mul(y1 - y0 + 1);
    let mut row = Row { g: [0.0; L], counted: [0.0; L], all_counted: false };
    let [last_x, last_y] = [c.width as i32 - 1, c.height as i32 - 1];
    if y1 < -1
        || y0 > last_y
        || x.saturating_add(sx1).saturating_add(lanes as i32) < 0
        || x.saturating_add(sx0) > last_x
    {
        return row; // beyond where pixels fade out
    }
    // Rows beyond the image have nothing to read, and lanes left of it must begin within the border.
    let readable = x + sx0 >= before as i32 - BORDER as i32 && y0 >= -1 && y1 < c.height as i32;
    if !scalar && (all_inside || readable) && combinations <= 6 {
        let farthest = c.at((x + sx1) as isize - before, y1 as isize - before) + (K - 1) * (c.stride + 1) + L;
        // A floor just outside the image is allowed by `EDGE`; its taps lie in the border.
        if farthest <= c.data.len() && (!all_inside || x + sx0 >= -1) && y0 >= -1 {
            row.all_counted = all_inside;
            for sy in y0..=y1 {
                for sx in sx0..=sx1 {
                    let at = c.at((x + sx) as isize - before, sy as isize - before);
                    let (fx, fy) = (sx as f32, (sy - y) as f32);
                    let (mut tx, mut ty) = ([0.0; L], [0.0; L]);
                    for i in 0..L {
                        tx[i] = ux[i] - fx;
                        ty[i] = uy[i] - fy;
                    }
                    let g = interpolate::<FMA, S, K, L>(c, at, &tx, &ty);
                    if combinations == 1 {
                        row.g = g;
                    } else {
                        for i in 0..L {
                            // Floors rise, and the last one not above a lane keeps it, so that every lane
                            // gets a value whatever u - floor rounds to. Without short-circuits: a branch
                            // per lane would undo the vectors.
                            let here = ((tx[i] >= 0.0) | (sx == sx0)) & ((ty[i] >= 0.0) | (sy == y0));
                            row.g[i] = if here { g[i] } else { row.g[i] };
                        }
                    }
                }
            }
            if !all_inside {
                row.counted = std::array::from_fn(|i| if i < lanes { 1.0 } else { 0.0 });
                times_weights(|i| x + i, ux, c.width, &mut row.counted);
                times_weights(|_| y, uy, c.height, &mut row.counted);
                for i in 0..L {
                    // What a lane beyond the image has read is nothing.
                    row.g[i] = if row.counted[i] > 0.0 { row.g[i] } else { 0.0 };
                }
            }
            return row;
        }
    }
    for i in 0..lanes {
        let ((px, tx), (py, ty)) = (place(x + i as i32, ux[i]), place(y, uy[i]));
        let weight = weight(px, tx, c.width) * weight(py, ty, c.height);
        if weight > 0.0 {
            row.counted[i] = weight;
            row.g[i] = interpolate_one::<FMA, S, K>(c, px, py, tx, ty);
        }
    }
    row
}

#[inline(always)]
pub(super) fn interpolate<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    c: View<'_>,
    at: usize,
    tx: &[f32; L],
    ty: &[f32; L],
) -> [f32; L] {
    // One comparison for all taps: that of the last row and column is the farthest.
    let reach = (K - 1) * c.stride + (K - 1) + L;
    assert!(at < c.data.len() && c.data.len() - at >= reach, "taps beyond the end of a plane");
    let (wx, wy) = (S::weights::<FMA, L>(tx), S::weights::<FMA, L>(ty));
    let mut g = [0.0; L];
    for j in 0..K {
        let mut along = [0.0; L];
        for k in 0..K {
            // SAFETY: `j` and `k` are below `K`, so that this lies within `reach` of `at`.
            let taps = unsafe { load_unchecked::<f32, L>(c.data, at + j * c.stride + k) };
            for i in 0..L {
                along[i] = mul_add::<FMA>(wx[k][i], taps[i], along[i]);
            }
        }
        for i in 0..L {
            g[i] = mul_add::<FMA>(wy[j][i], along[i], g[i]);
        }
    }
    g
}

/// Index of the value `ahead` columns and `below` rows from a position that may be anywhere.
#[inline(always)]
pub(super) fn next_taps(plane: View<'_>, [x, y]: [i32; 2], below: usize, ahead: usize) -> usize {
    let row = (y as isize + below as isize).wrapping_mul(plane.stride as isize);
    plane.at(0, 0).wrapping_add_signed(row.wrapping_add(x as isize + ahead as isize))
}

/// One pixel, the same sums in the same order.
#[inline(always)]
fn interpolate_one<const FMA: bool, S: Spline<K>, const K: usize>(
    c: View<'_>,
    x: i32,
    y: i32,
    tx: f32,
    ty: f32,
) -> f32 {
    let before = (K / 2 - 1) as isize;
    let (wx, wy) = (S::weights::<FMA, 1>(&[tx]), S::weights::<FMA, 1>(&[ty]));
    let mut g = 0.0;
    for (j, wy) in wy.iter().enumerate() {
        let at = c.at(x as isize - before, y as isize - before + j as isize);
        let mut along = 0.0;
        for (wx, tap) in wx.iter().zip(&c.data[at..at + K]) {
            along = mul_add::<FMA>(wx[0], *tap, along);
        }
        g = mul_add::<FMA>(wy[0], along, g);
    }
    g
}
