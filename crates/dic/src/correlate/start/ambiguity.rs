//! Displacements that the images tell but for multiples of a period: which of them is given, and what is said of it.

use crate::backend::{Backend, GreyTransfer, PixelSums};
use crate::correlate::{
    Ambiguity, COARSE, Correlation, Correlator, LEAST_INSIDE, Limits, Result, Start, elements_of, iterate, nothing,
    numbers, periods,
};
use crate::field::Status;
use crate::mesh::{Mesh, PixelSet};
use crate::units::Px;
use std::cmp::Ordering;

/// Periods that a displacement is brought nearer to what was expected by, at most.
const MOST_PERIODS: usize = 24;
/// A displacement that is a period off matches as well when its correlation coefficient is less by no more than this,
const AS_WELL: f64 = 0.005;
/// clearly better when it is more by this,
const CLEARLY: f64 = 0.02;
/// and well enough for doubt when it is less by this share only.
const FEW: f64 = 0.05;

struct Beside {
    /// By how much in each zone; none where the texture does not repeat.
    shifts: Vec<Option<[f64; 2]>>,
    /// Correlation coefficient of each zone there.
    correlations: Vec<f64>,
}

impl<B: Backend> Correlator<B> {
    /// The shifts at which each zone of the reference looks like itself.
    pub(crate) fn periods(&self) -> &[Vec<[f64; 2]>] {
        if let Some(periods) = self.periods.get() {
            return periods;
        }
        // Made first, then kept: who waits for parts may take up another frame, which must not wait for this one.
        let of_zone = |pixels: &PixelSet| periods(&self.image, pixels);
        let periods: Vec<_> = self.zone_pixels.iter().map(of_zone).collect();
        self.periods.get_or_init(|| periods)
    }

    /// What a correlation found, brought to the nearest to what was expected (rest unless said) of all displacements
    /// that match as well, where the texture repeats; and what is to be said of that.
    pub(crate) fn resolve_periods(
        &self,
        frame: &mut B::Frame,
        mut found: Correlation,
        expected: Option<&[[f64; 2]]>,
    ) -> Result<Correlation> {
        let periods = self.periods();
        if periods.iter().all(Vec::is_empty) || found.measurement.status != Status::Converged {
            return Ok(found);
        }
        for _ in 0..MOST_PERIODS {
            let besides = self.try_periods_off(frame, &found, periods)?;
            let Some(nearer) = self.move_by_periods(&found, &besides, expected) else {
                found.ambiguity = self.ambiguity(&found, &besides, expected);
                break;
            };
            let transfer: Vec<GreyTransfer> = found.zones.iter().map(|zone| zone.transfer).collect();
            let lost: Vec<bool> = found.zones.iter().map(|zone| zone.status != Status::Converged).collect();
            let left_out = numbers(&elements_of(self.mesh(), &lost));
            let start = Start { displacement: nearer, transfer, left_out };
            let (mut field, left_out) = self.start_field(frame, &start)?;
            let limits = self.limits(self.turn(&self.levels[0], &start.displacement));
            let outcome = iterate(&self.backend, &self.levels[0], frame, &mut field, limits, &self.kernel, nothing)?;
            let coarse = found.coarse_iterations;
            let next = self.finish(frame, &mut field, outcome, found.start, coarse, left_out)?;
            if next.measurement.status != Status::Converged {
                found.ambiguity = self.ambiguity(&found, &besides, expected);
                break;
            }
            found = next;
        }
        if found.ambiguity.as_ref().is_some_and(|ambiguity| !ambiguity.confirmed) {
            found.measurement.status = Status::Ambiguous;
        }
        Ok(found)
    }

    /// The displacements that are a period off in each zone, and how well they match after a few iterations.
    fn try_periods_off(
        &self,
        frame: &mut B::Frame,
        found: &Correlation,
        periods: &[Vec<[f64; 2]>],
    ) -> Result<Vec<Beside>> {
        let level = &self.levels[0];
        let transfer: Vec<GreyTransfer> = found.zones.iter().map(|zone| zone.transfer).collect();
        let mut besides = Vec::new();
        let limits = Limits { max_iterations: 4, ..COARSE };
        for (number, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
            // The texture turns with its zone.
            let shift = |(zone, periods): (usize, &Vec<[f64; 2]>)| {
                let period = periods.get(number).or(periods.first())?;
                let angle = found.zones[zone].rigid.map_or(0.0, |rigid| rigid.rotation_rad);
                let (sin, cos) = angle.sin_cos();
                Some([sign * (cos * period[0] - sin * period[1]), sign * (sin * period[0] + cos * period[1])])
            };
            if periods.iter().all(|periods| periods.len() <= number) {
                continue;
            }
            let shifts: Vec<Option<[f64; 2]>> = periods.iter().enumerate().map(shift).collect();
            let displacement = shift_zones(&level.mesh, &found.full_displacement, &shifts);
            let mut field = self.backend.start(&level.prepared, frame, &displacement, &transfer)?;
            let turn = self.turn(level, &displacement);
            iterate(&self.backend, level, frame, &mut field, Limits { turn, ..limits }, &self.kernel, nothing)?;
            let observed = self.backend.observe(&level.prepared, frame, &mut field)?;
            let is_inside = |sums: &PixelSums| sums.n >= LEAST_INSIDE * sums.n_all;
            let correlation = |sums: &PixelSums| if is_inside(sums) { sums.correlation() } else { f64::NEG_INFINITY };
            let correlations = observed.iter().map(|(sums, _)| correlation(sums)).collect();
            besides.push(Beside { shifts, correlations });
        }
        Ok(besides)
    }

    /// The displacement with zones moved by a period that matches better, or as well and nearer to `expected`.
    fn move_by_periods(
        &self,
        found: &Correlation,
        besides: &[Beside],
        expected: Option<&[[f64; 2]]>,
    ) -> Option<Vec<[f64; 2]>> {
        let mesh = self.mesh();
        let shift = |zone: usize| {
            let off = off_expected(mesh, found, zone, expected);
            let own = found.zones[zone].correlation;
            let distance = |shift: [f64; 2]| (off[0] + shift[0]).hypot(off[1] + shift[1]);
            in_zone(besides, zone)
                .filter(|&(shift, there)| {
                    let nearer = distance(shift) < 0.9 * distance([0.0; 2]);
                    there > own + CLEARLY || (there > own - AS_WELL && nearer)
                })
                .min_by(|a, b| (-a.1, distance(a.0)).partial_cmp(&(-b.1, distance(b.0))).unwrap_or(Ordering::Equal))
                .map(|(shift, _)| shift)
        };
        let shifts: Vec<Option<[f64; 2]>> = (0..mesh.zones().len()).map(shift).collect();
        shifts.iter().any(Option::is_some).then(|| shift_zones(mesh, &found.full_displacement, &shifts))
    }

    /// What is to be said of the zone whose displacement is told worst; `None` when all are told.
    fn ambiguity(&self, found: &Correlation, besides: &[Beside], expected: Option<&[[f64; 2]]>) -> Option<Ambiguity> {
        let of_zone = |zone: usize| {
            let own = found.zones[zone].correlation;
            let as_well: Vec<_> = in_zone(besides, zone).filter(|(_, there)| *there > (1.0 - FEW) * own).collect();
            let length = |v: [f64; 2]| v[0].hypot(v[1]);
            let period_px = as_well.iter().map(|(shift, _)| length(*shift)).min_by(f64::total_cmp)?;
            let from_expected_px = length(off_expected(self.mesh(), found, zone, expected));
            Some(Ambiguity {
                zone: found.zones[zone].name.clone(),
                period_px,
                vectors_px: as_well.iter().map(|(shift, _)| *shift).collect(),
                correlation: own,
                correlation_beside: as_well.iter().map(|(_, there)| *there).fold(f64::NEG_INFINITY, f64::max),
                from_expected_px,
                confirmed: from_expected_px < period_px / 3.0,
                from_series: expected.is_some(),
            })
        };
        let share = |ambiguity: &Ambiguity| ambiguity.from_expected_px / ambiguity.period_px;
        (0..found.zones.len()).filter_map(of_zone).max_by(|a, b| share(a).total_cmp(&share(b)))
    }
}

/// The shifts of a zone, and its correlation coefficients there.
fn in_zone(besides: &[Beside], zone: usize) -> impl Iterator<Item = ([f64; 2], f64)> {
    besides.iter().filter_map(move |beside| Some((beside.shifts[zone]?, beside.correlations[zone])))
}

/// The displacement with zones moved on by their shifts.
fn shift_zones(mesh: &Mesh<Px>, displacement: &[[f64; 2]], shifts: &[Option<[f64; 2]>]) -> Vec<[f64; 2]> {
    let moved = |(u, &zone): (&[f64; 2], &u32)| {
        let shift = shifts[zone as usize].unwrap_or([0.0; 2]);
        [u[0] + shift[0], u[1] + shift[1]]
    };
    displacement.iter().zip(mesh.node_zone()).map(moved).collect()
}

/// How far the displacement of a zone is from what was expected, rest unless said: mean over its measured nodes, px.
fn off_expected(mesh: &Mesh<Px>, found: &Correlation, zone: usize, expected: Option<&[[f64; 2]]>) -> [f64; 2] {
    let (mut sum, mut n) = ([0.0; 2], 0.0);
    for node in mesh.zone_nodes(zone).filter(|&node| found.measurement.measured[node]) {
        let (u, v) = (found.full_displacement[node], expected.map_or([0.0; 2], |expected| expected[node]));
        (0..2).for_each(|c| sum[c] += u[c] - v[c]);
        n += 1.0;
    }
    sum.map(|sum| sum / f64::max(n, 1.0))
}
