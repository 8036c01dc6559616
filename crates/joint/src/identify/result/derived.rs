//! Quantities that follow from the parameters of a law.

use crate::identify::{Evaluation, Problem};
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

/// Name of the work up to the furthest jump.
pub const WORK_REACHED: &str = "work_reached";
/// Parts of a straight path from the closed joint over which its work is summed, denser at the start.
const PARTS: i32 = 400;
/// How many times a path is doubled in search of the end of its work, and the growth that counts as none.
const DOUBLINGS: i32 = 16;
const NO_GROWTH: f64 = 1e-4;

/// Peaks and initial stiffnesses of a law; `phi_t`, the work of separation in sliding, of laws that it is no parameter
/// of; the work up to the `furthest` jump of the joint (THEORY 11).
pub fn derived(law: &dyn CohesiveLaw, furthest: Option<Jump>) -> Vec<Derived> {
    if law.parameters().is_empty() {
        return Vec::new();
    }
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
    list.extend(furthest.map(|jump| Derived { name: WORK_REACHED, unit: "N/mm", value: work_along(law, jump) }));
    list
}

/// Work of the law along the straight path from the closed joint to `jump`, N/mm: the middles of parts that grow as the
/// numbers do.
pub fn work_along(law: &dyn CohesiveLaw, jump: Jump) -> f64 {
    let of = |k: i32| {
        let q = (f64::from(k) + 0.5) / f64::from(PARTS);
        let traction = law.response((q * q * jump.vector()).into()).traction;
        2.0 * q / f64::from(PARTS) * traction.vector().dot(&jump.vector())
    };
    (0..PARTS).map(of).sum()
}

/// The share of the work along the path to `jump` that the law has beyond it.
pub(crate) fn share_beyond(law: &dyn CohesiveLaw, jump: Jump) -> f64 {
    let here = work_along(law, jump);
    let mut whole = here;
    for k in 1..=DOUBLINGS {
        let more = work_along(law, (2f64.powi(k) * jump.vector()).into());
        if more - whole < NO_GROWTH * whole {
            break;
        }
        whole = more;
    }
    1.0 - here / whole
}

/// Of the largest jump of each pair at the instants compared, that on which `law` does the most work: as far as the test
/// bears it.
pub(crate) fn furthest(problem: &Problem<'_>, evaluation: &Evaluation, law: &dyn CohesiveLaw) -> Option<Jump> {
    let instants = &evaluation.solution.instants;
    let mut of_pairs: Vec<Jump> = Vec::new();
    for observed in &problem.observation.instants {
        let jumps = problem.joint.model.jumps(&instants[observed.index].displacement);
        of_pairs.resize(jumps.len(), Jump::default());
        for (most, jump) in of_pairs.iter_mut().zip(jumps) {
            // A joint that is pressed together has done no work of separation.
            let jump = Jump { normal: jump.normal.max(0.0), ..jump };
            if jump.vector().norm() > most.vector().norm() {
                *most = jump;
            }
        }
    }
    let works = of_pairs.into_iter().map(|jump| (jump, work_along(law, jump))).filter(|(_, work)| *work > 0.0);
    works.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(jump, _)| jump)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanics::cohesive::law_by_name;

    #[test]
    fn the_work_along_pure_modes_is_the_work_of_separation() {
        // A corner between two of 400 middles: 1e-3 of the work at the most.
        let bilinear = law_by_name("bilinear-power", &[2e3, 12.0, 15.0, 0.5, 0.8, 1.0]).unwrap();
        let exponential = law_by_name("smith-ferrante", &[0.5, 0.02, 1.5]).unwrap();
        let opening = |mm: f64| Jump { normal: mm, tangential: 0.0 };
        let sliding = |mm: f64| Jump { normal: 0.0, tangential: mm };
        for (law, jump, work) in [
            (&bilinear, opening(0.2), 0.5),
            (&bilinear, sliding(-0.2), 0.8),
            (&exponential, opening(0.6), 0.5),
            (&exponential, sliding(0.6), 0.5),
        ] {
            assert!((work_along(&**law, jump) / work - 1.0).abs() < 1e-3, "{} {jump:?}", law.name());
            assert!(share_beyond(&**law, jump) < 1e-3);
        }
        // Of exponentials 1 - (1 + x) exp(-x) of the work is done at x.
        let x: f64 = 2.0;
        let beyond = (1.0 + x) * (-x).exp();
        assert!((share_beyond(&*exponential, opening(0.04)) - beyond).abs() < 1e-3);
    }
}
