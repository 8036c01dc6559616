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
    let mut row = Row { g: [0.0; L], counted: [0.0; L], all_counted: false };
    let [last_x, last_y] = [c.width as i32 - 1, c.height as i32 - 1];
    if y1 < -1
        || y0 > last_y
        || x.saturating_add(sx1).saturating_add(lanes as i32) < 0
        || x.saturating_add(sx0) > last_x
    {
        return row; // beyond where pixels fade out
    }
    // A wild field lands everywhere.
    let further = [sx1.saturating_sub(sx0), y1.saturating_sub(y0)];
    let is_tame = further.iter().all(|further| *further <= MOST_FURTHER);
    // Rows beyond the image have nothing to read, and lanes left of it must begin within the border. A floor just
    // outside the image is allowed by `EDGE`; its taps lie in the border.
    let leftmost = if all_inside { -1 } else { before as i32 - BORDER as i32 };
    let readable = x.saturating_add(sx0) >= leftmost && y0 >= -1 && (all_inside || y1 < c.height as i32);
    if !scalar && is_tame && readable {
        let at = c.at((x + sx0) as isize - before, y0 as isize - before);
        if at + reach::<K, L>(c.stride, further) <= c.data.len() {
            row.all_counted = all_inside;
            row.g = interpolate_floors::<FMA, S, K, L>(c, at, [ux, uy], [sx0 as f32, (y0 - y) as f32], further);
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

/// Interpolates lanes whose taps begin at `at`, at the fractions `tx` and `ty` beyond their floor.
#[inline(always)]
pub(super) fn interpolate<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    c: View<'_>,
    at: usize,
    tx: &[f32; L],
    ty: &[f32; L],
) -> [f32; L] {
    interpolate_across::<FMA, 0, S, K, L>(c, at, (tx, 0.0), (ty, 0.0))
}

/// Floors beyond the lowest that [`interpolate_across`] tells apart at most: as many as a strain of an eighth brings
/// into 16 lanes.
pub(super) const FURTHER: usize = 2;
/// Floors beyond the lowest up to which a row is interpolated in lanes.
const MOST_FURTHER: i32 = 5;
/// So many pairs of floors are interpolated one by one before it is quicker to tell them apart.
const FEW_PAIRS: i32 = 6;

/// Floors along each axis that one round of [`interpolate_floors`] has, of as many `further` than the lowest.
#[inline(always)]
fn of_round([x, y]: [i32; 2]) -> usize {
    let most = x.max(y) as usize;
    let is_few = (x + 1) * (y + 1) <= FEW_PAIRS;
    if most <= FURTHER {
        most + 1
    } else if is_few {
        1
    } else {
        FURTHER + 1
    }
}

/// Values from the first tap of a row's lanes on that are read where there are so many floors `further` than the
/// lowest.
#[inline(always)]
fn reach<const K: usize, const L: usize>(stride: usize, further: [i32; 2]) -> usize {
    let round = of_round(further);
    let [x, y] = further.map(|further| further as usize / round * round + round - 1);
    (K - 1 + y) * stride + (K - 1 + x) + L
}

/// Interpolates lanes with displacements whose floors are the lowest, whose taps begin at `at`, or one of those
/// `further` on, [`FURTHER`] at most.
#[inline(always)]
fn interpolate_round<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    c: View<'_>,
    at: usize,
    x: (&[f32; L], f32),
    y: (&[f32; L], f32),
    further: i32,
) -> [f32; L] {
    match further {
        0 => interpolate_across::<FMA, 0, S, K, L>(c, at, x, y),
        1 => interpolate_across::<FMA, 1, S, K, L>(c, at, x, y),
        _ => interpolate_across::<FMA, FURTHER, S, K, L>(c, at, x, y),
    }
}

/// Interpolates lanes with displacements `[ux, uy]` whose floors are the `low` ones, with taps from `at` on, or up to
/// so many `further` along x and y.
#[inline(always)]
fn interpolate_floors<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    c: View<'_>,
    at: usize,
    [ux, uy]: [&[f32; L]; 2],
    [low_x, low_y]: [f32; 2],
    further: [i32; 2],
) -> [f32; L] {
    let most = further[0].max(further[1]);
    if most <= FURTHER as i32 {
        return interpolate_round::<FMA, S, K, L>(c, at, (ux, low_x), (uy, low_y), most);
    }
    let round = of_round(further);
    let mut g = [0.0; L];
    for up in (0..=further[1] as usize).step_by(round) {
        for right in (0..=further[0] as usize).step_by(round) {
            let (low_x, low_y) = (low_x + right as f32, low_y + up as f32);
            let at = at + up * c.stride + right;
            let of_round = interpolate_round::<FMA, S, K, L>(c, at, (ux, low_x), (uy, low_y), round as i32 - 1);
            for i in 0..L {
                // The last round that does not begin above a lane has its floor, or the first, whatever u - floor
                // rounds to. Without short-circuits: a branch per lane would undo the vectors.
                let here = ((ux[i] >= low_x) | (right == 0)) & ((uy[i] >= low_y) | (up == 0));
                g[i] = if here { of_round[i] } else { g[i] };
            }
        }
    }
    g
}

/// Interpolates the first `lanes` of a row, which all land inside the plane, with displacements that are affine along
/// it and run by less than [`FURTHER`]; for a displacement within 0..1 the taps begin at `at`.
#[inline(always)]
pub(super) fn interpolate_inside<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    c: View<'_>,
    at: usize,
    lanes: usize,
    [ux, uy]: [&[f32; L]; 2],
) -> [f32; L] {
    let ends = |u: &[f32; L]| {
        let (first, last) = (u[0].floor(), u[lanes - 1].floor());
        (first.min(last), (first - last).abs())
    };
    let ((low_x, x), (low_y, y)) = (ends(ux), ends(uy));
    let at = at.wrapping_add_signed(low_y as isize * c.stride as isize + low_x as isize);
    interpolate_round::<FMA, S, K, L>(c, at, (ux, low_x), (uy, low_y), x.max(y) as i32)
}

/// `a` where all bits of the mask are set, `b` where none is: what a comparison of lanes leaves, and no branch.
#[inline(always)]
fn blend(mask: u32, a: f32, b: f32) -> f32 {
    f32::from_bits((a.to_bits() & mask) | (b.to_bits() & !mask))
}

/// The fractions of displacements beyond their floors, each of which is `low` or one of the `N` after it, and for each
/// of these a mask: the lanes whose floor is that or a later one.
#[inline(always)]
fn fractions<const N: usize, const L: usize>(u: &[f32; L], low: f32) -> ([f32; L], [[u32; L]; N]) {
    let (mut t, mut beyond) = ([0.0; L], [[0; L]; N]);
    for i in 0..L {
        t[i] = u[i] - low;
    }
    for (n, beyond) in beyond.iter_mut().enumerate() {
        for i in 0..L {
            let here = u[i] - (low + (n + 1) as f32);
            beyond[i] = if here >= 0.0 { u32::MAX } else { 0 };
            t[i] = blend(beyond[i], here, t[i]);
        }
    }
    (t, beyond)
}

/// Interpolates lanes with displacements whose floors need not be the same: the lowest, whose taps begin at `at`, or
/// one of the `N` after it. The taps of a lane are picked out of the columns and rows that any of them has: the same
/// sums as if it were alone, in the same order.
#[inline(always)]
fn interpolate_across<const FMA: bool, const N: usize, S: Spline<K>, const K: usize, const L: usize>(
    c: View<'_>,
    at: usize,
    (ux, low_x): (&[f32; L], f32),
    (uy, low_y): (&[f32; L], f32),
) -> [f32; L] {
    // One comparison for all taps: that of the last row and column is the farthest.
    let reach = (K - 1 + N) * (c.stride + 1) + L;
    assert!(at < c.data.len() && c.data.len() - at >= reach, "taps beyond the end of a plane");
    let ((tx, beyond_x), (ty, beyond_y)) = (fractions::<N, L>(ux, low_x), fractions::<N, L>(uy, low_y));
    let (wx, wy) = (S::weights::<FMA, L>(&tx), S::weights::<FMA, L>(&ty));
    // Sums along the `N` rows before.
    let (mut g, mut before) = ([0.0; L], [[0.0; L]; N]);
    for j in 0..K + N {
        let mut along = [0.0; L];
        for k in 0..K {
            // SAFETY: `j` and `k + n` are below `K + N`, so that this lies within `reach` of `at`.
            let column = |n: usize| unsafe { load_unchecked::<f32, L>(c.data, at + j * c.stride + k + n) };
            let mut taps = *column(0);
            for (n, beyond) in beyond_x.iter().enumerate() {
                let next = column(n + 1);
                for i in 0..L {
                    taps[i] = blend(beyond[i], next[i], taps[i]);
                }
            }
            for i in 0..L {
                along[i] = mul_add::<FMA>(wx[k][i], taps[i], along[i]);
            }
        }
        if j >= N {
            let mut rows = *before.first().unwrap_or(&along);
            for (n, beyond) in beyond_y.iter().enumerate() {
                let next = before.get(n + 1).unwrap_or(&along);
                for i in 0..L {
                    rows[i] = blend(beyond[i], next[i], rows[i]);
                }
            }
            for i in 0..L {
                g[i] = mul_add::<FMA>(wy[j - N][i], rows[i], g[i]);
            }
        }
        for n in 1..N {
            before[n - 1] = before[n];
        }
        before.last_mut().iter_mut().for_each(|last| **last = along);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::cpu::memory::Pool;
    use crate::backend::cpu::plane::Plane;
    use crate::backend::spline::{Bilinear, Cubic, Quintic};

    const SIZE: usize = 48;
    const LANES: usize = 16;

    fn plane() -> Plane {
        let mut plane = Plane::new(&Pool::default(), SIZE, SIZE).unwrap();
        let noise = |k: usize| ((k as u32).wrapping_mul(2_654_435_769) >> 8) as f32 / 65536.0 - 128.0;
        plane.data_mut().iter_mut().enumerate().for_each(|(k, value)| *value = noise(k));
        plane.continue_border();
        plane
    }

    /// Whether lanes side by side find what each of them finds alone, bit for bit; and how many of them count.
    fn is_as_one_by_one<S: Spline<K>, const K: usize>(
        plane: &Plane,
        at: [i32; 2],
        lanes: usize,
        u: [[f32; LANES]; 2],
    ) -> usize {
        let [together, alone] = [false, true]
            .map(|scalar| sample_lanes::<false, S, K, LANES>(plane.view(), scalar, at, lanes, &u[0], &u[1]));
        for i in 0..lanes {
            let counted = if together.all_counted { 1.0 } else { together.counted[i] };
            assert_eq!((together.g[i], counted), (alone.g[i], alone.counted[i]), "lane {i} at {at:?}: {u:?}");
        }
        alone.counted[..lanes].iter().filter(|counted| **counted > 0.0).count()
    }

    #[test]
    fn lanes_that_land_beyond_different_pixels_find_what_each_of_them_finds_alone() {
        let plane = plane();
        let slopes = [0.0, 0.02, -0.06, 0.12, 0.2, -0.3, 0.45];
        let (mut n, mut n_counted) = (0, 0);
        for (k, [slope_x, slope_y]) in slopes.iter().flat_map(|x| slopes.map(|y| [*x, y])).enumerate() {
            for (x, y) in [-3, 0, 14, 33, 40].into_iter().flat_map(|x| [-1, 0, 20, 45, 47].map(|y| (x, y))) {
                let lanes = [LANES, 7][k % 2];
                let along = |first: f32, slope: f32| std::array::from_fn(|i| first + slope * i as f32);
                // Affine along the row, and as they like.
                let affine = [along(0.37, slope_x), along(-0.71, slope_y)];
                let wild = affine.map(|u| std::array::from_fn(|i| u[i] + [0.0, 0.9, -0.4, 1.3][i % 4] * slope_x));
                for u in [affine, wild] {
                    n += 3 * lanes;
                    n_counted += is_as_one_by_one::<Cubic, 4>(&plane, [x, y], lanes, u)
                        + is_as_one_by_one::<Quintic, 6>(&plane, [x, y], lanes, u)
                        + is_as_one_by_one::<Bilinear, 2>(&plane, [x, y], lanes, u);
                }
            }
        }
        assert!(n_counted > n / 2 && n_counted < n, "{n_counted} of {n}");
    }
}
