//! How to fit.

use crate::identify::{Constant, TrustRegionOptions, Unknowns};
use crate::io::case::{Discretisation, Intervals, WeightKind};
use crate::reduction::Traction;
use std::sync::Arc;

/// How to fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// The weights.
    pub weights: WeightKind,
    /// Whether the prescribed displacements are unknowns too, with their covariance; for covariance weights.
    pub estimate_boundary: bool,
    /// Further starts beside that of the unknowns.
    pub starts: Vec<Vec<f64>>,
    /// The traction of the same test without a model: the law that follows it is one more start.
    pub direct: Option<Arc<Traction>>,
    /// The iteration.
    pub region: TrustRegionOptions,
    /// Model constants; those that are not named are exact.
    pub constants: Vec<Constant>,
    /// What becomes of the effect of the element size.
    pub discretisation: Discretisation,
    /// Which intervals are wanted.
    pub intervals: Intervals,
    /// Draws of the bootstrap that goes with intervals of the profile likelihood; 0 for none, `None` for as many as
    /// are good.
    pub bootstrap: Option<usize>,
    /// Whether the result is doubted: tested for misfit, and prescribed parameters tried as unknowns. Fits that are
    /// parts of something larger (rows of a sweep, draws) do without.
    pub doubt: bool,
    /// Whether prescribed parameters are tried as unknowns, where the result is doubted. A comparison of laws does
    /// without: it is a comparison of models by itself.
    pub release: bool,
    /// Whether other minima are looked for, where the result is doubted, of a law that
    /// [has some](crate::mechanics::cohesive::CohesiveLaw::has_own_minima): a lower one is gone on from, and intervals
    /// hold what the objective allows about all of them. A comparison of laws does that by itself.
    pub other_minima: bool,
    /// Whether rotations that are taken as small are judged, where the result is doubted.
    pub judge_rotations: bool,
}

impl Default for FitOptions {
    fn default() -> Self {
        let region = TrustRegionOptions::default();
        Self {
            weights: WeightKind::Paper,
            estimate_boundary: false,
            starts: Vec::new(),
            direct: None,
            region,
            constants: Vec::new(),
            discretisation: Discretisation::Stated,
            intervals: Intervals::Auto,
            bootstrap: None,
            doubt: true,
            release: true,
            other_minima: true,
            judge_rotations: true,
        }
    }
}

impl FitOptions {
    /// All starts: that of the unknowns, the further ones, and the law that follows the direct traction.
    pub(crate) fn starts_of(&self, unknowns: &Unknowns) -> Vec<Vec<f64>> {
        let along = |direct: &Arc<Traction>| {
            let start = unknowns.scaled(&unknowns.start());
            unknowns.unscaled(&direct.start(&start, |z| unknowns.law_at(&unknowns.unscaled(z)).ok()))
        };
        let further = self.starts.iter().cloned().chain(self.direct.iter().map(along));
        std::iter::once(unknowns.start()).chain(further).collect()
    }
}
