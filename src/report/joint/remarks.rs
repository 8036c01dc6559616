//! What there is to say of a computed instant.

use crate::remark::{About, Code, Remark};

fn at(code: Code, instant: usize, text: String) -> Remark {
    Remark::new(code, About::Instants(vec![instant]), text)
}

/// `n` pairs beyond their peak close, the first of them `[lower, upper]`.
pub(super) fn pairs_close(instant: usize, n: usize, [lower, upper]: [u32; 2]) -> Remark {
    let text = format!(
        "{n} node pairs beyond their peak close, the first ({lower}, {upper}): the law goes back along its curve \
         there, where a damaged adhesive would unload"
    );
    at(Code::PairsClose, instant, text).with("pairs", n)
}

/// The plastic `strain` of the material `group` is beyond the end of its curve.
pub(super) fn strain_beyond_curve(instant: usize, group: &str, strain: f64, end: f64) -> Remark {
    let text = format!(
        "the plastic strain of {group} reaches {strain:.2e}, its curve ends at {end:.2e}: beyond it the curve is \
         continued with its last slope"
    );
    at(Code::StrainBeyondCurve, instant, text).with("group", group).with("strain", strain).with("curve_end", end)
}

/// A strip turns by `w`, rad, beside a yield strain of `yields`.
pub(super) fn rotation_large(instant: usize, w: f64, yields: f64) -> Remark {
    let strain = 0.5 * w * w;
    let text = format!(
        "a strip turns by {w:.2e} rad: w^2/2 = {strain:.1e} is more than a tenth of the yield strain {yields:.1e}; \
         small rotations no longer hold: take kinematics = \"finite\""
    );
    at(Code::RotationLarge, instant, text).with("rotation_rad", w).with("yield_strain", yields)
}
