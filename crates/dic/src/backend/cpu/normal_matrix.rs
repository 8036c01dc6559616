//! Moments of the reference gradient per element, from which the normal matrices are made (THEORY 2):
//! 27 sums instead of the 36 entries (see [`ElementMoments`]).

use super::corners::Corners;
use super::lanes::Lanes;
use super::pass::{chunk, total};
use super::plane::Plane;
use super::reference::Reference;
use crate::backend::ElementMoments;
use crate::isa::{mul_add, multiversioned};
use crate::mesh::ElementPixels;

multiversioned! {
    /// Moments of the elements from `first` on; the coupling with the transfer only when asked for.
    pub(super) fn element_moments[const L: usize][L](reference: &Reference, first: usize, with_transfer: bool, moments: &mut [ElementMoments])
        => element_moments_body
}

#[inline(always)]
fn element_moments_body<const FMA: bool, const L: usize>(
    reference: &Reference,
    first: usize,
    with_transfer: bool,
    moments: &mut [ElementMoments],
) {
    for (k, moments) in moments.iter_mut().enumerate() {
        let (number, element) = (first + k, &reference.elements[first + k]);
        if element.n_runs > 0 {
            *moments = partial_moments::<L>(reference, number, with_transfer, |_, _, _| 1.0);
            continue;
        }
        *moments = one_element::<FMA, L>(reference, number, |_, _, _, _, mask| *mask);
        moments.n = f64::from(element.nx) * f64::from(element.ny);
        if with_transfer {
            moments.transfer = coupling_of_one::<FMA, L>(reference, number);
        }
    }
}

multiversioned! {
    /// What is left of the elements `lost`, whose corners in the deformed image are `corners` (of all elements).
    pub(super) fn remaining_moments[const L: usize][L](reference: &Reference, lost: &[usize], corners: &[Corners], deformed: &Plane, with_transfer: bool, moments: &mut [ElementMoments])
        => remaining_moments_body
}

#[inline(always)]
fn remaining_moments_body<const FMA: bool, const L: usize>(
    reference: &Reference,
    lost: &[usize],
    corners: &[Corners],
    deformed: &Plane,
    with_transfer: bool,
    moments: &mut [ElementMoments],
) {
    for (&number, moments) in lost.iter().zip(moments) {
        let corners = &corners[number];
        if reference.elements[number].n_runs > 0 || with_transfer {
            let weight = |[x, y]: [i32; 2], xi, eta| corners.weights(x, y, &[xi], eta, deformed)[0];
            *moments = partial_moments::<L>(reference, number, with_transfer, weight);
            continue;
        }
        let mut n = 0.0;
        *moments = one_element::<FMA, L>(reference, number, |x, y, xi, eta, mask| {
            let mut weights = corners.weights(x, y, xi, eta, deformed);
            for i in 0..L {
                weights[i] *= mask[i];
            }
            n += f64::from(total(&weights));
            weights
        });
        moments.n = n;
    }
}

/// The sums of a rectangle of pixels, but for their number; `weights` are those of lanes from a column on in a row (at
/// xi and eta), of which the mask says which belong to the element.
#[inline(always)]
fn one_element<const FMA: bool, const L: usize>(
    reference: &Reference,
    element: usize,
    mut weights: impl FnMut(i32, i32, &[f32; L], f32, &[f32; L]) -> [f32; L],
) -> ElementMoments {
    let (lanes, element) = (&reference.lanes::<L>()[reference.range(element)], &reference.elements[element]);
    let mut moments = ElementMoments::default();
    for (column, lanes) in (0..).step_by(L).zip(lanes.chunks_exact(rows_of(element))) {
        let (_, xi, mask) = chunk::<L>(element, column);
        // Products fx fx, fx fy, fy fy times 1, eta, eta^2; the other weights follow from these.
        let mut acc = [[[0.0f32; L]; 3]; 3];
        let (mut sf, mut sff) = ([0.0f32; L], [0.0f32; L]);
        for (k, Lanes { f, fx, fy }) in lanes.iter().enumerate() {
            let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
            let (x, y) = (element.x + column as i32, element.y + k as i32);
            let weight = weights(x, y, &xi, eta, &mask);
            for i in 0..L {
                let (fx, fy) = (f32::from(fx[i]), f32::from(fy[i]));
                let (gx, gy, grey) = (weight[i] * fx, weight[i] * fy, weight[i] * f[i]);
                for (p, value) in [gx * fx, gx * fy, gy * fy].into_iter().enumerate() {
                    let first = eta * value;
                    acc[p][0][i] += value;
                    acc[p][1][i] += first;
                    acc[p][2][i] = mul_add::<FMA>(eta, first, acc[p][2][i]);
                }
                sf[i] += grey;
                sff[i] = mul_add::<FMA>(grey, f[i], sff[i]);
            }
        }
        moments.f += f64::from(total(&sf));
        moments.ff += f64::from(total(&sff));
        for (acc, moments) in acc.iter().zip(&mut moments.gradient) {
            let mut powers = [[0.0f64; 3]; 3];
            for (acc, powers) in acc.iter().zip(&mut powers) {
                let (mut one, mut two) = ([0.0; L], [0.0; L]);
                for i in 0..L {
                    one[i] = xi[i] * acc[i];
                    two[i] = xi[i] * one[i];
                }
                *powers = [f64::from(total(acc)), f64::from(total(&one)), f64::from(total(&two))];
            }
            let along = powers.map(shape_products);
            for w in 0..3 {
                let column = shape_products([along[0][w], along[1][w], along[2][w]]);
                for (q, value) in column.into_iter().enumerate() {
                    moments[q][w] += value;
                }
            }
        }
    }
    let unit = f64::from(reference.unit);
    moments.gradient.as_flattened_mut().as_flattened_mut().iter_mut().for_each(|sum| *sum *= unit * unit);
    moments
}

/// Rows of the lanes of a rectangle of pixels.
#[inline(always)]
fn rows_of(element: &ElementPixels) -> usize {
    usize::from(element.ny).max(1)
}

/// Sums weighted by (1-s)^2, s (1-s), s^2 from those weighted by 1, s, s^2.
#[inline(always)]
fn shape_products([zero, one, two]: [f64; 3]) -> [f64; 3] {
    [zero - 2.0 * one + two, one - two, two]
}

/// [`transfer_coupling`] of a rectangle of pixels.
#[inline(always)]
fn coupling_of_one<const FMA: bool, const L: usize>(reference: &Reference, element: usize) -> [[f64; 8]; 2] {
    let (lanes, element) = (&reference.lanes::<L>()[reference.range(element)], &reference.elements[element]);
    let mut sums = [[0.0; 8]; 2];
    for (column, lanes) in (0..).step_by(L).zip(lanes.chunks_exact(rows_of(element))) {
        let (_, xi, mask) = chunk::<L>(element, column);
        // f fx, f fy, fx, fy times 1 and eta.
        let mut acc = [[[0.0f32; L]; 2]; 4];
        for (k, Lanes { f, fx, fy }) in lanes.iter().enumerate() {
            let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
            for i in 0..L {
                let (gx, gy) = (mask[i] * f32::from(fx[i]), mask[i] * f32::from(fy[i]));
                for (p, value) in [gx * f[i], gy * f[i], gx, gy].into_iter().enumerate() {
                    acc[p][0][i] += value;
                    acc[p][1][i] = mul_add::<FMA>(eta, value, acc[p][1][i]);
                }
            }
        }
        for (p, acc) in acc.iter().enumerate() {
            let [[all, far_x], [far_y, far]] = [0, 1].map(|w| {
                let mut along = [0.0; L];
                for i in 0..L {
                    along[i] = xi[i] * acc[w][i];
                }
                [f64::from(total(&acc[w])), f64::from(total(&along))]
            });
            for (a, of_corner) in [all - far_x - far_y + far, far_x - far, far, far_y - far].into_iter().enumerate() {
                sums[p / 2][2 * a + p % 2] += of_corner;
            }
        }
    }
    sums.map(|of| of.map(|sum| sum * f64::from(reference.unit)))
}

/// `sum psi_a grad f` times f and times 1, each pixel by its weight (of column and row, xi, eta).
fn transfer_coupling<const L: usize>(
    reference: &Reference,
    element: usize,
    weight: impl Fn([i32; 2], f32, f32) -> f32,
) -> [[f64; 8]; 2] {
    let mut sums = [[0.0; 8]; 2];
    for_each_pixel::<L>(reference, element, weight, |weight, psi, f, gradient| {
        for (i, sum) in (0..8).map(|i| (i, weight * psi[i / 2] * gradient[i % 2])) {
            sums[0][i] += sum * f;
            sums[1][i] += sum;
        }
    });
    sums
}

/// Moments with a weight per pixel (of column and row, xi, eta), in plain f64 loops: for elements whose pixels are
/// no rectangle, and the few that a frame has moved partly out of the image.
fn partial_moments<const L: usize>(
    reference: &Reference,
    element: usize,
    with_transfer: bool,
    weight: impl Fn([i32; 2], f32, f32) -> f32,
) -> ElementMoments {
    let mut moments = ElementMoments::default();
    for_each_pixel::<L>(reference, element, &weight, |weight, psi, f, [fx, fy]| {
        let (xi, eta) = (psi[1] + psi[2], psi[2] + psi[3]);
        let (wx, wy) = (shape_products([1.0, xi, xi * xi]), shape_products([1.0, eta, eta * eta]));
        for (p, value) in [fx * fx, fx * fy, fy * fy].into_iter().enumerate() {
            for q in 0..3 {
                for w in 0..3 {
                    moments.gradient[p][q][w] += weight * value * wy[q] * wx[w];
                }
            }
        }
        moments.n += weight;
        moments.f += weight * f;
        moments.ff += weight * f * f;
    });
    if with_transfer {
        moments.transfer = transfer_coupling::<L>(reference, element, weight);
    }
    moments
}

fn for_each_pixel<const L: usize>(
    reference: &Reference,
    element: usize,
    weight: impl Fn([i32; 2], f32, f32) -> f32,
    mut visit: impl FnMut(f64, [f64; 4], f64, [f64; 2]),
) {
    reference.for_each::<L>(element, |at, [xi, eta], f, gradient| {
        let weight = f64::from(weight(at, xi, eta));
        let psi = crate::mesh::shape_functions(f64::from(xi), f64::from(eta));
        visit(weight, psi, f64::from(f), gradient.map(f64::from));
    });
}
