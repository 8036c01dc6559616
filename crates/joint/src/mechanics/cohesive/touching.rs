//! Faces of a crack: they press on each other where they meet, without friction, and hold nothing else.

use super::{CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawKind, Traction};
use nalgebra::Matrix2;

/// What is left of a law in a crack: its normal traction in compression.
#[derive(Debug, Clone, Copy)]
pub struct Touching<'a>(pub &'a dyn CohesiveLaw);

impl Touching<'_> {
    /// The jump that the law sees, where the faces press on each other.
    fn pressed(jump: Jump) -> Option<Jump> {
        (jump.normal < 0.0).then_some(Jump { normal: jump.normal, tangential: 0.0 })
    }
}

impl CohesiveLaw for Touching<'_> {
    /// That of the law itself, uncracked.
    fn kind(&self) -> &'static LawKind {
        self.0.kind()
    }

    fn values(&self) -> Vec<f64> {
        self.0.values()
    }

    fn response(&self, jump: Jump) -> CohesiveResponse {
        let Some(jump) = Self::pressed(jump) else { return CohesiveResponse::default() };
        let CohesiveResponse { traction, tangent } = self.0.response(jump);
        CohesiveResponse {
            traction: Traction { normal: traction.normal, tangential: 0.0 },
            tangent: Matrix2::new(tangent.m11, 0.0, 0.0, 0.0),
        }
    }

    fn by_parameters(&self, jump: Jump, derivatives: &mut [Traction]) {
        match Self::pressed(jump) {
            None => derivatives.fill(Traction::default()),
            Some(jump) => {
                self.0.by_parameters(jump, derivatives);
                derivatives.iter_mut().for_each(|by| by.tangential = 0.0);
            }
        }
    }

    fn secant(&self, jump: Jump) -> CohesiveStiffness {
        Self::pressed(jump)
            .map_or_else(CohesiveStiffness::zeros, |jump| Matrix2::new(self.0.secant(jump).m11, 0.0, 0.0, 0.0))
    }

    fn has_own_minima(&self) -> bool {
        self.0.has_own_minima()
    }

    fn peak(&self) -> Traction {
        Traction::default()
    }

    fn front_opening(&self) -> f64 {
        self.0.front_opening()
    }
}
