//! Is the law the same all along the joint? A thickness of the adhesive that changes from end to end, as one more unknown.
//!
//! An adhesive that is thicker by the share `h` has the same tractions at separations that are larger by `h`. One that
//! varies evenly, by `h s` at the place `s` from -1/2 to 1/2, leaves a fit of one law with that of some place: the one
//! whose separations it finds.

use super::one_more::OneMore;
use crate::identify::intervals::constants::power_of_length;
use crate::identify::{ConstantEffect, Evaluation, LoadCell, ObservedInstant, Problem, Scale, Statistics, Weights};
use crate::linalg::Dense;
use crate::mechanics::Model;

/// A thickness that varies evenly along the joint.
#[derive(Debug, Clone, PartialEq)]
pub struct ThicknessAlong {
    /// The thickness at the end of the joint less that at its beginning, by that in its middle, and its standard
    /// uncertainty by the noise.
    pub change: f64,
    /// Its standard uncertainty by the noise.
    pub std: f64,
    /// That of all that is uncertain.
    pub allowed: f64,
    /// What the objective falls by.
    pub gain: f64,
    /// Length of the joint, and the place along it whose law the fit has found, mm.
    pub length_mm: f64,
    /// That place.
    pub place_mm: f64,
    /// Whether the data ask for it.
    pub contradicts: bool,
}

impl ThicknessAlong {
    /// What there is to say, where the law is not the same everywhere.
    pub fn sentence(&self) -> Option<String> {
        let Self { change, std, gain, length_mm, place_mm, .. } = self;
        let ratio = (1.0 + 0.5 * change) / (1.0 - 0.5 * change);
        self.contradicts.then(|| {
            format!(
                "the separations of the law change along the joint, as where the thickness of the adhesive does: at its end they \
                 are {ratio:.3} +- {std:.3} times those at its beginning (omega falls by {gain:.0}); the parameters are those of \
                 the place at {place_mm:.2} of {length_mm:.2} mm along it"
            )
        })
    }
}

/// Of each interface element its place along the joint from -1/2 to 1/2, and the length of all, mm.
fn places(model: &Model) -> (Vec<f64>, f64) {
    let mesh = model.mesh();
    let length = |&corners: &[u32; 4]| {
        let [x, y] = mesh.twice_along(corners);
        0.5 * x.hypot(y)
    };
    let lengths: Vec<f64> = mesh.interfaces().iter().map(length).collect();
    let all: f64 = lengths.iter().sum();
    let mut before = 0.0;
    let place = |length: &f64| {
        before += length;
        (before - 0.5 * length) / all - 0.5
    };
    (lengths.iter().map(place).collect(), all)
}

impl Problem<'_> {
    /// The thickness along the joint as one more unknown of the fit that ended at `evaluation` under `weights`; `None`
    /// where the data say nothing of it. `refined` and `effects` as of [`Problem::misfit`].
    pub(crate) fn thickness_along(
        &self,
        evaluation: &Evaluation,
        weights: &Weights,
        statistics: &Statistics,
        refined: Option<&[Dense]>,
        effects: &[ConstantEffect],
    ) -> Option<ThicknessAlong> {
        let Weights::Inverse(_) = weights else { return None };
        // Of a load curve alone it is not known where it was.
        if self.observation.nodes.is_empty() {
            return None;
        }
        let law = self.unknowns.law_at(&evaluation.x).ok()?;
        let model = evaluation.model(self);
        let (along, length_mm) = places(model);
        if along.len() < 2 {
            return None;
        }
        let change = |observed: &ObservedInstant| {
            let u = &evaluation.solution.instants[observed.index].displacement;
            let nodes = model.linearise(&*law, u).ok()?.by_thickness(&along);
            let of_force = |cell: &LoadCell| cell.width_mm * cell.reaction(model, &*law, u).change(&nodes);
            Some(self.observation.column(observed.index, |node, c| nodes[node][c], of_force))
        };
        let change: Vec<Dense> = self.observation.instants.iter().map(change).collect::<Option<_>>()?;
        let one_more = self.one_more_unknown(&change, (evaluation, weights), refined, effects.iter(), 0.0)?;
        // A fit of one law is off by so much of the change, and so are the separations of that place.
        let shift = statistics.shift(&change);
        let mut of_lengths = (self.unknowns.list().iter().zip(&shift))
            .filter(|(unknown, _)| unknown.scale == Scale::Logarithm && power_of_length(unknown.parameter.unit) == 1.0);
        let place = -of_lengths.next()?.1;
        let OneMore { value, std, allowed, gain } = one_more;
        Some(ThicknessAlong {
            change: value,
            std,
            allowed,
            gain,
            length_mm,
            place_mm: (place.clamp(-0.5, 0.5) + 0.5) * length_mm,
            contradicts: one_more.contradicts(),
        })
    }
}
