//! An exponential law by one damage for both components.

use super::secants::{Secants, answer_by_secants};
use super::smith_ferrante::exponential_stiffness;
use super::{
    CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, LawKind, Parameter, Traction, all_positive,
    exactly,
};

/// One damage for both components, with one stiffness. With the effective jump `lambda = sqrt(<D_n>^2 + beta^2 D_t^2)`:
///
/// ```text
/// T_n = G_c/delta_c^2 exp(-lambda/delta_c) D_n        T_t = G_c/delta_c^2 exp(-lambda/delta_c) D_t
/// ```
///
/// Unlike [`super::SmithFerrante`] it has no potential where `beta` is not 1: the work of separation is `G_c` in
/// opening and `G_c/beta^2` in sliding, and between them it depends on the path. In compression `T_n = G_c/delta_c^2
/// D_n`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExponentialDamage {
    values: [f64; 3],
}

pub(super) static KIND: LawKind = LawKind {
    name: ExponentialDamage::NAME,
    parameters: &[
        Parameter { name: "G_c", unit: "N/mm", meaning: "work of separation in opening" },
        Parameter { name: "delta_c", unit: "mm", meaning: "opening at the largest normal traction" },
        Parameter { name: "beta", unit: "1", meaning: "weight of the sliding in the effective jump" },
    ],
    make: |values| Ok(Box::new(ExponentialDamage::new(exactly(ExponentialDamage::NAME, values)?)?)),
};

impl ExponentialDamage {
    /// Its name in case files.
    pub const NAME: &'static str = "exponential-damage";

    /// The law with `G_c` (N/mm), `delta_c` (mm) and `beta`, all positive.
    ///
    /// # Errors
    /// [`LawError::Parameter`] for the first that is not.
    pub fn new(values: [f64; 3]) -> Result<Self, LawError> {
        all_positive(KIND.parameters, &values)?;
        Ok(Self { values })
    }

    fn secants(&self, jump: Jump) -> Secants<5> {
        let [normal, compression] = exponential_stiffness(self.values, jump);
        Secants { normal, tangential: normal, compression }
    }
}

impl CohesiveLaw for ExponentialDamage {
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
        Traction { normal, tangential: normal / beta }
    }

    fn sliding_work(&self) -> Option<f64> {
        Some(self.values[0] / self.values[2].powi(2))
    }

    fn front_opening(&self) -> f64 {
        5.0 * self.values[1]
    }
}
