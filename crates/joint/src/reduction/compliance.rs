//! The straight begin of a test, where it ends, and where growth begins by the definitions of the standards.

use super::specimen::Instant;

/// Share of the largest load between which a test is straight before anything grows.
const STRAIGHT: [f64; 2] = [0.1, 0.5];
/// What a displacement has to be off the line to be off it, by the displacement, and by the scatter about the line.
const OFF: f64 = 0.01;
const OFF_SCATTER: f64 = 3.0;
/// By how much the compliance has grown where growth begins: the 5 % of the standards.
const MORE_COMPLIANT: f64 = 1.05;

/// `delta = slack + C P` before anything grows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StraightLine {
    /// Compliance, mm/N.
    pub compliance_mm_per_n: f64,
    /// Its standard uncertainty by the scatter, mm/N.
    pub compliance_std: f64,
    /// Displacement that it takes before the load rises, mm.
    pub slack_mm: f64,
    /// Root mean square of what the displacements are off the line, mm.
    pub scatter_mm: f64,
    /// Instants on it, from 0.
    pub instants: [usize; 2],
}

/// Where growth begins by a definition of the standards (ISO 25217, ASTM D5528).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Definition {
    /// `NL`: where the displacement leaves the straight line.
    NonLinear,
    /// `VIS`: where the images show a longer crack.
    Visual,
    /// `5%/max`: where the compliance has grown by 5 %, or the largest load where that comes first.
    FivePercent,
}

impl Definition {
    /// Its name in the standards.
    pub fn name(self) -> &'static str {
        match self {
            Self::NonLinear => "NL",
            Self::Visual => "VIS",
            Self::FivePercent => "5%/max",
        }
    }
}

/// The instant of the largest load.
pub(super) fn largest_load(instants: &[Instant]) -> Option<usize> {
    (0..instants.len()).max_by(|&a, &b| instants[a].load_n.value.total_cmp(&instants[b].load_n.value))
}

/// The line; `None` with fewer than three instants on it, or where it does not rise.
pub(super) fn straight_line(instants: &[Instant]) -> Option<StraightLine> {
    let last = largest_load(instants)?;
    let most = instants[last].load_n.value;
    let within = |&k: &usize| (STRAIGHT[0] * most..=STRAIGHT[1] * most).contains(&instants[k].load_n.value);
    let of = |k: usize| Some((instants[k].load_n.value, instants[k].displacement_mm?.value));
    // Up to the first time: what is loaded again later has grown.
    let first_rise = (0..last).take_while(|&k| instants[k].load_n.value <= STRAIGHT[1] * most);
    let chosen: Vec<usize> = first_rise.filter(within).filter(|&k| of(k).is_some()).collect();
    let points: Vec<(f64, f64)> = chosen.iter().filter_map(|&k| of(k)).collect();
    let (first, end) = (*chosen.first()?, *chosen.last()?);
    let Line { slope, offset, scatter, slope_std, .. } = fit_line(&points)?;
    (slope > 0.0).then_some(StraightLine {
        compliance_mm_per_n: slope,
        compliance_std: slope_std,
        slack_mm: offset,
        scatter_mm: scatter,
        instants: [first, end],
    })
}

/// A line through points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    pub(super) slope: f64,
    pub(super) offset: f64,
    /// Root mean square of what the points are off.
    pub(super) scatter: f64,
    /// Standard uncertainties of the slope, and of where the line is zero.
    pub(super) slope_std: f64,
    pub(super) zero_std: f64,
}

/// The line through at least three points.
pub(super) fn fit_line(points: &[(f64, f64)]) -> Option<Line> {
    let n = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
    let (xx, xy) = points.iter().fold((0.0, 0.0), |(xx, xy), p| (xx + (p.0 - x).powi(2), xy + (p.0 - x) * (p.1 - y)));
    if points.len() < 3 || xx <= 0.0 {
        return None;
    }
    let (slope, offset) = (xy / xx, y - xy / xx * x);
    let square: f64 = points.iter().map(|p| (p.1 - offset - slope * p.0).powi(2)).sum();
    let scatter = (square / (n - 2.0)).sqrt();
    let zero_std = (scatter / slope).abs() * (1.0 / n + (x + offset / slope).powi(2) / xx).sqrt();
    Some(Line { slope, offset, scatter, slope_std: scatter / xx.sqrt(), zero_std })
}

/// The instant, with its fraction, where growth begins; `None` where the test does not show it.
pub(super) fn begins(
    definition: Definition,
    instants: &[Instant],
    line: Option<&StraightLine>,
    initial_crack_mm: Option<f64>,
) -> Option<f64> {
    let last = largest_load(instants)?;
    let displacement = |k: usize| Some(instants.get(k)?.displacement_mm?.value);
    match definition {
        Definition::NonLinear => {
            let line = line?;
            let off = |k: usize| {
                let u = displacement(k)?;
                let beyond = u - line.slack_mm - line.compliance_mm_per_n * instants[k].load_n.value;
                Some(beyond > (OFF * (u - line.slack_mm).abs()).max(OFF_SCATTER * line.scatter_mm))
            };
            let first = (line.instants[1] + 1..=last).rev().take_while(|&k| off(k) == Some(true)).last()?;
            Some(first as f64)
        }
        Definition::FivePercent => {
            let line = line?;
            // Of the displacement less that of the line of 5 %.
            let beyond = |k: usize| {
                Some(
                    displacement(k)?
                        - line.slack_mm
                        - MORE_COMPLIANT * line.compliance_mm_per_n * instants[k].load_n.value,
                )
            };
            let crossing = |k: usize| {
                let (before, after) = (beyond(k)?, beyond(k + 1)?);
                (before <= 0.0 && after > 0.0).then(|| k as f64 + before / (before - after))
            };
            let crossed = (line.instants[1]..last).find_map(crossing);
            Some(crossed.unwrap_or(last as f64))
        }
        Definition::Visual => {
            let initial = initial_crack_mm?;
            let longer = |k: &usize| {
                instants[*k].crack_mm.is_some_and(|crack| crack.value > initial + 2.0 * crack.sigma.max(1e-3 * initial))
            };
            (0..instants.len()).find(longer).map(|k| k as f64)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::Value;

    /// Straight up to 80 N at 1 um/N, then a compliance that grows by a tenth of a percent per N, from 10 um of slack.
    fn bent() -> Vec<Instant> {
        let exact = |value: f64| Value { value, sigma: 0.0 };
        (0..=30)
            .map(|k| {
                let load = 4.0 * f64::from(k);
                let compliance = 1e-3 * (1.0 + 1e-2 * (load - 80.0).max(0.0));
                Instant {
                    displacement_mm: Some(exact(0.01 + compliance * load)),
                    ..Instant::of_load(k as usize, exact(load))
                }
            })
            .collect()
    }

    #[test]
    fn the_begin_of_growth_is_found_by_each_definition() {
        let mut instants = bent();
        let line = straight_line(&instants).unwrap();
        assert!((line.compliance_mm_per_n - 1e-3).abs() < 1e-12 && (line.slack_mm - 0.01).abs() < 1e-12, "{line:?}");
        // 1 % more displacement: at 81.0 N, the next instant is 84 N; 5 %: 85 N, between 84 and 88 N.
        let at = |definition| begins(definition, &instants, Some(&line), Some(40.0));
        assert_eq!(at(Definition::NonLinear), Some(21.0));
        let five = at(Definition::FivePercent).unwrap();
        assert!((five - 21.25).abs() < 0.02, "{five}: a curve between two instants is taken as straight");
        assert_eq!(at(Definition::Visual), None, "no crack was measured");
        for (k, instant) in instants.iter_mut().enumerate() {
            instant.crack_mm = Some(Value { value: 40.0 + 0.1 * (k as f64 - 23.0).max(0.0), sigma: 0.02 });
        }
        assert_eq!(begins(Definition::Visual, &instants, Some(&line), Some(40.0)), Some(24.0));
        // A load that falls before 5 %.
        instants.truncate(21);
        assert_eq!(begins(Definition::FivePercent, &instants, Some(&line), None), Some(20.0));
    }

    #[test]
    fn a_test_without_a_straight_begin_has_no_line() {
        assert_eq!(straight_line(&bent()[..2]), None);
        assert_eq!(straight_line(&[]), None);
    }
}
