//! The residual pass over elements whose pixels are runs with local coordinates of their own: cut by a mask, or of any
//! shape.

use super::corners::{Brings, Corners};
use super::lanes::Lanes;
use super::pass::{ElementSums, Pass, total};
use super::reference::parts;
use super::sample::{load, sample_lanes};
use crate::backend::spline::Spline;
use crate::isa::mul_add;
use crate::mesh::{ElementPixels, Run};

/// Lane accumulators of an element whose pixels are runs with local coordinates of their own: cut by a mask, or of any
/// shape.
pub(super) struct RunAccumulators<const L: usize> {
    b: [[f32; L]; 8],
    rr: [f32; L],
    g: [f32; L],
    gg: [f32; L],
    fg: [f32; L],
    n: [f32; L],
}

impl<const L: usize> RunAccumulators<L> {
    pub const NONE: Self =
        Self { b: [[0.0; L]; 8], rr: [0.0; L], g: [0.0; L], gg: [0.0; L], fg: [0.0; L], n: [0.0; L] };

    /// Adds `lanes` of the reference, from `local` of the map on, which count as `counted` says.
    #[inline(always)]
    pub fn add<const FMA: bool>(
        &mut self,
        pass: &Pass<'_, L>,
        (lanes, local): (&Lanes<L>, usize),
        g: &[f32; L],
        counted: &[f32; L],
        (gain, offset): (f32, f32),
    ) {
        let Lanes { f, fx, fy } = lanes;
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
    pub fn finish(&self, sums: &mut ElementSums) {
        for (sum, lanes) in sums.b.iter_mut().zip(&self.b) {
            *sum = total(lanes);
        }
        [sums.rr, sums.g, sums.gg, sums.fg, sums.n] = [&self.rr, &self.g, &self.gg, &self.fg, &self.n].map(total);
    }
}

/// Lanes of one run of pixels.
pub(super) struct OfRun<const L: usize> {
    /// Where they are in the map.
    pub local: usize,
    pub g: [f32; L],
    pub counted: [f32; L],
}

/// Brings the deformed image to lanes of a run, and adds to `sums` what is not counted.
#[inline(always)]
pub(super) fn of_run<const FMA: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    pass: &Pass<'_, L>,
    (run, column): (&Run, usize),
    f: &[f32; L],
    corners: &Corners,
    light: B,
    sums: &mut ElementSums,
) -> OfRun<L> {
    let Pass { map, deformed, scalar, .. } = *pass;
    let lanes = (run.n as usize - column).min(L);
    let [x, y] = [run.x + column as i32, run.y];
    let local = run.at as usize + column;
    let (xi, eta) = (load::<_, L>(map.xi(), local), load::<_, L>(map.eta(), local));
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
        counted[..lanes].copy_from_slice(&row.counted[..lanes]);
        for i in 0..lanes {
            let lost = 1.0 - counted[i];
            sums.f_lost += lost * f[i];
            sums.ff_lost += lost * f[i] * f[i];
        }
    }
    OfRun { local, g: row.g, counted }
}

/// Sums of an element whose pixels are runs.
#[inline(always)]
pub(super) fn run_sums<const FMA: bool, S: Spline<K>, const K: usize, const L: usize, B: Brings>(
    pass: &Pass<'_, L>,
    (element, lanes): (&ElementPixels, &[Lanes<L>]),
    corners: &Corners,
    light: B,
    transfer: (f32, f32),
) -> ElementSums {
    let (mut sums, mut acc) = (ElementSums::default(), RunAccumulators::<L>::NONE);
    for (part, lanes) in parts::<L>(pass.map.runs_of(element)).zip(lanes) {
        let OfRun { local, g, counted } = of_run::<FMA, S, K, L, B>(pass, part, &lanes.f, corners, light, &mut sums);
        acc.add::<FMA>(pass, (lanes, local), &g, &counted, transfer);
    }
    acc.finish(&mut sums);
    sums
}
