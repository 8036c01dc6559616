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

use super::gradient::Gradient;
use super::plane::{BORDER, Plane, View};
use super::sample::{interpolate, load, next_taps, place, prefetch, sample_lanes, sample_row, weight};
use crate::backend::spline::Spline;
use crate::isa::{Isa, Path, mul_add, multiversioned};
use crate::mesh::{ElementPixels, PixelMap, Run};
use std::sync::Arc;

/// A reference image at one scale with its elements.
#[derive(Debug)]
pub(super) struct Reference {
    pub f: Plane,
    pub gradient: Gradient,
    /// The pixels of each element; none for those left out.
    pub elements: Vec<ElementPixels>,
    /// The runs of those that are no rectangle.
    pub map: Arc<PixelMap>,
}

/// The displacement of an element's corners: whole pixels plus the rest, in the order of its nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Corners {
    pub whole: [i32; 2],
    pub x: [f32; 4],
    pub y: [f32; 4],
}

impl Corners {
    /// Splits the corner displacements so that the rest lies within 0..1 at the element's centre.
    pub fn new(displacement: [[f64; 2]; 4]) -> Self {
        let mean = |c: usize| displacement.iter().map(|u| u[c]).sum::<f64>() / 4.0;
        // A wild field must not overflow; such pixels are outside any image.
        let whole = [0, 1].map(|c| mean(c).floor().clamp(-1e6, 1e6));
        Self {
            whole: whole.map(|w| w as i32),
            x: displacement.map(|u| (u[0] - whole[0]) as f32),
            y: displacement.map(|u| (u[1] - whole[1]) as f32),
        }
    }
}

impl Corners {
    /// Displacement (less the whole offset) at lanes anywhere in the element.
    #[inline(always)]
    fn displacement<const FMA: bool, const L: usize>(&self, xi: &[f32; L], eta: &[f32; L]) -> [[f32; L]; 2] {
        [bilinear::<FMA, L>(&self.x, xi, eta), bilinear::<FMA, L>(&self.y, xi, eta)]
    }

    /// Whether the pixels of an element all land beyond one side of the deformed image.
    #[inline(always)]
    fn is_outside(&self, element: &ElementPixels, deformed: View<'_>) -> bool {
        // What is bilinear lies between its corners; the margin is more than the round-off of `f32` and what still counts.
        const MARGIN: f32 = 0.5;
        let beyond = |first: i32, n: u16, u: &[f32; 4], size: usize| {
            let (low, high) = u.iter().fold((f32::MAX, f32::MIN), |(low, high), u| (low.min(*u), high.max(*u)));
            // In whole pixels, rounded outwards: the sum would lose the fraction far from zero.
            let last = (first + i32::from(n) - 1).saturating_add((high + MARGIN).ceil() as i32);
            last < 0 || first.saturating_add((low - MARGIN).floor() as i32) > size as i32 - 1
        };
        // What is no number is seen by the kernel.
        self.x.iter().chain(&self.y).all(|u| u.is_finite())
            && (beyond(element.x + self.whole[0], element.nx, &self.x, deformed.width)
                || beyond(element.y + self.whole[1], element.ny, &self.y, deformed.height))
    }

    /// How much the pixels from column `x` on in row `y`, at (xi, eta) of the element, count in the deformed image.
    #[inline(always)]
    pub fn weights<const L: usize>(&self, x: i32, y: i32, xi: &[f32; L], eta: f32, deformed: &Plane) -> [f32; L] {
        let [ux, uy] = self.displacement::<false, L>(xi, &[eta; L]);
        let mut weights = [0.0; L];
        for i in 0..L {
            let ((px, tx), (py, ty)) = (place(x + i as i32 + self.whole[0], ux[i]), place(y + self.whole[1], uy[i]));
            weights[i] = weight(px, tx, deformed.width) * weight(py, ty, deformed.height);
        }
        weights
    }
}

/// Light on an element: gain and offset at its corners, in the order of its nodes, bilinear between them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Light {
    pub gain: [f32; 4],
    pub offset: [f32; 4],
}

/// How lanes of the deformed image are brought to the light of the reference, before the transfer.
trait Brings: Copy {
    /// A row of lanes at `eta`.
    fn row<const FMA: bool, const L: usize>(self, xi: &[f32; L], eta: f32, g: &mut [f32; L]);

    /// Lanes anywhere in the element.
    fn lanes<const FMA: bool, const L: usize>(self, xi: &[f32; L], eta: &[f32; L], g: &mut [f32; L]);
}

/// As it is.
#[derive(Clone, Copy)]
struct AsItIs;

impl Brings for AsItIs {
    #[inline(always)]
    fn row<const FMA: bool, const L: usize>(self, _: &[f32; L], _: f32, _: &mut [f32; L]) {}

    #[inline(always)]
    fn lanes<const FMA: bool, const L: usize>(self, _: &[f32; L], _: &[f32; L], _: &mut [f32; L]) {}
}

impl Brings for &Light {
    #[inline(always)]
    fn row<const FMA: bool, const L: usize>(self, xi: &[f32; L], eta: f32, g: &mut [f32; L]) {
        let ((gain, by), (offset, of)) = (along_row(&self.gain, eta), along_row(&self.offset, eta));
        for i in 0..L {
            g[i] = mul_add::<FMA>(mul_add::<FMA>(xi[i], by, gain), g[i], mul_add::<FMA>(xi[i], of, offset));
        }
    }

    #[inline(always)]
    fn lanes<const FMA: bool, const L: usize>(self, xi: &[f32; L], eta: &[f32; L], g: &mut [f32; L]) {
        let gain = bilinear::<FMA, L>(&self.gain, xi, eta);
        let offset = bilinear::<FMA, L>(&self.offset, xi, eta);
        for i in 0..L {
            g[i] = mul_add::<FMA>(gain[i], g[i], offset[i]);
        }
    }
}

/// Sums of one element, as the kernel leaves them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub(super) struct ElementSums {
    /// Right-hand side, unknown `2 k + c` of corner k.
    pub b: [f32; 8],
    /// Pixels counted; those at the edge of the deformed image by their weight.
    pub n: f32,
    /// Sums of r^2, g, g^2, f g over the pixels counted.
    pub rr: f32,
    pub g: f32,
    pub gg: f32,
    pub fg: f32,
    /// Sums of f, f^2 over the pixels not counted.
    pub f_lost: f32,
    pub ff_lost: f32,
}

impl ElementSums {
    /// With the right-hand side, summed in units of the gradient, in grey levels: no digit changes, since a unit is a power of two.
    #[inline(always)]
    fn times_unit(mut self, unit: f32) -> Self {
        for b in &mut self.b {
            *b *= unit;
        }
        self
    }
}

/// What is bilinear between its values at the corners, in lanes anywhere in the element. No `map` over arrays here: it is compiled by itself, without the
/// vector instructions of the kernel.
#[inline(always)]
fn bilinear<const FMA: bool, const L: usize>(corner: &[f32; 4], xi: &[f32; L], eta: &[f32; L]) -> [f32; L] {
    let [a, b, c, d] = *corner;
    let (across, down, twist) = (b - a, d - a, a - b + c - d);
    let mut value = [0.0; L];
    for i in 0..L {
        let slope = mul_add::<FMA>(eta[i], twist, across);
        value[i] = mul_add::<FMA>(xi[i], slope, mul_add::<FMA>(eta[i], down, a));
    }
    value
}

/// Affine run of the displacement along row `eta`: its value at xi = 0 and its change to xi = 1.
#[inline(always)]
fn along_row(corner: &[f32; 4], eta: f32) -> (f32, f32) {
    let left = corner[0] + eta * (corner[3] - corner[0]);
    let right = corner[1] + eta * (corner[2] - corner[1]);
    (left, right - left)
}

/// Displacement (less the whole offset) of a row of lanes at `eta`.
#[inline(always)]
fn row_displacement<const FMA: bool, const L: usize>(corners: &Corners, xi: &[f32; L], eta: f32) -> [[f32; L]; 2] {
    let ((ax, dx), (ay, dy)) = (along_row(&corners.x, eta), along_row(&corners.y, eta));
    let (mut ux, mut uy) = ([0.0; L], [0.0; L]);
    for i in 0..L {
        ux[i] = mul_add::<FMA>(xi[i], dx, ax);
        uy[i] = mul_add::<FMA>(xi[i], dy, ay);
    }
    [ux, uy]
}

/// Everything a kernel call needs besides the elements themselves.
pub(super) struct Pass<'a> {
    elements: &'a [ElementPixels],
    map: &'a PixelMap,
    f: View<'a>,
    fx: View<'a, i16>,
    fy: View<'a, i16>,
    /// Of the gradient.
    unit: f32,
    deformed: View<'a>,
    scalar: bool,
}

impl<'a> Pass<'a> {
    pub fn new(isa: Isa, reference: &'a Reference, deformed: &'a Plane) -> Self {
        Self {
            elements: &reference.elements,
            map: &reference.map,
            f: reference.f.view(),
            fx: reference.gradient.x.view(),
            fy: reference.gradient.y.view(),
            unit: reference.gradient.unit,
            deformed: deformed.view(),
            scalar: isa.path() == Path::Scalar,
        }
    }
}

multiversioned! {
    /// Sums of the elements from `first` on; `corners`, `transfer` (gain, offset) and `sums` run over them.
    pub(super) fn residual_sums[S: Spline<K>, const K: usize, const L: usize][S, K, L](
        pass: &Pass<'_>, first: usize, corners: &[Corners], transfer: &[(f32, f32)], sums: &mut [ElementSums], spline: S,
    ) => residual_sums_body
}

#[inline(always)]
fn residual_sums_body<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_>,
    first: usize,
    corners: &[Corners],
    transfer: &[(f32, f32)],
    sums: &mut [ElementSums],
    _: S,
) {
    for (k, sums) in sums.iter_mut().enumerate() {
        let element = &pass.elements[first + k];
        *sums = sums_of::<FMA, S, K, L, _>(pass, element, &corners[k], AsItIs, transfer[k]);
    }
}

multiversioned! {
    /// As [`residual_sums`], where the deformed image is brought to the `light` of the reference first: sums of g are those of the image so
    /// brought.
    pub(super) fn residual_sums_in_light[S: Spline<K>, const K: usize, const L: usize][S, K, L](
        pass: &Pass<'_>, first: usize, corners: &[Corners], transfer: &[(f32, f32)], light: &[Light], sums: &mut [ElementSums], spline: S,
    ) => residual_sums_in_light_body
}

#[inline(always)]
fn residual_sums_in_light_body<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_>,
    first: usize,
    corners: &[Corners],
    transfer: &[(f32, f32)],
    light: &[Light],
    sums: &mut [ElementSums],
    _: S,
) {
    for (k, sums) in sums.iter_mut().enumerate() {
        let element = &pass.elements[first + k];
        *sums = sums_of::<FMA, S, K, L, _>(pass, element, &corners[k], &light[k], transfer[k]);
    }
}

/// Sums of an element of any shape, wherever it is.
#[inline(always)]
fn sums_of<const FMA: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    pass: &Pass<'_>,
    element: &ElementPixels,
    corners: &Corners,
    light: B,
    transfer: (f32, f32),
) -> ElementSums {
    let sums = if element.n_runs > 0 {
        run_sums::<FMA, S, K, L, B>(pass, element, corners, light, transfer)
    } else if corners.is_outside(element, pass.deformed) {
        ElementSums::default()
    } else {
        element_sums::<FMA, S, K, L, B>(pass, element, corners, light, transfer)
    };
    sums.times_unit(pass.unit)
}

/// Lane accumulators of one chunk of columns.
struct Accumulators<const L: usize> {
    /// Near and far in eta, times fx and fy.
    b: [[[f32; L]; 2]; 2],
    rr: [f32; L],
    g: [f32; L],
    gg: [f32; L],
    fg: [f32; L],
}

impl<const L: usize> Accumulators<L> {
    #[inline(always)]
    fn new() -> Self {
        Self { b: [[[0.0; L]; 2]; 2], rr: [0.0; L], g: [0.0; L], gg: [0.0; L], fg: [0.0; L] }
    }

    /// Adds one row; `weight` is 1 where a lane counts, 0 where it does not, between at the image's edge.
    #[inline(always)]
    #[allow(
        clippy::too_many_arguments,
        reason = "kernels take their operands one by one, so that they stay in registers"
    )]
    fn add<const FMA: bool>(
        &mut self,
        f: &[f32; L],
        fx: &[i16; L],
        fy: &[i16; L],
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
    fn finish<const FMA: bool>(&self, xi: &[f32; L], sums: &mut ElementSums) {
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

/// Sum of the lanes, pairwise.
#[inline(always)]
pub(super) fn total<const L: usize>(lanes: &[f32; L]) -> f32 {
    let mut part = *lanes;
    let mut n = L;
    while n > 1 {
        n /= 2;
        for i in 0..n {
            part[i] += part[i + n];
        }
    }
    part[0]
}

/// Local coordinates and lane mask of a chunk of columns.
#[inline(always)]
pub(super) fn chunk<const L: usize>(element: &ElementPixels, column: usize) -> (usize, [f32; L], [f32; L]) {
    let lanes = (element.nx as usize - column).min(L);
    let (mut xi, mut mask) = ([0.0; L], [0.0; L]);
    for i in 0..L {
        xi[i] = element.xi0 + (column + i) as f32 * element.dxi;
        mask[i] = if i < lanes { 1.0 } else { 0.0 };
    }
    (lanes, xi, mask)
}

/// Whether every pixel of the element has the floor of the element's whole offset and lands inside the
/// image: true for most elements, and worth knowing, since their rows then need no look at all.
#[inline(always)]
fn is_uniform<const K: usize, const L: usize>(element: &ElementPixels, corners: &Corners, deformed: View<'_>) -> bool {
    let rests_in_unit = corners.x.iter().chain(&corners.y).all(|u| (0.0..1.0).contains(u));
    let [x, y] = [element.x + corners.whole[0], element.y + corners.whole[1]];
    // Rows of whole chunks are read: the last may reach past the image, not past the plane's own row.
    let columns = (element.nx as usize).next_multiple_of(L) as i32;
    rests_in_unit
        && x >= 0
        && y >= 0
        && x + i32::from(element.nx) < deformed.width as i32
        && y + i32::from(element.ny) < deformed.height as i32
        && x + columns + (K as i32) <= (deformed.stride - BORDER) as i32
}

/// One chunk of columns of a uniform element. The accumulators are plain arrays so that they stay in
/// registers.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "kernels take their operands one by one, so that they stay in registers")]
fn uniform_chunk<const FMA: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    pass: &Pass<'_>,
    element: &ElementPixels,
    corners: &Corners,
    light: B,
    (gain, offset): (f32, f32),
    column: usize,
    xi: &[f32; L],
    mask: &[f32; L],
    sums: &mut ElementSums,
) {
    let Pass { f, fx, fy, deformed, .. } = *pass;
    let before = (K / 2 - 1) as isize;
    let x = element.x + column as i32;
    let mut at = f.at(x as isize, element.y as isize);
    let to = [x + corners.whole[0], element.y + corners.whole[1]];
    let mut taps_at = deformed.at(to[0] as isize - before, to[1] as isize - before);
    let (mut bx, mut by, mut ex, mut ey) = ([0.0; L], [0.0; L], [0.0; L], [0.0; L]);
    let (mut rr, mut sg, mut sgg, mut sfg) = ([0.0; L], [0.0; L], [0.0; L], [0.0; L]);
    for k in 0..element.ny as i32 {
        // The next chunk to the right, row by row: rows are a stride apart, more streams than the
        // hardware follows. The lowest tap row of each row is the one not seen before.
        prefetch(f.data, at + L);
        prefetch(fx.data, at + L);
        prefetch(fy.data, at + L);
        prefetch(deformed.data, taps_at + (K - 1) * deformed.stride + 2 * L);
        let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
        let [tx, ty] = row_displacement::<FMA, L>(corners, xi, eta);
        let mut g = interpolate::<FMA, S, K, L>(deformed, taps_at, &tx, &ty);
        light.row::<FMA, L>(xi, eta, &mut g);
        let (f, fx, fy) = (load::<_, L>(f.data, at), load::<_, L>(fx.data, at), load::<_, L>(fy.data, at));
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
        at += pass.f.stride;
        taps_at += deformed.stride;
    }
    let acc = Accumulators { b: [[bx, by], [ex, ey]], rr, g: sg, gg: sgg, fg: sfg };
    acc.finish::<FMA>(xi, sums);
}

#[inline(always)]
fn element_sums<const FMA: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    pass: &Pass<'_>,
    element: &ElementPixels,
    corners: &Corners,
    light: B,
    transfer: (f32, f32),
) -> ElementSums {
    let Pass { f, fx, fy, deformed, scalar, .. } = *pass;
    let mut sums = ElementSums::default();
    if !scalar && is_uniform::<K, L>(element, corners, deformed) {
        for column in (0..element.nx as usize).step_by(L) {
            let (_, xi, mask) = chunk::<L>(element, column);
            uniform_chunk::<FMA, S, K, L, B>(pass, element, corners, light, transfer, column, &xi, &mask, &mut sums);
        }
        sums.n = f32::from(element.nx) * f32::from(element.ny);
        return sums;
    }
    let mut column = 0;
    while column < element.nx as usize {
        let (lanes, xi, mask) = chunk::<L>(element, column);
        let mut acc = Accumulators::<L>::new();
        // Pixels counted in part, and the sums of f and f^2 over what is not.
        let [mut counted, mut f_lost, mut ff_lost] = [[0.0; L]; 3];
        let x = element.x + column as i32;
        for k in 0..element.ny as i32 {
            let y = element.y + k;
            let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
            let [ux, uy] = row_displacement::<FMA, L>(corners, &xi, eta);
            let to = [x + corners.whole[0], y + corners.whole[1]];
            let at = f.at(x as isize, y as isize);
            // The next chunk to the right, row by row: rows are a stride apart, more streams than the
            // hardware follows. The lowest tap row of each row is the one not seen before.
            prefetch(f.data, at + L);
            prefetch(fx.data, at + L);
            prefetch(fy.data, at + L);
            prefetch(deformed.data, next_taps(deformed, to, K / 2, 2 * L));
            let mut row = sample_row::<FMA, S, K, L>(deformed, scalar, to, lanes, &ux, &uy);
            light.row::<FMA, L>(&xi, eta, &mut row.g);
            let (f, fx, fy) = (load::<_, L>(f.data, at), load::<_, L>(fx.data, at), load::<_, L>(fy.data, at));
            if row.all_counted {
                acc.add::<FMA>(f, fx, fy, &row.g, &mask, transfer, eta);
                sums.n += lanes as f32;
            } else {
                acc.add::<FMA>(f, fx, fy, &row.g, &row.counted, transfer, eta);
                for i in 0..L {
                    let lost = mask[i] * (1.0 - row.counted[i]);
                    counted[i] += row.counted[i];
                    f_lost[i] += lost * f[i];
                    ff_lost[i] += lost * f[i] * f[i];
                }
            }
        }
        acc.finish::<FMA>(&xi, &mut sums);
        sums.n += total(&counted);
        sums.f_lost += total(&f_lost);
        sums.ff_lost += total(&ff_lost);
        column += L;
    }
    sums
}

/// Room for the grey levels of one element between the two passes of [`residual_sums_two_passes`].
#[derive(Debug, Default)]
pub(super) struct Scratch {
    g: Vec<f32>,
    counted: Vec<f32>,
}

impl Scratch {
    fn make_room(&mut self, n: usize) {
        self.g.resize(n, 0.0);
        self.counted.resize(n, 0.0);
    }

    #[inline(always)]
    fn put<const L: usize>(&mut self, at: usize, g: &[f32; L], counted: &[f32; L]) {
        self.g[at..at + L].copy_from_slice(g);
        self.counted[at..at + L].copy_from_slice(counted);
    }
}

multiversioned! {
    /// As [`residual_sums`] in two passes over an element: one that interpolates, and one that forms the residual.
    /// Between them gain and offset are eliminated in each element, and `transfer` receives what was fitted.
    pub(super) fn residual_sums_two_passes[S: Spline<K>, const K: usize, const L: usize][S, K, L](
        pass: &Pass<'_>, first: usize, corners: &[Corners], transfer: &mut [(f32, f32)], sums: &mut [ElementSums], scratch: &mut Scratch, spline: S,
    ) => residual_sums_two_passes_body
}

#[inline(always)]
fn residual_sums_two_passes_body<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_>,
    first: usize,
    corners: &[Corners],
    transfer: &mut [(f32, f32)],
    sums: &mut [ElementSums],
    scratch: &mut Scratch,
    _: S,
) {
    for (k, sums) in sums.iter_mut().enumerate() {
        let element = &pass.elements[first + k];
        let (corners, transfer) = (&corners[k], &mut transfer[k]);
        let of_element = if element.n_runs > 0 {
            run_sums_two_passes::<FMA, S, K, L>(pass, element, corners, transfer, scratch)
        } else {
            two_pass_sums::<FMA, S, K, L>(pass, element, corners, transfer, scratch)
        };
        *sums = of_element.times_unit(pass.unit);
    }
}

/// What gain and offset of an element are fitted to: sums over the pixels counted, in lanes.
struct Moments<const L: usize> {
    n: [f32; L],
    f: [f32; L],
    g: [f32; L],
    gg: [f32; L],
    fg: [f32; L],
}

impl<const L: usize> Moments<L> {
    const NONE: Self = Self { n: [0.0; L], f: [0.0; L], g: [0.0; L], gg: [0.0; L], fg: [0.0; L] };

    #[inline(always)]
    fn add<const FMA: bool>(&mut self, f: &[f32; L], g: &[f32; L], counted: &[f32; L]) {
        for i in 0..L {
            let wg = counted[i] * g[i];
            self.n[i] += counted[i];
            self.f[i] = mul_add::<FMA>(counted[i], f[i], self.f[i]);
            self.g[i] += wg;
            self.gg[i] = mul_add::<FMA>(wg, g[i], self.gg[i]);
            self.fg[i] = mul_add::<FMA>(wg, f[i], self.fg[i]);
        }
    }

    /// `[n, f, g, gg, fg]`, in `f64`: the fit subtracts nearly equal sums.
    #[inline(always)]
    fn totals(&self) -> [f64; 5] {
        [&self.n, &self.f, &self.g, &self.gg, &self.fg].map(|lanes| f64::from(total(lanes)))
    }
}

#[inline(always)]
fn two_pass_sums<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_>,
    element: &ElementPixels,
    corners: &Corners,
    transfer: &mut (f32, f32),
    scratch: &mut Scratch,
) -> ElementSums {
    let Pass { f, fx, fy, deformed, scalar, .. } = *pass;
    let rows = element.ny as usize;
    let chunks = (element.nx as usize).div_ceil(L);
    scratch.make_room(rows * chunks * L);
    let mut moments = [0.0f64; 5];
    let mut sums = ElementSums::default();
    for part in 0..chunks {
        let (lanes, xi, mask) = chunk::<L>(element, part * L);
        let x = element.x + (part * L) as i32;
        let mut of_part = Moments::<L>::NONE;
        for k in 0..rows {
            let y = element.y + k as i32;
            let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
            let [ux, uy] = row_displacement::<FMA, L>(corners, &xi, eta);
            let to = [x + corners.whole[0], y + corners.whole[1]];
            let row = sample_row::<FMA, S, K, L>(deformed, scalar, to, lanes, &ux, &uy);
            let counted = if row.all_counted { mask } else { row.counted };
            let f = load::<_, L>(f.data, f.at(x as isize, y as isize));
            of_part.add::<FMA>(f, &row.g, &counted);
            if !row.all_counted {
                for i in 0..lanes {
                    let lost = 1.0 - counted[i];
                    sums.f_lost += lost * f[i];
                    sums.ff_lost += lost * f[i] * f[i];
                }
            }
            scratch.put((part * rows + k) * L, &row.g, &counted);
        }
        moments.iter_mut().zip(of_part.totals()).for_each(|(all, part)| *all += part);
    }
    *transfer = fitted(&moments);
    sums.n = moments[0] as f32;
    for part in 0..chunks {
        let (_, xi, _) = chunk::<L>(element, part * L);
        let mut acc = Accumulators::<L>::new();
        for k in 0..rows {
            let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
            let at = f.at((element.x + (part * L) as i32) as isize, (element.y + k as i32) as isize);
            let (f, fx, fy) = (load::<_, L>(f.data, at), load::<_, L>(fx.data, at), load::<_, L>(fy.data, at));
            let at = (part * rows + k) * L;
            let (g, counted) = (load::<_, L>(&scratch.g, at), load::<_, L>(&scratch.counted, at));
            acc.add::<FMA>(f, fx, fy, g, counted, *transfer, eta);
        }
        acc.finish::<FMA>(&xi, &mut sums);
    }
    sums
}

/// Gain and offset that bring g closest to f, from the sums `[n, f, g, gg, fg]`.
#[inline(always)]
fn fitted(&[n, sf, sg, sgg, sfg]: &[f64; 5]) -> (f32, f32) {
    let (variance, covariance) = (n * sgg - sg * sg, n * sfg - sf * sg);
    // A flat element has no contrast to fit: keep the gain of 1.
    let gain = if variance > 0.0 && covariance > 0.0 { covariance / variance } else { 1.0 };
    let offset = if n > 0.0 { (sf - gain * sg) / n } else { 0.0 };
    (gain as f32, offset as f32)
}

/// Lane accumulators of an element whose pixels are runs with local coordinates of their own: cut by a mask, or of any shape.
struct RunAccumulators<const L: usize> {
    b: [[f32; L]; 8],
    rr: [f32; L],
    g: [f32; L],
    gg: [f32; L],
    fg: [f32; L],
    n: [f32; L],
}

impl<const L: usize> RunAccumulators<L> {
    const NONE: Self = Self { b: [[0.0; L]; 8], rr: [0.0; L], g: [0.0; L], gg: [0.0; L], fg: [0.0; L], n: [0.0; L] };

    /// Adds lanes `at` of the reference and `local` of the map, which count as `counted` says.
    #[inline(always)]
    fn add<const FMA: bool>(
        &mut self,
        pass: &Pass<'_>,
        [at, local]: [usize; 2],
        g: &[f32; L],
        counted: &[f32; L],
        (gain, offset): (f32, f32),
    ) {
        let (f, fx, fy) =
            (load::<_, L>(pass.f.data, at), load::<_, L>(pass.fx.data, at), load::<_, L>(pass.fy.data, at));
        let (xi, eta) = (load::<_, L>(pass.map.xi(), local), load::<_, L>(pass.map.eta(), local));
        for i in 0..L {
            let difference = mul_add::<FMA>(-gain, g[i], f[i] - offset);
            let (r, wg) = (counted[i] * difference, counted[i] * g[i]);
            self.rr[i] = mul_add::<FMA>(r, difference, self.rr[i]);
            self.g[i] += wg;
            self.gg[i] = mul_add::<FMA>(wg, g[i], self.gg[i]);
            self.fg[i] = mul_add::<FMA>(f[i], wg, self.fg[i]);
            self.n[i] += counted[i];
            let (rx, ry) = (r * f32::from(fx[i]), r * f32::from(fy[i]));
            let (far, near) = (xi[i] * eta[i], 1.0 - eta[i]);
            let psi = [near - xi[i] * near, xi[i] * near, far, eta[i] - far];
            for a in 0..4 {
                self.b[2 * a][i] = mul_add::<FMA>(psi[a], rx, self.b[2 * a][i]);
                self.b[2 * a + 1][i] = mul_add::<FMA>(psi[a], ry, self.b[2 * a + 1][i]);
            }
        }
    }

    #[inline(always)]
    fn finish(&self, sums: &mut ElementSums) {
        for (sum, lanes) in sums.b.iter_mut().zip(&self.b) {
            *sum = total(lanes);
        }
        [sums.rr, sums.g, sums.gg, sums.fg, sums.n] = [&self.rr, &self.g, &self.gg, &self.fg, &self.n].map(total);
    }
}

/// Lanes of one run of pixels.
struct OfRun<const L: usize> {
    /// Where they are in the planes of the reference, and in the map.
    at: [usize; 2],
    g: [f32; L],
    counted: [f32; L],
}

/// The runs of an element, lanes by lanes: each with the column of the run.
#[inline(always)]
fn parts<const L: usize>(runs: &[Run]) -> impl Iterator<Item = (&Run, usize)> {
    runs.iter().flat_map(|run| (0..run.n as usize).step_by(L).map(move |column| (run, column)))
}

/// Brings the deformed image to lanes of a run, and adds to `sums` what is not counted.
#[inline(always)]
fn of_run<const FMA: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    pass: &Pass<'_>,
    (run, column): (&Run, usize),
    corners: &Corners,
    light: B,
    sums: &mut ElementSums,
) -> OfRun<L> {
    let Pass { map, f, deformed, scalar, .. } = *pass;
    let lanes = (run.n as usize - column).min(L);
    let [x, y] = [run.x + column as i32, run.y];
    let at = [f.at(x as isize, y as isize), run.at as usize + column];
    let (xi, eta) = (load::<_, L>(map.xi(), at[1]), load::<_, L>(map.eta(), at[1]));
    let [ux, uy] = corners.displacement::<FMA, L>(xi, eta);
    let to = [x + corners.whole[0], y + corners.whole[1]];
    let mut row = sample_lanes::<FMA, S, K, L>(deformed, scalar, to, lanes, &ux, &uy);
    light.lanes::<FMA, L>(xi, eta, &mut row.g);
    let mut counted = [0.0; L];
    if row.all_counted {
        for i in 0..L {
            counted[i] = if i < lanes { 1.0 } else { 0.0 };
        }
    } else {
        let f = load::<_, L>(f.data, at[0]);
        counted[..lanes].copy_from_slice(&row.counted[..lanes]);
        for i in 0..lanes {
            let lost = 1.0 - counted[i];
            sums.f_lost += lost * f[i];
            sums.ff_lost += lost * f[i] * f[i];
        }
    }
    OfRun { at, g: row.g, counted }
}

/// Sums of an element whose pixels are runs.
#[inline(always)]
fn run_sums<const FMA: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    pass: &Pass<'_>,
    element: &ElementPixels,
    corners: &Corners,
    light: B,
    transfer: (f32, f32),
) -> ElementSums {
    let (mut sums, mut acc) = (ElementSums::default(), RunAccumulators::<L>::NONE);
    for part in parts::<L>(pass.map.runs_of(element)) {
        let OfRun { at, g, counted } = of_run::<FMA, S, K, L, B>(pass, part, corners, light, &mut sums);
        acc.add::<FMA>(pass, at, &g, &counted, transfer);
    }
    acc.finish(&mut sums);
    sums
}

/// As [`run_sums`], with gain and offset fitted to the element between two passes, into `transfer`.
#[inline(always)]
fn run_sums_two_passes<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_>,
    element: &ElementPixels,
    corners: &Corners,
    transfer: &mut (f32, f32),
    scratch: &mut Scratch,
) -> ElementSums {
    let Pass { map, f, .. } = *pass;
    let runs = map.runs_of(element);
    scratch.make_room(parts::<L>(runs).count() * L);
    let (mut sums, mut moments) = (ElementSums::default(), Moments::<L>::NONE);
    for (k, part) in parts::<L>(runs).enumerate() {
        let OfRun { at, g, counted } = of_run::<FMA, S, K, L, _>(pass, part, corners, AsItIs, &mut sums);
        moments.add::<FMA>(load::<_, L>(f.data, at[0]), &g, &counted);
        scratch.put(k * L, &g, &counted);
    }
    *transfer = fitted(&moments.totals());
    let mut acc = RunAccumulators::<L>::NONE;
    for (k, (run, column)) in parts::<L>(runs).enumerate() {
        let at = [f.at((run.x + column as i32) as isize, run.y as isize), run.at as usize + column];
        let (g, counted) = (load::<_, L>(&scratch.g, k * L), load::<_, L>(&scratch.counted, k * L));
        acc.add::<FMA>(pass, at, g, counted, *transfer);
    }
    acc.finish(&mut sums);
    sums
}
