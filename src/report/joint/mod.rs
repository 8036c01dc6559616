//! What a run of the mechanics gives people and programs: tables, grids for ParaView, figures, the summary.

mod drawing;
mod figures;
mod grids;
mod loads;
mod release;
mod remarks;
mod summary;
mod tables;

pub use drawing::{JointMap, JointProfiles};
pub use loads::{Balance, EnergySummary, ReactionSummary};
pub use release::JSummary;
pub use summary::{InstantSummary, JointSummary, LawSummary};

use super::ForceRecord;
use crate::mechanics::{Energies, Instant, JFault, JIntegral, Joint, Sensitivity, Solution};

/// A joint and its solution.
#[derive(Debug, Clone, Copy)]
pub struct JointReport<'a> {
    /// The joint.
    pub joint: &'a Joint,
    /// Its solution.
    pub solution: &'a Solution,
    /// Its energies, by instant; empty where they were not computed.
    pub energies: &'a [Option<Energies>],
    /// Where in the history of the case each instant is, of a path that was followed by its length; else empty.
    pub times: &'a [f64],
    /// The load cell beside the prediction, where there is one.
    pub force: Option<&'a ForceRecord>,
    /// Its J-integrals, by instant; empty where they were not computed.
    pub j_integrals: &'a [Option<Result<JIntegral, JFault>>],
}

impl<'a> JointReport<'a> {
    /// Without energies, load cell and J-integrals.
    pub fn new(joint: &'a Joint, solution: &'a Solution) -> Self {
        Self { joint, solution, energies: &[], times: &[], force: None, j_integrals: &[] }
    }

    /// Whether there is an adhesive, and not one body alone.
    pub fn has_adhesive(&self) -> bool {
        !self.joint.model.mesh().interfaces().is_empty()
    }

    /// The instants that have a solution, with their numbers from 1.
    pub fn solved(&self) -> impl Iterator<Item = (usize, &'a Instant)> {
        (1..).zip(&self.solution.instants).filter(|(_, instant)| instant.status.converged())
    }

    /// Name of a parameter in files: that of its symbol, for a material with the name of its group.
    fn name_of(&self, sensitivity: &Sensitivity) -> String {
        match sensitivity.group {
            None => sensitivity.parameter.name.to_owned(),
            Some(group) => format!("{}_{}", sensitivity.parameter.name, self.joint.model.mesh().groups()[group]),
        }
    }

    /// The value of a parameter.
    fn value_of(&self, sensitivity: &Sensitivity) -> f64 {
        let (parameters, values) = match sensitivity.group {
            None => (self.joint.law.parameters().to_vec(), self.joint.law.values()),
            Some(group) => {
                let material = &self.joint.model.materials()[group];
                (material.parameters().to_vec(), material.values())
            }
        };
        let at = parameters.iter().position(|parameter| *parameter == sensitivity.parameter);
        at.and_then(|at| values.get(at).copied()).unwrap_or(1.0)
    }

    /// The names of all parameters, in the order of the sensitivities.
    fn names(&self) -> Vec<String> {
        self.solution.parameters.iter().map(|sensitivity| self.name_of(sensitivity)).collect()
    }
}
