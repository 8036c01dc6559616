//! A law as two stiffnesses that depend on the jump: `T_n = S_n D_n`, `T_t = S_t D_t`, and in compression a constant
//! one.

use super::dual::Dual;
use super::{CohesiveResponse, CohesiveStiffness, Jump, Traction};
use nalgebra::Matrix2;

/// The methods of [`super::CohesiveLaw`] that follow from a method `secants` of the law: traction, tangent, derivatives
/// by the parameters and the secant matrix.
macro_rules! answer_by_secants {
    () => {
        fn response(&self, jump: Jump) -> CohesiveResponse {
            self.secants(jump).response(jump)
        }

        fn by_parameters(&self, jump: Jump, derivatives: &mut [Traction]) {
            self.secants(jump).by_parameters(jump, derivatives);
        }

        fn secant(&self, jump: Jump) -> CohesiveStiffness {
            self.secants(jump).matrix(jump)
        }
    };
}
pub(super) use answer_by_secants;

/// The stiffnesses at a jump, MPa/mm, with their derivatives by `D_n`, `D_t` and the parameters, in this order.
pub struct Secants<const N: usize> {
    /// `S_n = T_n/D_n` in opening.
    pub normal: Dual<N>,
    /// `S_t = T_t/D_t`.
    pub tangential: Dual<N>,
    /// `T_n/D_n` where the faces are pressed together: independent of the jump.
    pub compression: Dual<N>,
}

/// The jump as variables 0 and 1; closed faces have no opening.
pub fn opening_and_sliding<const N: usize>(jump: Jump) -> [Dual<N>; 2] {
    let normal = if jump.normal > 0.0 { Dual::variable(jump.normal, 0) } else { Dual::constant(0.0) };
    [normal, Dual::variable(jump.tangential, 1)]
}

impl<const N: usize> Secants<N> {
    /// Traction and tangent.
    pub fn response(&self, jump: Jump) -> CohesiveResponse {
        let Self { tangential, .. } = self;
        let normal = self.across(jump);
        CohesiveResponse {
            traction: Traction { normal: normal.value * jump.normal, tangential: tangential.value * jump.tangential },
            tangent: Matrix2::new(
                normal.value + jump.normal * normal.by[0],
                jump.normal * normal.by[1],
                jump.tangential * tangential.by[0],
                tangential.value + jump.tangential * tangential.by[1],
            ),
        }
    }

    /// Derivatives of the traction by each parameter, into `derivatives`.
    ///
    /// # Panics
    /// When `derivatives` has not as many entries as there are parameters.
    pub fn by_parameters(&self, jump: Jump, derivatives: &mut [Traction]) {
        assert_eq!(derivatives.len() + 2, N, "one derivative per parameter");
        let normal = self.across(jump);
        for (k, derivative) in derivatives.iter_mut().enumerate() {
            *derivative = Traction {
                normal: normal.by[2 + k] * jump.normal,
                tangential: self.tangential.by[2 + k] * jump.tangential,
            };
        }
    }

    /// Both on a diagonal.
    pub fn matrix(&self, jump: Jump) -> CohesiveStiffness {
        Matrix2::new(self.across(jump).value, 0.0, 0.0, self.tangential.value)
    }

    fn across(&self, jump: Jump) -> Dual<N> {
        if jump.normal > 0.0 { self.normal } else { self.compression }
    }
}
