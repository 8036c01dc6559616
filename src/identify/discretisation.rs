//! What the size of the elements does to the parameters: the model once more with elements half as large.

use super::objective::{Evaluation, Problem};
use super::statistics::Statistics;
use crate::mechanics::{BoundaryHistory, ForwardOptions, Model};

/// What becomes of the effect of the element size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Discretisation {
    /// It is not computed.
    Off,
    /// It is stated beside the result.
    Stated,
    /// It is stated and taken into the 95 % intervals as one more standard uncertainty.
    Included,
}

impl Discretisation {
    /// Its name in case files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Stated => "stated",
            Self::Included => "included",
        }
    }
}

impl Problem<'_> {
    /// Change of each scaled unknown if every element were cut into four, to first order, with the displacements `boundary`
    /// of the border carried along its edges; `None` where that mesh cannot be made or has no solution.
    pub(super) fn refinement_shift(
        &self,
        evaluation: &Evaluation,
        statistics: &Statistics,
        boundary: &BoundaryHistory,
    ) -> Option<Vec<f64>> {
        let law = self.unknowns.law_at(&evaluation.x).ok()?;
        let model = &self.joint.model;
        let (mesh, carry) = model.mesh().refined(2).ok()?;
        let boundary = model.mesh().carry_boundary(&carry, boundary);
        let fine = Model::new(mesh, model.materials().to_vec(), boundary.nodes(), *model.options()).ok()?;
        let fine = fine.forward(&*law, &boundary, &ForwardOptions::default()).ok()?;
        let compared = |i: &super::observation::ObservedInstant| fine.instants[i.index].status.converged();
        if !self.observation.instants.iter().all(compared) {
            return None;
        }
        // Nodes keep their numbers in the finer mesh.
        Some(self.shift(statistics, |instant, node, c| {
            let at = |instants: &[crate::mechanics::Instant]| instants[instant].displacement[node][c];
            at(&fine.instants) - at(&evaluation.solution.instants)
        }))
    }
}
