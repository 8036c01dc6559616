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

/// Peaks and initial stiffnesses of a law; for the laws with `phi_n` also `phi_t`, the work of separation in sliding.
pub fn derived(law: &dyn CohesiveLaw) -> Vec<Derived> {
    let values = law.values();
    let of = |name: &str| law.parameters().iter().position(|p| p.name == name).map(|k| values[k]);
    let (peak, tangent) = (law.peak(), law.response(Jump::default()).tangent);
    let mut list = Vec::new();
    if let (Some(phi_n), Some(ratio)) = (of("phi_n"), of("r").or(of("q"))) {
        list.push(Derived { name: "phi_t", unit: "N/mm", value: ratio * phi_n });
    }
    list.extend([
        Derived { name: "T_n_max", unit: "MPa", value: peak.normal },
        Derived { name: "T_t_max", unit: "MPa", value: peak.tangential },
        Derived { name: "initial_normal_stiffness", unit: "MPa/mm", value: tangent.m11 },
        Derived { name: "initial_tangential_stiffness", unit: "MPa/mm", value: tangent.m22 },
    ]);
    list
}
