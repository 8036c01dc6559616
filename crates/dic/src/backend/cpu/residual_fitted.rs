//! The residual pass where every element has a gain and an offset of its own: one pass that interpolates, one that
//! forms the residual, and between them the fit.

use super::corners::{AsItIs, Corners, row_displacement};
use super::lanes::Lanes;
use super::pass::{ElementSums, Pass, chunk, total};
use super::reference::parts;
use super::residual::Accumulators;
use super::residual_runs::{OfRun, RunAccumulators, of_run};
use super::sample::{load, sample_row};
use crate::backend::spline::Spline;
use crate::isa::{mul_add, multiversioned};
use crate::mesh::ElementPixels;

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
        pass: &Pass<'_, L>, first: usize, corners: &[Corners], transfer: &mut [(f32, f32)], sums: &mut [ElementSums], scratch: &mut Scratch, spline: S,
    ) => residual_sums_two_passes_body
}

#[inline(always)]
fn residual_sums_two_passes_body<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_, L>,
    first: usize,
    corners: &[Corners],
    transfer: &mut [(f32, f32)],
    sums: &mut [ElementSums],
    scratch: &mut Scratch,
    _: S,
) {
    for (k, sums) in sums.iter_mut().enumerate() {
        let element = pass.element(first + k);
        let (corners, transfer) = (&corners[k], &mut transfer[k]);
        let of_element = if element.0.n_runs > 0 {
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
    pass: &Pass<'_, L>,
    (element, lanes): (&ElementPixels, &[Lanes<L>]),
    corners: &Corners,
    transfer: &mut (f32, f32),
    scratch: &mut Scratch,
) -> ElementSums {
    let Pass { deformed, scalar, .. } = *pass;
    let rows = element.ny as usize;
    let chunks = (element.nx as usize).div_ceil(L);
    scratch.make_room(rows * chunks * L);
    let mut moments = [0.0f64; 5];
    let mut sums = ElementSums::default();
    for part in 0..chunks {
        let (n, xi, mask) = chunk::<L>(element, part * L);
        let x = element.x + (part * L) as i32;
        let mut of_part = Moments::<L>::NONE;
        for (k, Lanes { f, .. }) in lanes[part * rows..][..rows].iter().enumerate() {
            let y = element.y + k as i32;
            let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
            let [ux, uy] = row_displacement::<FMA, L>(corners, &xi, eta);
            let to = [x + corners.whole[0], y + corners.whole[1]];
            let row = sample_row::<FMA, S, K, L>(deformed, scalar, to, n, &ux, &uy);
            let counted = if row.all_counted { mask } else { row.counted };
            of_part.add::<FMA>(f, &row.g, &counted);
            if !row.all_counted {
                for i in 0..n {
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
        for (k, lanes) in lanes[part * rows..][..rows].iter().enumerate() {
            let eta = mul_add::<FMA>(k as f32, element.deta, element.eta0);
            let at = (part * rows + k) * L;
            let (g, counted) = (load::<_, L>(&scratch.g, at), load::<_, L>(&scratch.counted, at));
            acc.add::<FMA>(lanes, g, counted, *transfer, eta);
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

/// As [`run_sums`], with gain and offset fitted to the element between two passes, into `transfer`.
#[inline(always)]
fn run_sums_two_passes<const FMA: bool, S: Spline<K>, const K: usize, const L: usize>(
    pass: &Pass<'_, L>,
    (element, lanes): (&ElementPixels, &[Lanes<L>]),
    corners: &Corners,
    transfer: &mut (f32, f32),
    scratch: &mut Scratch,
) -> ElementSums {
    let runs = pass.map.runs_of(element);
    scratch.make_room(lanes.len() * L);
    let (mut sums, mut moments) = (ElementSums::default(), Moments::<L>::NONE);
    for (k, (part, Lanes { f, .. })) in parts::<L>(runs).zip(lanes).enumerate() {
        let OfRun { g, counted, .. } = of_run::<FMA, S, K, L, _>(pass, part, f, corners, AsItIs, &mut sums);
        moments.add::<FMA>(f, &g, &counted);
        scratch.put(k * L, &g, &counted);
    }
    *transfer = fitted(&moments.totals());
    let mut acc = RunAccumulators::<L>::NONE;
    for (k, ((run, column), lanes)) in parts::<L>(runs).zip(lanes).enumerate() {
        let (g, counted) = (load::<_, L>(&scratch.g, k * L), load::<_, L>(&scratch.counted, k * L));
        acc.add::<FMA>(pass, (lanes, run.at as usize + column), g, counted, *transfer);
    }
    acc.finish(&mut sums);
    sums
}
