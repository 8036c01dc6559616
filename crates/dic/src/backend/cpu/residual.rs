//! Residual and right-hand side of every element in one pass over its pixels (THEORY 2):
//! `b_i = sum (psi_i . grad f)(f - gain g(X + u) - offset)`.
//!
//! Inside an element u is affine along a row, so the floor of u is constant over most rows and the taps
//! of 16 neighbouring pixels are contiguous: 16 unaligned vector loads, no gather. Where the floor
//! changes within a row the row is evaluated for each floor and the lanes are selected. A pixel's
//! position is its whole column and row plus the element's whole offset plus a small f32 rest; the sum
//! X + u is never formed in f32.
//!
//! The shape functions are separable: lanes accumulate `(1 - eta) r grad f` and `eta r grad f` down the
//! rows of a chunk of columns, and the weights in xi come once, at the end.

use super::corners::{AsItIs, Brings, Corners, Light, row_displacement};
use super::lanes::Lanes;
use super::pass::{ElementSums, Pass, chunk, total};
use super::plane::{BORDER, View};
use super::residual_runs::run_sums;
use super::sample::{FURTHER, interpolate, interpolate_inside, next_taps, prefetch, sample_row};
use crate::backend::spline::Spline;
use crate::isa::{mul_add, multiversioned};
use crate::mesh::ElementPixels;

multiversioned! {
    /// Sums of the elements from `first` on; `corners`, `transfer` (gain, offset) and `sums` run over them.
    pub(super) fn residual_sums[S: Spline<K>, const K: usize, const L: usize][S, K, L](
        pass: &Pass<'_, L>, first: usize, corners: &[Corners], transfer: &[(f32, f32)], sums: &mut [ElementSums], spline: S,
    ) => residual_sums_body
}

#[inline(always)]
fn residual_sums_body<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_, L>,
    first: usize,
    corners: &[Corners],
    transfer: &[(f32, f32)],
    sums: &mut [ElementSums],
    _: S,
) {
    for (k, sums) in sums.iter_mut().enumerate() {
        *sums = sums_of::<FMA, S, K, L, _>(pass, first + k, &corners[k], AsItIs, transfer[k]);
    }
}

multiversioned! {
    /// As [`residual_sums`], where the deformed image is brought to the `light` of the reference first: sums of g are those of the image so
    /// brought.
    pub(super) fn residual_sums_in_light[S: Spline<K>, const K: usize, const L: usize][S, K, L](
        pass: &Pass<'_, L>, first: usize, corners: &[Corners], transfer: &[(f32, f32)], light: &[Light], sums: &mut [ElementSums], spline: S,
    ) => residual_sums_in_light_body
}

#[inline(always)]
fn residual_sums_in_light_body<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_, L>,
    first: usize,
    corners: &[Corners],
    transfer: &[(f32, f32)],
    light: &[Light],
    sums: &mut [ElementSums],
    _: S,
) {
    for (k, sums) in sums.iter_mut().enumerate() {
        *sums = sums_of::<FMA, S, K, L, _>(pass, first + k, &corners[k], &light[k], transfer[k]);
    }
}

/// Sums of an element of any shape, wherever it is.
#[inline(always)]
fn sums_of<const FMA: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    pass: &Pass<'_, L>,
    element: usize,
    corners: &Corners,
    light: B,
    transfer: (f32, f32),
) -> ElementSums {
    let (element, lanes) = pass.element(element);
    let sums = if element.n_runs > 0 {
        run_sums::<FMA, S, K, L, B>(pass, (element, lanes), corners, light, transfer)
    } else if corners.is_outside(element, pass.deformed) {
        ElementSums::default()
    } else {
        element_sums::<FMA, S, K, L, B>(pass, (element, lanes), corners, light, transfer)
    };
    sums.times_unit(pass.unit)
}

/// Lane accumulators of one chunk of columns.
pub(super) struct Accumulators<const L: usize> {
    /// Near and far in eta, times fx and fy.
    b: [[[f32; L]; 2]; 2],
    rr: [f32; L],
    g: [f32; L],
    gg: [f32; L],
    fg: [f32; L],
}

impl<const L: usize> Accumulators<L> {
    #[inline(always)]
    pub fn new() -> Self {
        Self { b: [[[0.0; L]; 2]; 2], rr: [0.0; L], g: [0.0; L], gg: [0.0; L], fg: [0.0; L] }
    }

    /// Adds one row; `weight` is 1 where a lane counts, 0 where it does not, between at the image's edge.
    #[inline(always)]
    pub fn add<const FMA: bool>(
        &mut self,
        Lanes { f, fx, fy }: &Lanes<L>,
        g: &[f32; L],
        weight: &[f32; L],
        (gain, offset): (f32, f32),
        eta: f32,
    ) {
        for i in 0..L {
            let difference = mul_add::<FMA>(-gain, g[i], f[i] - offset);
            let (r, wg) = (weight[i] * difference, weight[i] * g[i]);
            let (rx, ry) = (r * f32::from(fx[i]), r * f32::from(fy[i]));
            self.b[0][0][i] += rx;
            self.b[0][1][i] += ry;
            self.b[1][0][i] = mul_add::<FMA>(eta, rx, self.b[1][0][i]);
            self.b[1][1][i] = mul_add::<FMA>(eta, ry, self.b[1][1][i]);
            self.rr[i] = mul_add::<FMA>(r, difference, self.rr[i]);
            self.g[i] += wg;
            self.gg[i] = mul_add::<FMA>(wg, g[i], self.gg[i]);
            self.fg[i] = mul_add::<FMA>(f[i], wg, self.fg[i]);
        }
    }

    /// Applies the weights in xi and sums the lanes.
    #[inline(always)]
    pub fn finish<const FMA: bool>(&self, xi: &[f32; L], sums: &mut ElementSums) {
        for c in 0..2 {
            // b[0] holds the whole sum, b[1] its far part: near = whole - far, once, here.
            let (mut near, mut far) = ([0.0; L], self.b[1][c]);
            let (mut near_right, mut far_right) = ([0.0; L], [0.0; L]);
            for i in 0..L {
                near[i] = self.b[0][c][i] - far[i];
                near_right[i] = xi[i] * near[i];
                far_right[i] = xi[i] * far[i];
                near[i] -= near_right[i];
                far[i] -= far_right[i];
            }
            sums.b[c] += total(&near);
            sums.b[2 + c] += total(&near_right);
            sums.b[4 + c] += total(&far_right);
            sums.b[6 + c] += total(&far);
        }
        sums.rr += total(&self.rr);
        sums.g += total(&self.g);
        sums.gg += total(&self.gg);
        sums.fg += total(&self.fg);
    }
}

/// Where the pixels of an element land, if all of them do inside the deformed image.
#[derive(Clone, Copy, PartialEq)]
enum Lands {
    /// With the floor of the element's whole offset: true of most elements, and worth knowing, since their rows need no
    /// look at all.
    Uniform,
    /// With floors that differ by [`FURTHER`] at most along a row of lanes.
    Inside,
    /// Anywhere.
    Anywhere,
}

impl Lands {
    #[inline(always)]
    fn of<const K: usize, const L: usize>(element: &ElementPixels, corners: &Corners, deformed: View<'_>) -> Self {
        let [x, y] = [element.x + corners.whole[0], element.y + corners.whole[1]];
        let [nx, ny] = [i32::from(element.nx), i32::from(element.ny)];
        // Rows of whole chunks are read: the last may reach past the image, not past the plane's own row.
        let columns = (element.nx as usize).next_multiple_of(L) as i32;
        let room = (deformed.stride - BORDER) as i32 - columns - K as i32;
        if corners.x.iter().chain(&corners.y).all(|u| (0.0..1.0).contains(u)) {
            let inside =
                x >= 0 && y >= 0 && x + nx < deformed.width as i32 && y + ny < deformed.height as i32 && x <= room;
            return if inside { Self::Uniform } else { Self::Anywhere };
        }
        let ends = |u: &[f32; 4]| u.iter().fold((f32::MAX, f32::MIN), |(low, high), u| (low.min(*u), high.max(*u)));
        // More than the round-off of what lies between the corners.
        const MARGIN: f32 = 0.01;
        let ((low_x, high_x), (low_y, high_y)) = (ends(&corners.x), ends(&corners.y));
        // What is no number is not near.
        let is_near = [low_x, low_y].iter().all(|u| *u > -100.0) && [high_x, high_y].iter().all(|u| *u < 100.0);
        let runs = |u: &[f32; 4]| {
            (u[1] - u[0]).abs().max((u[2] - u[3]).abs()) * element.dxi * (L as f32) < FURTHER as f32 - MARGIN
        };
        if !is_near || !runs(&corners.x) || !runs(&corners.y) {
            return Self::Anywhere;
        }
        let floor = |u: f32| u.floor() as i32;
        let inside = x + floor(low_x - MARGIN) >= 0
            && y + floor(low_y - MARGIN) >= 0
            && x + nx + floor(high_x + MARGIN) < deformed.width as i32
            && y + ny + floor(high_y + MARGIN) < deformed.height as i32
            && x + floor(high_x + MARGIN) + FURTHER as i32 <= room;
        if inside { Self::Inside } else { Self::Anywhere }
    }
}

/// One chunk of columns of an element all of which lands inside. The accumulators are plain arrays so that they stay in
/// registers.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "kernels take their operands one by one, so that they stay in registers")]
fn inside_chunk<const FMA: bool, const UNIFORM: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    deformed: View<'_>,
    (element, lanes): (&ElementPixels, &[Lanes<L>]),
    corners: &Corners,
    light: B,
    (gain, offset): (f32, f32),
    column: usize,
    (n, xi, mask): (usize, &[f32; L], &[f32; L]),
    sums: &mut ElementSums,
) {
    let before = (K / 2 - 1) as isize;
    let x = element.x + column as i32;
    let to = [x + corners.whole[0], element.y + corners.whole[1]];
    let mut taps_at = deformed.at(to[0] as isize - before, to[1] as isize - before);
    let (mut bx, mut by, mut ex, mut ey) = ([0.0; L], [0.0; L], [0.0; L], [0.0; L]);
    let (mut rr, mut sg, mut sgg, mut sfg) = ([0.0; L], [0.0; L], [0.0; L], [0.0; L]);
    for (k, Lanes { f, fx, fy }) in lanes.iter().enumerate() {
        // The next chunk to the right, row by row: rows are a stride apart, more streams than the
        // hardware follows. The lowest tap row of each row is the one not seen before.
        prefetch(deformed.data, taps_at + (K - 1) * deformed.stride + 2 * L);
        let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
        let [ux, uy] = row_displacement::<FMA, L>(corners, xi, eta);
        let mut g = if UNIFORM {
            interpolate::<FMA, S, K, L>(deformed, taps_at, &ux, &uy)
        } else {
            interpolate_inside::<FMA, S, K, L>(deformed, taps_at, n, [&ux, &uy])
        };
        light.row::<FMA, L>(xi, eta, &mut g);
        for i in 0..L {
            let difference = mul_add::<FMA>(-gain, g[i], f[i] - offset);
            let (r, wg) = (mask[i] * difference, mask[i] * g[i]);
            let (rx, ry) = (r * f32::from(fx[i]), r * f32::from(fy[i]));
            bx[i] += rx;
            by[i] += ry;
            ex[i] = mul_add::<FMA>(eta, rx, ex[i]);
            ey[i] = mul_add::<FMA>(eta, ry, ey[i]);
            rr[i] = mul_add::<FMA>(r, difference, rr[i]);
            sg[i] += wg;
            sgg[i] = mul_add::<FMA>(wg, g[i], sgg[i]);
            sfg[i] = mul_add::<FMA>(f[i], wg, sfg[i]);
        }
        taps_at += deformed.stride;
    }
    let acc = Accumulators { b: [[bx, by], [ex, ey]], rr, g: sg, gg: sgg, fg: sfg };
    acc.finish::<FMA>(xi, sums);
}

#[inline(always)]
fn element_sums<const FMA: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    pass: &Pass<'_, L>,
    (element, lanes): (&ElementPixels, &[Lanes<L>]),
    corners: &Corners,
    light: B,
    transfer: (f32, f32),
) -> ElementSums {
    let Pass { deformed, scalar, .. } = *pass;
    let rows = usize::from(element.ny).max(1); // of none there are no lanes
    let mut sums = ElementSums::default();
    let lands = if scalar { Lands::Anywhere } else { Lands::of::<K, L>(element, corners, deformed) };
    if lands != Lands::Anywhere {
        for (column, lanes) in (0..).step_by(L).zip(lanes.chunks_exact(rows)) {
            let (n, xi, mask) = chunk::<L>(element, column);
            let (of_chunk, columns) = ((element, lanes), (n, &xi, &mask));
            if lands == Lands::Uniform {
                inside_chunk::<FMA, true, S, K, L, B>(
                    deformed, of_chunk, corners, light, transfer, column, columns, &mut sums,
                );
            } else {
                inside_chunk::<FMA, false, S, K, L, B>(
                    deformed, of_chunk, corners, light, transfer, column, columns, &mut sums,
                );
            }
        }
        sums.n = f32::from(element.nx) * f32::from(element.ny);
        return sums;
    }
    for (column, lanes) in (0..).step_by(L).zip(lanes.chunks_exact(rows)) {
        let (n, xi, mask) = chunk::<L>(element, column);
        let mut acc = Accumulators::<L>::new();
        // Pixels counted in part, and the sums of f and f^2 over what is not.
        let [mut counted, mut f_lost, mut ff_lost] = [[0.0; L]; 3];
        let x = element.x + column as i32;
        for (k, lanes) in lanes.iter().enumerate() {
            let y = element.y + k as i32;
            let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
            let [ux, uy] = row_displacement::<FMA, L>(corners, &xi, eta);
            let to = [x + corners.whole[0], y + corners.whole[1]];
            // As above.
            prefetch(deformed.data, next_taps(deformed, to, K / 2, 2 * L));
            let mut row = sample_row::<FMA, S, K, L>(deformed, scalar, to, n, &ux, &uy);
            light.row::<FMA, L>(&xi, eta, &mut row.g);
            if row.all_counted {
                acc.add::<FMA>(lanes, &row.g, &mask, transfer, eta);
                sums.n += n as f32;
            } else {
                acc.add::<FMA>(lanes, &row.g, &row.counted, transfer, eta);
                for i in 0..L {
                    let lost = mask[i] * (1.0 - row.counted[i]);
                    counted[i] += row.counted[i];
                    f_lost[i] += lost * lanes.f[i];
                    ff_lost[i] += lost * lanes.f[i] * lanes.f[i];
                }
            }
        }
        acc.finish::<FMA>(&xi, &mut sums);
        sums.n += total(&counted);
        sums.f_lost += total(&f_lost);
        sums.ff_lost += total(&ff_lost);
    }
    sums
}
