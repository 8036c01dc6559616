//! The sums of [`BentSums`], of some elements of a frame, and of [`BentMoments`], when an element is first looked at.

use super::corners::{Brings, Corners, Light, row_displacement};
use super::lanes::Lanes;
use super::pass::{Pass, chunk, total};
use super::reference::{Reference, parts};
use super::residual_runs::{OfRun, of_run};
use super::sample::{load, sample_row};
use crate::backend::bend::{BentMoments, BentSums, N_PRODUCTS, OF_GREY, POWERS, product};
use crate::backend::spline::Spline;
use crate::isa::{mul_add, multiversioned};
use crate::mesh::ElementPixels;

/// Highest power of a residual, and of products of two columns.
const MOST: usize = 3;
const MOST_OF_PRODUCTS: usize = 6;

multiversioned! {
    /// Sums of `elements`; `corners`, `transfer` (gain, offset) and `sums` run over them, `light` over all there are, where
    /// there is any.
    pub(super) fn bent_sums[S: Spline<K>, const K: usize, const L: usize][S, K, L](
        pass: &Pass<'_, L>, elements: &[u32], corners: &[Corners], transfer: &[(f32, f32)], light: Option<&[Light]>,
        sums: &mut [BentSums], spline: S,
    ) => bent_sums_body
}

#[inline(always)]
fn bent_sums_body<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_, L>,
    elements: &[u32],
    corners: &[Corners],
    transfer: &[(f32, f32)],
    light: Option<&[Light]>,
    sums: &mut [BentSums],
    _: S,
) {
    for (k, sums) in sums.iter_mut().enumerate() {
        let number = elements[k] as usize;
        let (element, lanes) = pass.element(number);
        let light = light.map_or(Light::NONE, |light| light[number]);
        *sums = if element.n_runs > 0 {
            sums_of_runs::<FMA, S, K, L>(pass, (element, lanes), &corners[k], &light, transfer[k])
        } else {
            sums_of::<FMA, S, K, L>(pass, (element, lanes), &corners[k], &light, transfer[k])
        };
        sums.along[..OF_GREY].iter_mut().for_each(|sum| *sum *= f64::from(pass.unit));
    }
}

/// Sums of a rectangle of pixels. Lanes accumulate the powers of w down the rows of a chunk of columns; those of z come
/// once, at the end.
#[inline(always)]
fn sums_of<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_, L>,
    (element, lanes): (&ElementPixels, &[Lanes<L>]),
    corners: &Corners,
    light: &Light,
    (gain, offset): (f32, f32),
) -> BentSums {
    let Pass { deformed, scalar, .. } = *pass;
    let mut sums = BentSums::default();
    if corners.is_outside(element, deformed) {
        return sums;
    }
    let rows = usize::from(element.ny).max(1);
    for (column, lanes) in (0..).step_by(L).zip(lanes.chunks_exact(rows)) {
        let (n, xi, mask) = chunk::<L>(element, column);
        let x = element.x + column as i32;
        let mut acc = [[[0.0f32; L]; MOST + 1]; 2];
        let [mut rf, mut r1, mut rr, mut counted] = [[0.0f32; L]; 4];
        for (k, Lanes { f, fx, fy }) in lanes.iter().enumerate() {
            let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
            let w = 2.0 * eta - 1.0;
            let [ux, uy] = row_displacement::<FMA, L>(corners, &xi, eta);
            let to = [x + corners.whole[0], element.y + k as i32 + corners.whole[1]];
            let mut row = sample_row::<FMA, S, K, L>(deformed, scalar, to, n, &ux, &uy);
            light.row::<FMA, L>(&xi, eta, &mut row.g);
            let weight = if row.all_counted { mask } else { row.counted };
            let mut terms = [[0.0f32; L]; 2];
            for i in 0..L {
                let difference = mul_add::<FMA>(-gain, row.g[i], f[i] - offset);
                let r = weight[i] * difference;
                terms[0][i] = r * f32::from(fx[i]);
                terms[1][i] = r * f32::from(fy[i]);
                rf[i] = mul_add::<FMA>(r, f[i], rf[i]);
                r1[i] += r;
                rr[i] = mul_add::<FMA>(r, difference, rr[i]);
                counted[i] += weight[i];
            }
            add_powers(&mut acc, terms, w);
        }
        for (c, acc) in acc.iter().enumerate() {
            for (of, &[a, b]) in sums.along[c * POWERS.len()..][..POWERS.len()].iter_mut().zip(&POWERS) {
                *of += times_power(&acc[b], &xi, a);
            }
        }
        sums.along[OF_GREY] += f64::from(total(&rf));
        sums.along[OF_GREY + 1] += f64::from(total(&r1));
        sums.rr += f64::from(total(&rr));
        sums.n += f64::from(total(&counted));
    }
    sums
}

/// Adds the terms times each power of w. Lanes are the innermost loop, or the compiler makes no vectors of it.
#[inline(always)]
fn add_powers<const P: usize, const B: usize, const L: usize>(
    acc: &mut [[[f32; L]; B]; P],
    mut terms: [[f32; L]; P],
    w: f32,
) {
    for (acc, terms) in acc.iter_mut().zip(&mut terms) {
        for acc in acc.iter_mut() {
            for i in 0..L {
                acc[i] += terms[i];
                terms[i] *= w;
            }
        }
    }
}

/// The lanes times `z^a`, added up.
#[inline(always)]
fn times_power<const L: usize>(lanes: &[f32; L], xi: &[f32; L], a: usize) -> f64 {
    let mut terms = *lanes;
    for _ in 0..a {
        for i in 0..L {
            terms[i] *= 2.0 * xi[i] - 1.0;
        }
    }
    f64::from(total(&terms))
}

/// Sums of an element whose pixels are runs.
#[inline(always)]
fn sums_of_runs<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_, L>,
    (element, lanes): (&ElementPixels, &[Lanes<L>]),
    corners: &Corners,
    light: &Light,
    (gain, offset): (f32, f32),
) -> BentSums {
    let (mut sums, mut lost) = (BentSums::default(), Default::default());
    for (part, Lanes { f, fx, fy }) in parts::<L>(pass.map.runs_of(element)).zip(lanes) {
        let OfRun { local, g, counted } = of_run::<FMA, S, K, L, _>(pass, part, f, corners, light, &mut lost);
        let (xi, eta) = (load::<_, L>(pass.map.xi(), local), load::<_, L>(pass.map.eta(), local));
        for i in 0..L {
            let difference = f64::from(mul_add::<FMA>(-gain, g[i], f[i] - offset));
            let r = f64::from(counted[i]) * difference;
            let powers = powers_at(xi[i], eta[i]);
            for (k, power) in powers.iter().enumerate() {
                sums.along[k] += r * f64::from(fx[i]) * power;
                sums.along[POWERS.len() + k] += r * f64::from(fy[i]) * power;
            }
            sums.along[OF_GREY] += r * f64::from(f[i]);
            sums.along[OF_GREY + 1] += r;
            sums.rr += r * difference;
            sums.n += f64::from(counted[i]);
        }
    }
    sums
}

fn powers_at(xi: f32, eta: f32) -> [f64; POWERS.len()] {
    let [z, w] = [xi, eta].map(|v| 2.0 * f64::from(v) - 1.0);
    POWERS.map(|[a, b]| z.powi(a as i32) * w.powi(b as i32))
}

multiversioned! {
    /// Moments of `elements`.
    pub(super) fn bent_moments[const L: usize][L](reference: &Reference, elements: &[u32], moments: &mut [BentMoments])
        => bent_moments_body
}

#[inline(always)]
fn bent_moments_body<const FMA: bool, const L: usize>(
    reference: &Reference,
    elements: &[u32],
    moments: &mut [BentMoments],
) {
    for (&number, moments) in elements.iter().zip(moments) {
        let number = number as usize;
        if reference.elements[number].n_runs > 0 {
            *moments = moments_of_runs::<L>(reference, number);
            continue;
        }
        *moments = moments_of::<FMA, L>(reference, number);
        let unit = f64::from(reference.unit);
        moments.gradient.as_flattened_mut().iter_mut().for_each(|sum| *sum *= unit * unit);
        moments.grey.as_flattened_mut().iter_mut().for_each(|sum| *sum *= unit);
    }
}

/// As [`sums_of`].
#[inline(always)]
fn moments_of<const FMA: bool, const L: usize>(reference: &Reference, number: usize) -> BentMoments {
    let (lanes, element) = (&reference.lanes::<L>()[reference.range(number)], &reference.elements[number]);
    let mut moments = BentMoments::default();
    for (column, lanes) in (0..).step_by(L).zip(lanes.chunks_exact(usize::from(element.ny).max(1))) {
        let (n, xi, mask) = chunk::<L>(element, column);
        let mut of_products = [[[0.0f32; L]; MOST_OF_PRODUCTS + 1]; 3];
        let mut of_powers = [[[0.0f32; L]; MOST + 1]; 4];
        let [mut ff, mut f1] = [[0.0f32; L]; 2];
        for (k, Lanes { f, fx, fy }) in lanes.iter().enumerate() {
            let w = 2.0 * mul_add::<FMA>(k as f32, element.deta, element.eta0) - 1.0;
            let (mut products, mut powers) = ([[0.0f32; L]; 3], [[0.0f32; L]; 4]);
            for i in 0..L {
                let (gx, gy, f) = (mask[i] * f32::from(fx[i]), mask[i] * f32::from(fy[i]), mask[i] * f[i]);
                (products[0][i], products[1][i], products[2][i]) = (gx * gx, gx * gy, gy * gy);
                (powers[0][i], powers[1][i], powers[2][i], powers[3][i]) = (gx * f, gy * f, gx, gy);
                ff[i] = mul_add::<FMA>(f, f, ff[i]);
                f1[i] += f;
            }
            add_powers(&mut of_products, products, w);
            add_powers(&mut of_powers, powers, w);
        }
        for (acc, sums) in of_products.iter().zip(&mut moments.gradient) {
            for a in 0..=MOST_OF_PRODUCTS {
                for b in 0..=MOST_OF_PRODUCTS - a {
                    sums[product(a, b)] += times_power(&acc[b], &xi, a);
                }
            }
        }
        for (acc, sums) in of_powers.iter().zip(&mut moments.grey) {
            for (sum, &[a, b]) in sums.iter_mut().zip(&POWERS) {
                *sum += times_power(&acc[b], &xi, a);
            }
        }
        moments.of_grey[0] += f64::from(total(&ff));
        moments.of_grey[1] += f64::from(total(&f1));
        moments.of_grey[2] += (n * lanes.len()) as f64;
    }
    moments
}

fn moments_of_runs<const L: usize>(reference: &Reference, number: usize) -> BentMoments {
    let mut moments = BentMoments::default();
    reference.for_each::<L>(number, |_, [xi, eta], f, gradient| {
        let [z, w] = [xi, eta].map(|v| 2.0 * f64::from(v) - 1.0);
        let ([fx, fy], f) = (gradient.map(f64::from), f64::from(f));
        let mut products = [0.0; N_PRODUCTS];
        for a in 0..=MOST_OF_PRODUCTS {
            (0..=MOST_OF_PRODUCTS - a).for_each(|b| products[product(a, b)] = z.powi(a as i32) * w.powi(b as i32));
        }
        for (sums, of) in moments.gradient.iter_mut().zip([fx * fx, fx * fy, fy * fy]) {
            sums.iter_mut().zip(products).for_each(|(sum, product)| *sum += of * product);
        }
        for (sums, of) in moments.grey.iter_mut().zip([f * fx, f * fy, fx, fy]) {
            sums.iter_mut().zip(powers_at(xi, eta)).for_each(|(sum, power)| *sum += of * power);
        }
        moments.of_grey.iter_mut().zip([f * f, f, 1.0]).for_each(|(sum, of)| *sum += of);
    });
    moments
}
