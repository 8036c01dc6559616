//! No adhesive: one body, whose own constants are looked for (THEORY 24).

use super::{CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, LawKind, Traction};

/// The law of a body without an adhesive: it has no parameters and no traction, and nothing asks for one.
#[derive(Debug, Clone, Copy)]
pub struct NoAdhesive;

pub(super) const KIND: LawKind = LawKind { name: NoAdhesive::NAME, parameters: &[], make };

fn make(values: &[f64]) -> Result<Box<dyn CohesiveLaw>, LawError> {
    let [] = super::exactly(NoAdhesive::NAME, values)?;
    Ok(Box::new(NoAdhesive))
}

impl NoAdhesive {
    /// Its name in case files.
    pub const NAME: &str = "none";
}

impl CohesiveLaw for NoAdhesive {
    fn kind(&self) -> &'static LawKind {
        &KIND
    }

    fn values(&self) -> Vec<f64> {
        Vec::new()
    }

    fn response(&self, _jump: Jump) -> CohesiveResponse {
        CohesiveResponse::default()
    }

    fn by_parameters(&self, _jump: Jump, _derivatives: &mut [Traction]) {}

    fn secant(&self, _jump: Jump) -> CohesiveStiffness {
        CohesiveStiffness::zeros()
    }

    fn peak(&self) -> Traction {
        Traction::default()
    }

    fn front_opening(&self) -> f64 {
        1.0
    }
}
