//! The potential of Park, Paulino and Roesler (2009), with works, strengths, shapes and slopes of both modes.

use super::dual::Dual;
use super::secants::{Secants, answer_by_secants, opening_and_sliding};
use super::{
    CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, LawKind, LawLimit, Parameter, Traction,
    all_positive, exactly,
};

/// The law called PPR. With `x = D_n/delta_n`, `y = |D_t|/delta_t` and the shape
///
/// ```text
/// A(x) = (alpha/m)^m (1 - x)^alpha (m/alpha + x)^m          m = alpha (alpha - 1) lambda_n^2 / (1 - alpha lambda_n^2)
/// ```
///
/// which falls from one at rest to zero at `x = 1` (`B(y)` the same of `beta`, `lambda_t`, `n`), the potential is
///
/// ```text
/// phi_n >= phi_t:  psi = phi_t + B (phi_n - phi_t - phi_n A)       phi_t >= phi_n:  psi = phi_n + A (phi_t - phi_n - phi_t B)
/// ```
///
/// and the tractions are its slopes while they resist; `delta_n` and `delta_t`, where they end, follow from the largest
/// tractions. In compression `T_n` is linear with the stiffness at the origin and sliding is pure mode II. Where `phi_n
/// = phi_t` the derivatives by these two jump for mixes of the modes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParkPaulinoRoesler {
    values: [f64; 8],
}

/// Jump and parameters.
type Number = Dual<10>;

/// What is the same of both modes.
struct Mode {
    /// Where the traction has fallen to zero, mm.
    end: Number,
    /// `m`, `alpha`.
    m: Number,
    alpha: Number,
}

impl Mode {
    /// From the work of separation, the largest traction, the shape and the share of `end` at which the largest
    /// traction lies: the traction `work/end (alpha + m) x A1(x)` has its maximum at `x = lambda` and is `strength`
    /// there.
    fn new([work, strength, alpha, lambda]: [Number; 4]) -> Self {
        let one = Number::constant(1.0);
        let m = alpha * (alpha - one) * lambda.squared() / (one - alpha * lambda.squared());
        let shape = Self { end: one, m, alpha };
        let end = work / strength * lambda * shape.slope(lambda);
        Self { end, ..shape }
    }

    /// `A(x)`.
    fn share(&self, x: Number) -> Number {
        let Self { m, alpha, .. } = *self;
        let one = Number::constant(1.0);
        if x.value >= 1.0 {
            return Number::constant(0.0);
        }
        (one - x).pow(alpha) * (one + alpha / m * x).pow(m)
    }

    /// `-A'(x)/x`.
    fn slope(&self, x: Number) -> Number {
        let Self { m, alpha, .. } = *self;
        let one = Number::constant(1.0);
        if x.value >= 1.0 {
            return Number::constant(0.0);
        }
        alpha / m * (alpha + m) * (one - x).pow(alpha - one) * (one + alpha / m * x).pow(m - one)
    }
}

pub(super) static KIND: LawKind = LawKind {
    name: ParkPaulinoRoesler::NAME,
    parameters: &[
        Parameter { name: "phi_n", unit: "N/mm", meaning: "work of separation in pure opening" },
        Parameter { name: "phi_t", unit: "N/mm", meaning: "work of separation in pure sliding" },
        Parameter { name: "T_n0", unit: "MPa", meaning: "largest traction in pure opening" },
        Parameter { name: "T_t0", unit: "MPa", meaning: "largest traction in pure sliding" },
        Parameter { name: "alpha", unit: "1", meaning: "shape of the softening in opening: 2 straight, more concave" },
        Parameter { name: "beta", unit: "1", meaning: "shape of the softening in sliding: 2 straight, more concave" },
        Parameter { name: "lambda_n", unit: "1", meaning: "opening at the largest traction over that of separation" },
        Parameter { name: "lambda_t", unit: "1", meaning: "sliding at the largest traction over that of separation" },
    ],
    make: |values| Ok(Box::new(ParkPaulinoRoesler::new(exactly(ParkPaulinoRoesler::NAME, values)?)?)),
};

impl ParkPaulinoRoesler {
    /// Its name in case files.
    pub const NAME: &'static str = "park-paulino-roesler";

    /// The law with the works of separation `phi_n`, `phi_t` (N/mm), the largest tractions `T_n0`, `T_t0` (MPa), the
    /// shapes `alpha`, `beta`, 2 or more, and the shares `lambda_n`, `lambda_t` of the jump at the largest
    /// traction.
    ///
    /// # Errors
    /// [`LawError::Parameter`] for the first that is not allowed; `alpha lambda_n^2` and `beta lambda_t^2` are less
    /// than one.
    pub fn new(values: [f64; 8]) -> Result<Self, LawError> {
        all_positive(KIND.parameters, &values)?;
        for (shape, share) in [(4, 6), (5, 7)] {
            let refused =
                |k: usize, needed| Err(LawError::Parameter { key: KIND.parameters[k].key(), value: values[k], needed });
            if values[shape] < 2.0 {
                return refused(shape, "it must be 2 or more, for the tangent to be bounded at separation");
            }
            if values[shape] * values[share].powi(2) >= 1.0 {
                return refused(
                    share,
                    "it must be below one over the root of the shape (alpha of lambda_n, beta of lambda_t)",
                );
            }
        }
        Ok(Self { values })
    }

    fn modes(values: [Number; 8]) -> [Mode; 2] {
        let [phi_n, phi_t, t_n0, t_t0, alpha, beta, lambda_n, lambda_t] = values;
        [Mode::new([phi_n, t_n0, alpha, lambda_n]), Mode::new([phi_t, t_t0, beta, lambda_t])]
    }

    fn secants(&self, jump: Jump) -> Secants<10> {
        let values = super::variables(self.values);
        let [phi_n, phi_t, ..] = values;
        let [opening, sliding] = Self::modes(values);
        let [normal, tangential] = opening_and_sliding(jump);
        let x = normal / opening.end;
        let y = (if jump.tangential < 0.0 { -tangential } else { tangential }) / sliding.end;
        let (a, b) = (opening.share(x), sliding.share(y));
        // What each mode has left beside the other; nothing where its slope would push.
        let left = |work: Number, other: Number, share: Number| {
            let left = if work.value >= other.value { work * share } else { other * share - (other - work) };
            if left.value > 0.0 { left } else { Number::constant(0.0) }
        };
        let elastic = phi_n / opening.end.squared() * opening.slope(Number::constant(0.0));
        Secants {
            normal: left(phi_n, phi_t, b) / opening.end.squared() * opening.slope(x),
            tangential: left(phi_t, phi_n, a) / sliding.end.squared() * sliding.slope(y),
            compression: elastic,
        }
    }
}

impl CohesiveLaw for ParkPaulinoRoesler {
    fn kind(&self) -> &'static LawKind {
        &KIND
    }

    fn values(&self) -> Vec<f64> {
        self.values.to_vec()
    }

    answer_by_secants!();

    fn has_own_minima(&self) -> bool {
        true
    }

    fn peak(&self) -> Traction {
        Traction { normal: self.values[2], tangential: self.values[3] }
    }

    fn range(&self, index: usize) -> [f64; 2] {
        [if index == 4 || index == 5 { 2.0 } else { 0.0 }, f64::INFINITY]
    }

    fn limits(&self) -> Vec<LawLimit> {
        let limit = |(shape, share, what): (usize, usize, &'static str)| {
            let mut by = vec![0.0; self.values.len()];
            (by[shape], by[share]) = (-1.0 / self.values[shape], -2.0 / self.values[share]);
            LawLimit { distance: -self.values[shape].ln() - 2.0 * self.values[share].ln(), by, what }
        };
        let what =
            ["in opening the largest traction is at separation", "in sliding the largest traction is at separation"];
        [(4, 6, what[0]), (5, 7, what[1])].map(limit).to_vec()
    }

    fn front_opening(&self) -> f64 {
        Self::modes(self.values.map(Number::constant))[0].end.value
    }
}
