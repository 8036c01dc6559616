//! Quantities that follow from the parameters of a law.

use crate::mechanics::cohesive::{CohesiveLaw, Jump};

/// A quantity that follows from the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derived {
    /// Its symbol.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Its value.
    pub value: f64,
}

/// Peaks and initial stiffnesses of a law; `phi_t`, the work of separation in sliding, of laws that it is no parameter
/// of.
pub fn derived(law: &dyn CohesiveLaw) -> Vec<Derived> {
    let (peak, tangent) = (law.peak(), law.response(Jump::default()).tangent);
    let mut list = Vec::new();
    if let Some(value) = law.sliding_work() {
        list.push(Derived { name: "phi_t", unit: "N/mm", value });
    }
    list.extend([
        Derived { name: "T_n_max", unit: "MPa", value: peak.normal },
        Derived { name: "T_t_max", unit: "MPa", value: peak.tangential },
        Derived { name: "initial_normal_stiffness", unit: "MPa/mm", value: tangent.m11 },
        Derived { name: "initial_tangential_stiffness", unit: "MPa/mm", value: tangent.m22 },
    ]);
    list
}
