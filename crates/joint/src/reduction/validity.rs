//! What the standards ask of a test before its results hold.

use super::beams::large;
use super::methods::{Method, MethodResult};
use super::specimen::{Instant, Layout, Specimen};

/// ASTM D5528: an initial crack is not longer than this times `sqrt(h^3 E/G)`, with the thickness h of both arms.
const CRACK_BY_THICKNESS: f64 = 0.042;
/// ISO 15024 and 25217: what large displacements take off beam theory leaves this much.
const LARGE: f64 = 0.9;

/// A condition of a standard.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// The condition, with its standard.
    pub what: &'static str,
    /// What the test has, and what it may have at most or at least.
    pub found: String,
    /// Whether it holds.
    pub holds: bool,
}

/// The conditions that can be looked at with what is known.
pub(super) fn checks(specimen: &Specimen, instants: &[Instant], methods: &[MethodResult]) -> Vec<Check> {
    if specimen.layout != Layout::Dcb {
        return Vec::new();
    }
    let release = methods.iter().find_map(|result| result.growth).map(|growth| growth.value).filter(|g| *g > 0.0);
    let of_compliance = methods.iter().find_map(|result| result.young_of_compliance);
    let young = specimen.young_mpa.or(of_compliance).map(|young| young.value);
    let crack =
        specimen.crack_mm.zip(specimen.arm_mm).zip(young.zip(release)).map(|((crack, arm), (young, release))| {
            let most = CRACK_BY_THICKNESS * ((2.0 * arm.value).powi(3) * young / release).sqrt();
            Check {
                what: "initial crack for the thickness (ASTM D5528)",
                found: format!("{:.1} mm; at most {most:.1} mm", crack.value),
                holds: crack.value <= most,
            }
        });
    let corrected = methods.iter().find(|result| result.method == Method::CorrectedBeam);
    let factors = corrected.into_iter().flat_map(|result| {
        let factor = |(k, instant): (usize, &Instant)| {
            Some(large(instant.displacement_mm?.value, result.crack_mm[k]?, specimen.end_block_mm))
        };
        instants.iter().enumerate().filter_map(factor)
    });
    let large = factors.reduce(f64::min).map(|least| Check {
        what: "factor F of large displacements (ISO 25217)",
        found: format!("{least:.3}; at least {LARGE}"),
        holds: least >= LARGE,
    });
    crack.into_iter().chain(large).collect()
}
