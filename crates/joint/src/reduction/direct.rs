//! The traction of a reduced test beside a law (THEORY 23): as a start of its fit, and compared with the fitted one.

use super::Traction;
use super::traction::{PEAK_KNOWN, TractionCurve};
use crate::mechanics::cohesive::{CohesiveLaw, Jump};
use crate::remark::{About, Code, Remark};

/// Share of the places of a part of the curve that differ before the part does: bands of 95 % at all places together.
const PLACES: f64 = 0.2;
/// Steps of the start, what a parameter is held to its place by, and the step of its differences.
const STEPS: usize = 40;
const HOLD: f64 = 1e-3;
const MOVE: f64 = 1e-4;

impl Traction {
    /// Whether all its lists have a finite value for each separation: of a file anything may be read.
    pub fn is_whole(&self) -> bool {
        let TractionCurve { separation_mm, traction_mpa, std_mpa, half_of_all_mpa, visited, .. } = &self.curve;
        let n = separation_mm.len();
        let lists = [separation_mm, traction_mpa, std_mpa, half_of_all_mpa];
        let finite = lists.iter().all(|list| list.len() == n && list.iter().all(|v| v.is_finite()));
        n > 0 && finite && self.jumps_mm.len() == n && visited.len() == n
    }

    /// The places where the test was.
    fn places(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.curve.separation_mm.len()).filter(|&k| self.curve.visited[k])
    }

    /// The traction of `law` along the jump at each separation, MPa.
    pub fn of_law(&self, law: &dyn CohesiveLaw) -> Vec<f64> {
        let at = |(&separation, &[normal, tangential]): (&f64, &[f64; 2])| {
            let traction = law.response(Jump { normal, tangential }).traction;
            match separation > 0.0 {
                true => (traction.normal * normal + traction.tangential * tangential) / separation,
                false => 0.0,
            }
        };
        self.curve.separation_mm.iter().zip(&self.jumps_mm).map(at).collect()
    }

    /// Coordinates of a law that follows the curve: from `start` by steps of Levenberg and Marquardt; what the curve
    /// does not tell stays. `law_at` is the law at some coordinates, none where there is none.
    pub fn start(&self, start: &[f64], law_at: impl Fn(&[f64]) -> Option<Box<dyn CohesiveLaw>>) -> Vec<f64> {
        let places: Vec<usize> = self.places().collect();
        let residual = |z: &[f64]| -> Option<Vec<f64>> {
            let of_law = self.of_law(&*law_at(z)?);
            let off =
                |&k: &usize| (of_law[k] - self.curve.traction_mpa[k]) / self.curve.std_mpa[k].max(f64::MIN_POSITIVE);
            let held = z.iter().zip(start).map(|(z, start)| HOLD * (z - start));
            Some(places.iter().map(off).chain(held).collect())
        };
        let square = |r: &[f64]| r.iter().map(|v| v * v).sum::<f64>();
        let mut z = start.to_vec();
        let Some(mut here) = residual(&z).filter(|r| square(r).is_finite()) else { return z };
        let mut damping = 1e-2;
        for _ in 0..STEPS {
            let by = |k: usize| {
                let mut moved = z.clone();
                moved[k] += MOVE;
                let there = residual(&moved)?;
                Some(there.iter().zip(&here).map(|(a, b)| (a - b) / MOVE).collect::<Vec<f64>>())
            };
            let Some(slopes) = (0..z.len()).map(by).collect::<Option<Vec<_>>>() else { return z };
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let n = z.len();
            let matrix = crate::linalg::Dense::from_fn(n, n, |a, b| {
                dot(&slopes[a], &slopes[b]) * if a == b { 1.0 + damping } else { 1.0 }
            });
            let right = crate::linalg::Dense::from_fn(n, 1, |k, _| -dot(&slopes[k], &here));
            let Ok(factor) = matrix.cholesky() else { return z };
            let step = factor.solve(&right);
            let next: Vec<f64> = z.iter().zip(step.column(0)).map(|(z, by)| z + by.clamp(-1.0, 1.0)).collect();
            match residual(&next).filter(|r| square(r) < square(&here)) {
                Some(there) => (z, here, damping) = (next, there, damping * 0.3),
                None => damping *= 10.0,
            }
        }
        z
    }

    /// Where it and a fitted law, whose standard uncertainty at a separation is `std`, differ by more than both bands;
    /// `None` where they do not.
    pub fn differs(&self, law: &dyn CohesiveLaw, std: impl Fn(f64) -> f64) -> Option<Remark> {
        let of_law = self.of_law(law);
        let peak = self.places().max_by(|&a, &b| self.curve.traction_mpa[a].total_cmp(&self.curve.traction_mpa[b]))?;
        let at_peak = self.curve.separation_mm[peak];
        // Nearer to the origin than noise tells a peak the slope is smeared.
        let seen = |k: &usize| self.curve.separation_mm[*k] >= PEAK_KNOWN * self.curve.separation_std_mm;
        let parts = [("before the peak", 0.0, 0.7), ("about the peak", 0.7, 1.5), ("in the tail", 1.5, f64::INFINITY)];
        let differing = parts.iter().filter_map(|(name, from, to)| {
            let within = |k: &usize| (from * at_peak..to * at_peak).contains(&self.curve.separation_mm[*k]);
            let part: Vec<usize> = self.places().filter(seen).filter(within).collect();
            let off = |k: usize| (self.curve.traction_mpa[k] - of_law[k]).abs();
            let band = |k: usize| self.curve.half_of_all_mpa[k].hypot(1.96 * std(self.curve.separation_mm[k]));
            let differ: Vec<usize> = part.iter().copied().filter(|&k| off(k) > band(k)).collect();
            let worst = differ.iter().copied().max_by(|&a, &b| (off(a) / band(a)).total_cmp(&(off(b) / band(b))))?;
            (differ.len() as f64 > PLACES * part.len() as f64).then(|| {
                format!(
                    "{name} (at {:.4} mm {:.3} \u{b1} {:.2} MPa, by the law {:.3})",
                    self.curve.separation_mm[worst],
                    self.curve.traction_mpa[worst],
                    self.curve.half_of_all_mpa[worst],
                    of_law[worst]
                )
            })
        });
        // Of the law by trapezia; its uncertainty as if it were the same everywhere, which is the most.
        let integral = |of: &dyn Fn(usize) -> f64| -> f64 {
            let step =
                |k: usize| 0.5 * (of(k) + of(k + 1)) * (self.curve.separation_mm[k + 1] - self.curve.separation_mm[k]);
            (0..self.curve.separation_mm.len() - 1).map(step).sum()
        };
        let (work, of_law) = (self.curve.work_n_per_mm, integral(&|k| of_law[k]));
        let is_other = (work[0] - of_law).abs() > 1.96 * work[1].hypot(integral(&|k| std(self.curve.separation_mm[k])));
        let of_work = is_other.then(|| {
            format!(
                "in the work (up to {:.3} mm {:.4} \u{b1} {:.2} N/mm, by the law {of_law:.4})",
                self.curve.separation_mm.last().copied().unwrap_or(0.0),
                work[0],
                1.96 * work[1]
            )
        });
        let differing: Vec<String> = differing.chain(of_work).collect();
        let text = format!(
            "the fitted law and the slope of {} over the {} differ by more than both 95 % bands {}; the fit takes one law along the \
             joint and the strips as stated, the slope takes a straight front and loads as named",
            self.method.name(),
            self.mode.names()[0],
            differing.join(", ")
        );
        (!differing.is_empty()).then(|| Remark::new(Code::DirectLawDiffers, About::Run, text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanics::cohesive::ExtendedXuNeedleman;

    fn law(work: f64, opening: f64) -> Box<dyn CohesiveLaw> {
        Box::new(ExtendedXuNeedleman::new(work, opening, 0.05, 4.0).unwrap())
    }

    /// As a fit reads it from `reduction.json`.
    fn direct() -> Traction {
        let separation_mm: Vec<f64> = (1..60).map(|k| 0.002 * f64::from(k)).collect();
        let n = separation_mm.len();
        let jumps: Vec<[f64; 2]> = separation_mm.iter().map(|at| [*at, 0.0]).collect();
        let file = serde_json::json!({
            "of": "J", "over": "opening", "jumps_mm": jumps, "separation_mm": separation_mm, "traction_MPa": vec![0.0; n],
            "std_MPa": vec![0.1; n], "half_of_all_MPa": vec![0.3; n], "visited": vec![true; n], "separation_std_mm": 0.0,
            "work_N_per_mm": [0.5, 0.01], "scale_share": 0.1, "noise_factor": 1.0, "log10_lambda": 0.0,
        });
        let mut traction: Traction = serde_json::from_value(file).unwrap();
        traction.curve.traction_mpa = traction.of_law(&*law(0.5, 0.02));
        traction
    }

    #[test]
    fn the_start_of_a_curve_is_the_law_that_it_was_made_by() {
        let at = |z: &[f64]| Some(law(z[0].exp(), z[1].exp()));
        let found = direct().start(&[f64::ln(1.5), f64::ln(0.06)], at);
        // Held to the first start by a thousandth of a standard uncertainty.
        assert!((found[0].exp() - 0.5).abs() < 1e-3 && (found[1].exp() - 0.02).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn laws_that_differ_are_told_with_the_part_in_which_they_do() {
        let curve = direct();
        assert!(curve.is_whole());
        assert!(curve.differs(&*law(0.5, 0.02), |_| 0.0).is_none());
        // Half a band off, or within the band of the fit.
        assert!(curve.differs(&*law(0.505, 0.02), |_| 0.0).is_none());
        assert!(curve.differs(&*law(0.55, 0.02), |_| 2.0).is_none());
        let mut tail = curve.clone();
        tail.curve
            .traction_mpa
            .iter_mut()
            .zip(&curve.curve.separation_mm)
            .for_each(|(t, at)| *t += if *at > 0.06 { 1.0 } else { 0.0 });
        let remark = tail.differs(&*law(0.5, 0.02), |_| 0.0).unwrap();
        assert!(remark.text.contains("in the tail") && !remark.text.contains("about the peak"), "{}", remark.text);
        assert_eq!(remark.code, Code::DirectLawDiffers);
        // Bands that hold any law, and a work that does not.
        let mut vague = curve;
        vague.curve.half_of_all_mpa.fill(50.0);
        let remark = vague.differs(&*law(0.55, 0.02), |_| 0.0).unwrap();
        assert!(remark.text.contains("in the work") && !remark.text.contains("peak ("), "{}", remark.text);
    }
}
