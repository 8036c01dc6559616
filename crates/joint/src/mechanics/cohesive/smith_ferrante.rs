//! The exponential law of Smith and Ferrante in the mixed-mode form of Ortiz and Pandolfi (1999).

use super::dual::Dual;
use super::secants::{Secants, answer_by_secants, opening_and_sliding};
use super::{
    CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, LawKind, Parameter, Traction, all_positive,
    exactly,
};

/// One curve for all mixes of the modes. With the effective jump `lambda = sqrt(<D_n>^2 + beta^2 D_t^2)`:
///
/// ```text
/// T_n = G_c/delta_c^2 exp(-lambda/delta_c) D_n        T_t = beta^2 G_c/delta_c^2 exp(-lambda/delta_c) D_t
/// ```
///
/// It has the potential `G_c [1 - (1 + lambda/delta_c) exp(-lambda/delta_c)]`: the work of separation is `G_c` in every
/// mode, and the tangent is symmetric. In compression `T_n = G_c/delta_c^2 D_n` and sliding is pure mode II.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmithFerrante {
    values: [f64; 3],
}

pub(super) static KIND: LawKind = LawKind {
    name: SmithFerrante::NAME,
    parameters: &[
        Parameter { name: "G_c", unit: "N/mm", meaning: "work of separation in every mode" },
        Parameter { name: "delta_c", unit: "mm", meaning: "opening at the largest normal traction" },
        Parameter { name: "beta", unit: "1", meaning: "weight of the sliding in the effective jump" },
    ],
    make: |values| Ok(Box::new(SmithFerrante::new(exactly(SmithFerrante::NAME, values)?)?)),
};

impl SmithFerrante {
    /// Its name in case files.
    pub const NAME: &'static str = "smith-ferrante";

    /// The law with `G_c` (N/mm), `delta_c` (mm) and `beta`, all positive.
    ///
    /// # Errors
    /// [`LawError::Parameter`] for the first that is not.
    pub fn new(values: [f64; 3]) -> Result<Self, LawError> {
        all_positive(KIND.parameters, &values)?;
        Ok(Self { values })
    }

    fn secants(&self, jump: Jump) -> Secants<5> {
        let [_, _, beta] = super::variables::<3, 5>(self.values);
        let [normal, compression] = exponential_stiffness(self.values, jump);
        Secants { normal, tangential: beta.squared() * normal, compression }
    }
}

/// The stiffness that `exp(-lambda/delta_c)` leaves of `G_c/delta_c^2`, `lambda = sqrt(<D_n>^2 + beta^2 D_t^2)`, and
/// the whole one.
pub(super) fn exponential_stiffness(values: [f64; 3], jump: Jump) -> [Dual<5>; 2] {
    let [g_c, delta_c, beta] = super::variables(values);
    let [opening, sliding] = opening_and_sliding(jump);
    let stiffness = g_c / delta_c.squared();
    let length2 = opening.squared() + beta.squared() * sliding.squared();
    // At rest the root has no slope, but what it is multiplied with is zero.
    let normal = match length2.value < f64::MIN_POSITIVE {
        true => stiffness,
        false => stiffness * (-(length2.sqrt() / delta_c)).exp(),
    };
    [normal, stiffness]
}

impl CohesiveLaw for SmithFerrante {
    fn kind(&self) -> &'static LawKind {
        &KIND
    }

    fn values(&self) -> Vec<f64> {
        self.values.to_vec()
    }

    answer_by_secants!();

    fn peak(&self) -> Traction {
        let [g_c, delta_c, beta] = self.values;
        let normal = g_c / (std::f64::consts::E * delta_c);
        Traction { normal, tangential: beta * normal }
    }

    fn sliding_work(&self) -> Option<f64> {
        Some(self.values[0])
    }

    fn front_opening(&self) -> f64 {
        5.0 * self.values[1]
    }
}
