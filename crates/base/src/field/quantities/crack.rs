//! Opening and sliding along a crack, its tips, and the stress intensity there.

use super::stress_intensity::{Elasticity, StressIntensity, stress_intensity};
use super::{Jump, NodalNoise, Reading, Value};
use crate::field::{ElementMark, Measurement};
use crate::mesh::{CutFaces, CutTip, FacePoint, Mesh, point_along};
use crate::plane::{distance, minus, unit};
use crate::units::Length;

/// A crack is open where its opening exceeds so many standard uncertainties.
pub const OPEN_BY_SIGMA: f64 = 3.0;
/// So many places in a row that are not open end an open crack.
const CLOSED_IN_A_ROW: usize = 2;

/// A crack along which the mesh is cut.
#[derive(Debug, Clone, PartialEq)]
pub struct CrackLine {
    path: Vec<[f64; 2]>,
    faces: CutFaces,
    elasticity: Option<Elasticity>,
}

/// A crack in one field.
#[derive(Debug, Clone, PartialEq)]
pub struct CrackValues {
    /// Opening and sliding at each of its places.
    pub points: Vec<Option<Jump>>,
    /// The gravest mark of the elements on either face there: an opening beside elements that do not match is doubtful.
    pub marks: Vec<ElementMark>,
    /// Its tips: one for each end that is joined, in the order of the path.
    pub tips: Vec<CrackTip>,
}

/// A tip in one field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrackTip {
    /// The end of the path that it belongs to: 0 the first point, 1 the last.
    pub end: usize,
    /// What was found.
    pub state: TipState,
    /// Distance along the path from its first point; the last open place of a crack open to its end is that end.
    pub along: Option<Value>,
    /// The same place in the reference.
    pub at: Option<[f64; 2]>,
    /// Stress intensity, where elastic constants are given and the mesh reaches far enough around the tip.
    pub intensity: Option<StressIntensity>,
}

/// What the opening says of a tip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TipState {
    /// The opening falls below three standard uncertainties before the end of the path.
    Found,
    /// Open up to the end of the path: the tip is there, or further on.
    OpenToEnd,
    /// Nowhere open.
    Closed,
    /// Open nowhere it was measured, which is less than half of the path: nothing can be said.
    NotMeasured,
}

impl TipState {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::OpenToEnd => "open_to_end",
            Self::Closed => "closed",
            Self::NotMeasured => "not_measured",
        }
    }
}

impl CrackLine {
    /// The crack along `path`, if the mesh is cut there. With `elasticity` the stress intensity is found at its tips.
    pub fn on<U: Length>(mesh: &Mesh<U>, path: Vec<[f64; 2]>, elasticity: Option<Elasticity>) -> Option<Self> {
        let faces = mesh.cut_faces(&path);
        (!faces.points.is_empty()).then_some(Self { path, faces, elasticity })
    }

    /// The same crack with its places where `place` brings them; distances along it grow as its whole length.
    pub fn placed(&self, place: impl Fn([f64; 2]) -> Option<[f64; 2]>) -> Option<Self> {
        let path = self.path.iter().map(|&at| place(at)).collect::<Option<Vec<_>>>()?;
        let length = |path: &[[f64; 2]]| path.windows(2).map(|two| distance(two[0], two[1])).sum::<f64>();
        let longer = length(&path) / length(&self.path);
        let turned =
            |at: [f64; 2], along: [f64; 2]| Some(unit(minus(place([at[0] + along[0], at[1] + along[1]])?, place(at)?)));
        let mut faces = self.faces.clone();
        for point in &mut faces.points {
            let [tx, ty] = turned(point.at, [-point.normal[1], point.normal[0]])?;
            (point.normal, point.at, point.along) = ([ty, -tx], place(point.at)?, point.along * longer);
        }
        for tip in faces.tips.iter_mut().flatten() {
            (tip.ahead, tip.at, tip.along) = (turned(tip.at, tip.ahead)?, place(tip.at)?, tip.along * longer);
        }
        Some(Self { path, faces, elasticity: self.elasticity })
    }

    /// The places, in the order of the path.
    pub fn points(&self) -> &[FacePoint] {
        &self.faces.points
    }

    /// The ends that are joined, with 0 for the first point of the path and 1 for the last.
    pub fn joined(&self) -> impl Iterator<Item = (usize, CutTip)> {
        self.faces.tips.iter().enumerate().filter_map(|(end, tip)| Some((end, (*tip)?)))
    }

    /// Whether the stress intensity is asked for.
    pub fn elasticity(&self) -> Option<Elasticity> {
        self.elasticity
    }

    /// Opening, sliding, tips and stress intensity in one field.
    pub fn read<U: Length>(&self, field: &Measurement<U>, noise: &NodalNoise) -> CrackValues {
        let points: Vec<Option<Jump>> = self.points().iter().map(|point| jump(point, field, noise)).collect();
        let tips = self.joined().map(|(end, joined)| self.tip(end, &joined, &points, field, noise)).collect();
        let marks = field.node_marks().unwrap_or_else(|| vec![ElementMark::None; field.mesh.n_nodes()]);
        let marks = self.points().iter().map(|point| marks[point.plus].max(marks[point.minus])).collect();
        CrackValues { points, marks, tips }
    }

    fn tip<U: Length>(
        &self,
        end: usize,
        joined: &CutTip,
        points: &[Option<Jump>],
        field: &Measurement<U>,
        noise: &NodalNoise,
    ) -> CrackTip {
        let measured: Vec<(f64, Value)> = self
            .points()
            .iter()
            .zip(points)
            .filter_map(|(point, jump)| Some((point.along, (*jump)?.opening)))
            .collect();
        let (state, along) = match tip_along(&measured, end, joined.along) {
            (TipState::Closed, _) if 2 * measured.len() < points.len() => (TipState::NotMeasured, None),
            found => found,
        };
        let place = along.and_then(|along| point_along(&self.path, along.value));
        // Without a tip the end of the path is as good a place as any: there is next to nothing to be found.
        let (at, ahead) = match (state, place) {
            (TipState::Found, Some((at, [tx, ty]))) => (at, if end == 1 { [tx, ty] } else { [-tx, -ty] }),
            _ => (joined.at, joined.ahead),
        };
        let intensity = self.elasticity.and_then(|elasticity| {
            stress_intensity(field, noise, &elasticity, &self.path, &self.faces.points, at, ahead)
        });
        let at = match state {
            TipState::Found => place.map(|(at, _)| at),
            TipState::OpenToEnd => Some(joined.at),
            TipState::Closed | TipState::NotMeasured => None,
        };
        CrackTip { end, state, along, at, intensity }
    }
}

/// Opening and sliding between two nodes in one place.
///
/// The sides share no pixel, but near a tip they are joined by elements, through which their errors are correlated.
fn jump<U: Length>(point: &FacePoint, field: &Measurement<U>, noise: &NodalNoise) -> Option<Jump> {
    let along = |direction: [f64; 2]| {
        let signed = |node: usize, sign: f64| {
            let value = noise.at(&field.mesh, &[(node, 1.0)]);
            value.into_iter().map(move |(node, w)| (node, direction.map(|d| sign * w * d)))
        };
        Reading::new(signed(point.plus, 1.0).chain(signed(point.minus, -1.0))).read(field, noise)
    };
    let [nx, ny] = point.normal;
    Some(Jump { opening: along([nx, ny])?, sliding: along([0.0 - ny, nx])? })
}

/// Where the opening falls below [`OPEN_BY_SIGMA`] standard uncertainties on the way from its largest value to the
/// `end` (1: that of increasing distance) at the distance `joined`.
///
/// Between the last open place and the next the opening is taken for linear. The standard uncertainty has that of the
/// opening over its slope, and a place between two nodes drawn by lot.
fn tip_along(measured: &[(f64, Value)], end: usize, joined: f64) -> (TipState, Option<Value>) {
    let excess = |value: &Value| value.value - OPEN_BY_SIGMA * value.sigma;
    let ordered: Vec<(f64, Value)> = match end {
        1 => measured.to_vec(),
        _ => measured.iter().rev().copied().collect(),
    };
    let widest = (0..ordered.len()).max_by(|&a, &b| excess(&ordered[a].1).total_cmp(&excess(&ordered[b].1)));
    let Some(widest) = widest.filter(|&k| excess(&ordered[k].1) > 0.0) else { return (TipState::Closed, None) };
    let mut last = widest;
    let mut closed = 0;
    for (k, (_, value)) in ordered.iter().enumerate().skip(widest) {
        if excess(value) > 0.0 {
            (last, closed) = (k, 0);
        } else {
            closed += 1;
            if closed == CLOSED_IN_A_ROW {
                break;
            }
        }
    }
    let (from, open) = ordered[last];
    let Some((to, next)) = ordered.get(last + 1).copied() else {
        let spacing = (joined - from).abs();
        return (TipState::OpenToEnd, Some(Value { value: joined, sigma: spacing / 12f64.sqrt() }));
    };
    let share = excess(&open) / (excess(&open) - excess(&next));
    let slope = (open.value - next.value) / (to - from);
    let spacing = (to - from).abs();
    let of_noise = (open.sigma / slope.abs()).min(spacing);
    let sigma = of_noise.hypot(spacing / 12f64.sqrt());
    (TipState::Found, Some(Value { value: from + share * (to - from), sigma }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along(openings: &[f64]) -> Vec<(f64, Value)> {
        openings.iter().enumerate().map(|(k, &value)| (10.0 * k as f64, Value { value, sigma: 0.1 })).collect()
    }

    #[test]
    fn the_tip_stands_where_a_falling_opening_meets_three_standard_uncertainties() {
        // Open up to 20, and at 30 a tenth below the limit of 0.3.
        let (state, tip) = tip_along(&along(&[2.0, 1.0, 0.7, 0.2, 0.0, 0.1]), 1, 60.0);
        assert_eq!(state, TipState::Found);
        assert!((tip.unwrap().value - (20.0 + 10.0 * 0.4 / 0.5)).abs() < 1e-12, "{tip:?}");
        // The same from the other side.
        let (_, tip) = tip_along(&along(&[0.1, 0.0, 0.2, 0.7, 1.0, 2.0]), 0, -10.0);
        assert!((tip.unwrap().value - (30.0 - 8.0)).abs() < 1e-12, "{tip:?}");
        assert!(tip.unwrap().sigma > 10.0 / 12f64.sqrt());
    }

    #[test]
    fn one_place_that_is_not_open_does_not_end_a_crack_and_one_that_is_does_not_make_one_further_on() {
        let (state, tip) = tip_along(&along(&[2.0, 1.0, 0.25, 0.8, 0.1, 0.0, 0.35, 0.0]), 1, 80.0);
        assert_eq!(state, TipState::Found);
        assert!((30.0..40.0).contains(&tip.unwrap().value), "{tip:?}");
    }

    #[test]
    fn an_open_end_and_a_closed_crack_are_told_apart() {
        assert_eq!(tip_along(&along(&[2.0, 1.0, 0.5]), 1, 30.0).0, TipState::OpenToEnd);
        assert_eq!(tip_along(&along(&[0.2, -0.1, 0.25]), 1, 30.0), (TipState::Closed, None));
        assert_eq!(tip_along(&[], 1, 30.0), (TipState::Closed, None));
    }
}
