//! What an iteration has found, before and after it is known which elements match.

use crate::backend::{Backend, Found};
use crate::correlate::{Light, Looks, Outcome, Start, numbers};
use crate::field::Status;
use crate::mesh::Mesh;
use crate::units::Px;

/// What a field is found without.
pub(crate) struct LeftOut {
    /// Its elements.
    pub elements: Vec<bool>,
    /// The zones among them that had been given up before.
    pub zones: Vec<bool>,
}

/// The elements of the zones that are `lost`.
pub(crate) fn elements_of(mesh: &Mesh<Px>, lost: &[bool]) -> Vec<bool> {
    mesh.element_zone().iter().map(|&zone| lost[zone as usize]).collect()
}

pub(crate) struct Iterated<B: Backend> {
    pub outcome: Outcome<B>,
    pub found: Found,
    pub light: Option<Light>,
    /// The elements that it was done without.
    pub excluded: Vec<bool>,
    /// The zones that were given up before it began.
    pub lost: Vec<bool>,
}

impl<B: Backend> Iterated<B> {
    /// Where the next frame may begin if this is confirmed; none if it has not converged or has light of its own.
    pub fn start(&self) -> Option<Start> {
        let is_field = self.outcome.status == Status::Converged && self.light.is_none();
        let Found { displacement, transfer, .. } = &self.found;
        is_field.then(|| Start {
            displacement: displacement.clone(),
            transfer: transfer.clone(),
            left_out: numbers(&self.excluded),
        })
    }
}

/// A field whose iteration has ended, all that does not match left out.
pub(crate) struct Settled<B: Backend> {
    pub of: Iterated<B>,
    /// Whether no other elements were left out than had been while it was iterated.
    pub is_as_iterated: bool,
    /// Per zone.
    pub matches: Vec<f64>,
    pub status: Status,
    /// How each zone has ended.
    pub of_zones: Vec<Status>,
    /// What its residual says of displacements that are not followed.
    pub looks: Looks,
}

impl<B: Backend> Settled<B> {
    pub fn start(&self) -> Option<Start> {
        self.of.start().filter(|_| self.status == Status::Converged)
    }
}
