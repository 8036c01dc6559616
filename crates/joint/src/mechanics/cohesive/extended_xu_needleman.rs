//! The extended Xu-Needleman law: two works of separation, a penalty in compression (THEORY 4; van den Bosch,
//! Schreurs, Geers 2006).

use super::{
    CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, LawKind, Parameter, Traction, all_positive,
    exactly,
};
use nalgebra::Matrix2;

/// The law of the paper: `T_n = phi_n/delta_n a e`, `T_t = 2 r phi_n/delta_t b (1 + a) e` with `a = D_n/delta_n`,
/// `b = D_t/delta_t`, `e = exp(-a - b^2)`; in compression the normal traction is linear with the stiffness at
/// the origin, and the tangential one that of pure sliding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtendedXuNeedleman {
    phi_n: f64,
    delta_n: f64,
    delta_t: f64,
    r: f64,
}

pub(super) static KIND: LawKind = LawKind {
    name: ExtendedXuNeedleman::NAME,
    parameters: &[
        Parameter { name: "phi_n", unit: "N/mm", meaning: "work of separation in pure opening" },
        Parameter { name: "delta_n", unit: "mm", meaning: "opening at the largest normal traction" },
        Parameter {
            name: "delta_t",
            unit: "mm",
            meaning: "sqrt(2) times the sliding at the largest tangential traction",
        },
        Parameter { name: "r", unit: "1", meaning: "work of separation in pure sliding over phi_n" },
    ],
    make: |values| {
        let [phi_n, delta_n, delta_t, r] = exactly(ExtendedXuNeedleman::NAME, values)?;
        Ok(Box::new(ExtendedXuNeedleman::new(phi_n, delta_n, delta_t, r)?))
    },
};

impl ExtendedXuNeedleman {
    /// Its name in case files.
    pub const NAME: &'static str = "extended-xu-needleman";

    /// The law with `phi_n` (N/mm), `delta_n` and `delta_t` (mm), and `r = phi_t/phi_n`, all positive.
    ///
    /// # Errors
    /// [`LawError::Parameter`] for the first that is not.
    pub fn new(phi_n: f64, delta_n: f64, delta_t: f64, r: f64) -> Result<Self, LawError> {
        all_positive(KIND.parameters, &[phi_n, delta_n, delta_t, r])?;
        Ok(Self { phi_n, delta_n, delta_t, r })
    }

    /// Work of separation in pure sliding, N/mm.
    pub fn phi_t(&self) -> f64 {
        self.r * self.phi_n
    }

    /// `a` (zero in compression, where the exponential does not act), `b`, `exp(-a - b^2)`.
    fn reduced(&self, jump: Jump) -> (f64, f64, f64) {
        let a = (jump.normal / self.delta_n).max(0.0);
        let b = jump.tangential / self.delta_t;
        (a, b, (-a - b * b).exp())
    }
}

impl CohesiveLaw for ExtendedXuNeedleman {
    fn kind(&self) -> &'static LawKind {
        &KIND
    }

    fn values(&self) -> Vec<f64> {
        vec![self.phi_n, self.delta_n, self.delta_t, self.r]
    }

    fn response(&self, jump: Jump) -> CohesiveResponse {
        let Self { phi_n, delta_n, delta_t, .. } = *self;
        let phi_t = self.phi_t();
        let (a, b, e) = self.reduced(jump);
        let tangential = 2.0 * phi_t / delta_t * b * (1.0 + a) * e;
        let slope_t = 2.0 * phi_t / (delta_t * delta_t) * (1.0 + a) * (1.0 - 2.0 * b * b) * e;
        if jump.normal < 0.0 {
            let stiffness = phi_n / (delta_n * delta_n);
            return CohesiveResponse {
                traction: Traction { normal: stiffness * jump.normal, tangential },
                tangent: Matrix2::new(stiffness, 0.0, 0.0, slope_t),
            };
        }
        let cross = -2.0 * a * b * e / (delta_n * delta_t);
        CohesiveResponse {
            traction: Traction { normal: phi_n / delta_n * a * e, tangential },
            tangent: Matrix2::new(phi_n / (delta_n * delta_n) * (1.0 - a) * e, phi_n * cross, phi_t * cross, slope_t),
        }
    }

    fn by_parameters(&self, jump: Jump, derivatives: &mut [Traction]) {
        let Self { phi_n, delta_n, delta_t, r } = *self;
        let Traction { normal, tangential } = self.response(jump).traction;
        let (a, b, e) = self.reduced(jump);
        let (by_delta_n, normal_by_delta_t) = if jump.normal < 0.0 {
            (Traction { normal: -2.0 * normal / delta_n, tangential: 0.0 }, 0.0)
        } else {
            let tangential = 2.0 * self.phi_t() / (delta_t * delta_n) * a * a * b * e;
            (Traction { normal: normal / delta_n * (a - 2.0), tangential }, 2.0 * b * b * normal / delta_t)
        };
        derivatives.copy_from_slice(&[
            Traction { normal: normal / phi_n, tangential: tangential / phi_n },
            by_delta_n,
            Traction { normal: normal_by_delta_t, tangential: 2.0 * tangential / delta_t * (b * b - 1.0) },
            Traction { normal: 0.0, tangential: tangential / r },
        ]);
    }

    fn secant(&self, jump: Jump) -> CohesiveStiffness {
        let (a, _, e) = self.reduced(jump);
        let stiffness = self.phi_n / (self.delta_n * self.delta_n);
        let normal = if jump.normal < 0.0 { stiffness } else { stiffness * e };
        let tangential = 2.0 * self.phi_t() / (self.delta_t * self.delta_t) * (1.0 + a) * e;
        Matrix2::new(normal, 0.0, 0.0, tangential)
    }

    fn peak(&self) -> Traction {
        Traction {
            normal: self.phi_n / (std::f64::consts::E * self.delta_n),
            tangential: (2.0 / std::f64::consts::E).sqrt() * self.phi_t() / self.delta_t,
        }
    }

    fn sliding_work(&self) -> Option<f64> {
        Some(self.phi_t())
    }

    fn front_opening(&self) -> f64 {
        5.0 * self.delta_n
    }
}
