//! What the size of the elements does to the parameters: the model once more with elements half as large.

use super::objective::{Evaluation, Problem};
use super::statistics::Statistics;
use crate::mechanics::cohesive::Jump;
use crate::mechanics::{BoundaryHistory, ForwardOptions, Model};
use std::collections::HashMap;

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

/// What elements half as large would change.
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// Change of each scaled unknown, to first order.
    pub scaled: Vec<f64>,
    /// The jumps that the finer mesh has at the node pairs of the mesh, at the parameters found; by instant of the boundary.
    pub jumps: Vec<Vec<Jump>>,
    /// Whether intervals and bands hold it.
    pub included: bool,
}

impl Problem<'_> {
    /// Change of each scaled unknown and of the jumps if every element were cut into four, to first order, with the displacements `boundary`
    /// of the border carried along its edges; `None` where that mesh cannot be made or has no solution.
    pub(super) fn refinement(
        &self,
        evaluation: &Evaluation,
        statistics: &Statistics,
        boundary: &BoundaryHistory,
        included: bool,
    ) -> Option<Refinement> {
        let law = self.unknowns.law_at(&evaluation.x).ok()?;
        let model = &self.joint.model;
        let (mesh, carry) = model.mesh().refined(2).ok()?;
        let boundary = model.mesh().carry_boundary(&carry, boundary);
        let finer = Model::new(mesh, model.materials().to_vec(), boundary.nodes(), *model.options()).ok()?;
        let fine = finer.forward(&*law, &boundary, &ForwardOptions::default()).ok()?;
        let compared = |i: &super::observation::ObservedInstant| fine.instants[i.index].status.converged();
        if !self.observation.instants.iter().all(compared) {
            return None;
        }
        // Nodes keep their numbers in the finer mesh.
        let scaled = self.shift(statistics, |instant, node, c| {
            let at = |instants: &[crate::mechanics::Instant]| instants[instant].displacement[node][c];
            at(&fine.instants) - at(&evaluation.solution.instants)
        });
        let place: HashMap<[u32; 2], usize> = (0..).zip(finer.mesh().pairs()).map(|(k, &pair)| (pair, k)).collect();
        let places: Vec<usize> =
            model.mesh().pairs().iter().map(|pair| place.get(pair).copied()).collect::<Option<_>>()?;
        let jumps = |instant: &crate::mechanics::Instant| match instant.status.converged() {
            true => {
                let all = finer.jumps(&instant.displacement);
                places.iter().map(|&k| all[k]).collect()
            }
            false => Vec::new(),
        };
        Some(Refinement { scaled, jumps: fine.instants.iter().map(jumps).collect(), included })
    }
}
