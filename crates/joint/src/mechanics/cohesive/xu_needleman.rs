//! The law of Xu and Needleman (1993), from one potential, with its parameters `q` and `r*`.

use super::dual::Dual;
use super::{
    CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, LawKind, Parameter, Traction, all_positive,
    exactly,
};
use nalgebra::Matrix2;

/// The original law. With `a = D_n/delta_n`, `b = D_t/delta_t`, `k = (1 - q)/(r* - 1)`, `m = (r* - q)/(r* - 1)`:
///
/// ```text
/// T_n = phi_n/delta_n e^-a { a e^(-b^2) + k (1 - e^(-b^2)) (r* - a) }
/// T_t = 2 phi_n/delta_t b { q + m a } e^-a e^(-b^2)
/// ```
///
/// `q = phi_t/phi_n` is the ratio of the works of separation (the `r` of the extended law), `r*` the normal
/// jump after complete sliding without normal traction, over `delta_n`. The same expressions hold in
/// compression. The tangent is symmetric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct XuNeedleman {
    phi_n: f64,
    delta_n: f64,
    delta_t: f64,
    q: f64,
    r_star: f64,
}

/// Jump and parameters.
type Number = Dual<7>;

pub(super) static KIND: LawKind = LawKind {
    name: XuNeedleman::NAME,
    parameters: &[
        Parameter { name: "phi_n", unit: "N/mm", meaning: "work of separation in pure opening" },
        Parameter { name: "delta_n", unit: "mm", meaning: "opening at the largest normal traction" },
        Parameter {
            name: "delta_t",
            unit: "mm",
            meaning: "sqrt(2) times the sliding at the largest tangential traction",
        },
        Parameter { name: "q", unit: "1", meaning: "work of separation in pure sliding over phi_n" },
        Parameter { name: "r_star", unit: "1", meaning: "normal jump after complete sliding at T_n = 0, over delta_n" },
    ],
    make: |values| {
        let [phi_n, delta_n, delta_t, q, r_star] = exactly(XuNeedleman::NAME, values)?;
        Ok(Box::new(XuNeedleman::new(phi_n, delta_n, delta_t, q, r_star)?))
    },
};

impl XuNeedleman {
    /// Its name in case files.
    pub const NAME: &'static str = "xu-needleman";

    /// The law with `phi_n` (N/mm), `delta_n`, `delta_t` (mm), `q` all positive, and `r_star`, zero or more but not 1.
    ///
    /// # Errors
    /// [`LawError::Parameter`] for the first that is not.
    pub fn new(phi_n: f64, delta_n: f64, delta_t: f64, q: f64, r_star: f64) -> Result<Self, LawError> {
        all_positive(&KIND.parameters[..4], &[phi_n, delta_n, delta_t, q])?;
        let key = KIND.parameters[4].key();
        if !(r_star.is_finite() && r_star >= 0.0) {
            return Err(LawError::Parameter { key, value: r_star, needed: "it must be a finite number, zero or more" });
        }
        // The law divides by r* - 1; close to it the two terms cancel.
        if (r_star - 1.0).abs() < 1e-6 {
            let needed = "the law divides by r_star - 1; take another value, such as 0";
            return Err(LawError::Parameter { key, value: r_star, needed });
        }
        Ok(Self { phi_n, delta_n, delta_t, q, r_star })
    }

    /// Traction with its derivatives by normal and tangential jump and the five parameters, in this order.
    fn evaluate(&self, jump: Jump) -> [Number; 2] {
        let (phi_n, delta_n, delta_t) =
            (Number::variable(self.phi_n, 2), Number::variable(self.delta_n, 3), Number::variable(self.delta_t, 4));
        let (q, r_star, one) = (Number::variable(self.q, 5), Number::variable(self.r_star, 6), Number::constant(1.0));
        let a = Number::variable(jump.normal, 0) / delta_n;
        let b = Number::variable(jump.tangential, 1) / delta_t;
        let [k, m] = [one - q, r_star - q].map(|numerator| numerator / (r_star - one));
        let (opened, slid) = ((-a).exp(), (-b.squared()).exp());
        let normal = phi_n / delta_n * opened * (a * slid + k * b.squared().one_minus_exp_minus() * (r_star - a));
        let tangential = 2.0 * (phi_n / delta_t * b * (q + m * a) * opened * slid);
        [normal, tangential]
    }
}

impl CohesiveLaw for XuNeedleman {
    fn kind(&self) -> &'static LawKind {
        &KIND
    }

    fn values(&self) -> Vec<f64> {
        vec![self.phi_n, self.delta_n, self.delta_t, self.q, self.r_star]
    }

    fn response(&self, jump: Jump) -> CohesiveResponse {
        let [normal, tangential] = self.evaluate(jump);
        CohesiveResponse {
            traction: Traction { normal: normal.value, tangential: tangential.value },
            tangent: Matrix2::new(normal.by[0], normal.by[1], tangential.by[0], tangential.by[1]),
        }
    }

    fn by_parameters(&self, jump: Jump, derivatives: &mut [Traction]) {
        let [normal, tangential] = self.evaluate(jump);
        assert_eq!(derivatives.len(), KIND.parameters.len(), "one derivative per parameter");
        for (k, derivative) in derivatives.iter_mut().enumerate() {
            *derivative = Traction { normal: normal.by[2 + k], tangential: tangential.by[2 + k] };
        }
    }

    fn secant(&self, jump: Jump) -> CohesiveStiffness {
        let Self { phi_n, delta_n, delta_t, q, r_star } = *self;
        let (a, b) = (jump.normal / delta_n, jump.tangential / delta_t);
        let (k, m) = ((1.0 - q) / (r_star - 1.0), (r_star - q) / (r_star - 1.0));
        let (opened, slid) = ((-a).exp(), (-b * b).exp());
        // (1 - e^(-b^2))/b, which vanishes with b.
        let share = if b == 0.0 { 0.0 } else { -(-b * b).exp_m1() / b };
        Matrix2::new(
            phi_n / (delta_n * delta_n) * opened * slid,
            phi_n / (delta_n * delta_t) * opened * k * share * (r_star - a),
            0.0,
            2.0 * phi_n / (delta_t * delta_t) * (q + m * a) * opened * slid,
        )
    }

    fn peak(&self) -> Traction {
        Traction {
            normal: self.phi_n / (std::f64::consts::E * self.delta_n),
            tangential: (2.0 / std::f64::consts::E).sqrt() * self.q * self.phi_n / self.delta_t,
        }
    }

    fn sliding_work(&self) -> Option<f64> {
        Some(self.q * self.phi_n)
    }

    fn front_opening(&self) -> f64 {
        5.0 * self.delta_n
    }
}
