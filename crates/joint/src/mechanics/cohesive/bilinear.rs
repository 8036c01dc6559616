//! A bilinear law with mixed-mode propagation after Camanho and Davila (2002), holonomic and with rounded
//! corners.

use super::dual::Dual;
use super::mixed_mode::{self, Corners, MixedModeCriterion, check, onset_and_toughness, rise_and_fall, table};
use super::secants::{Secants, answer_by_secants};
use super::{
    CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, LawKind, LawLimit, Traction, exactly, variables,
};

/// The bilinear law. With `lambda = sqrt(<D_n>^2 + D_t^2)` and the shares `c_n = <D_n>/lambda`, `c_t = D_t/lambda`
/// of the modes, the traction grows as `K lambda` up to the onset `lambda_0`, where `(K lambda_0)^2 ((c_n/T_n0)^2 +
/// (c_t/T_t0)^2) = 1`, and falls linearly to zero at `lambda_f = 2 G_c/(K lambda_0)`; it points along the jump.
/// In compression `T_n = K D_n` and sliding is pure mode II. Holonomic: what is loaded and unloaded returns on
/// the same line.
///
/// The corners at the onset and at the end are rounded by parabolas, over `lambda_0 (1 +- ROUNDING)` and, at the
/// end, over a width such that the work of separation stays exactly `G_c`: the tangent is continuous along a
/// path of constant mix, as Newton needs it. The largest traction is lowered by the factor `1 - ROUNDING
/// lambda_0/lambda_f`. The kink of `T_n` at zero opening of a damaged point remains (line search).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bilinear {
    criterion: MixedModeCriterion,
    values: [f64; 6],
}

pub(super) static KINDS: [LawKind; 2] = [
    LawKind {
        name: Bilinear::BENZEGGAGH_KENANE,
        parameters: &table(MixedModeCriterion::BenzeggaghKenane),
        make: |values| Bilinear::boxed(MixedModeCriterion::BenzeggaghKenane, values),
    },
    LawKind {
        name: Bilinear::POWER,
        parameters: &table(MixedModeCriterion::Power),
        make: |values| Bilinear::boxed(MixedModeCriterion::Power, values),
    },
];

/// Jump and parameters.
type Number = Dual<8>;

impl Bilinear {
    /// Name of the law with the criterion of Benzeggagh and Kenane.
    pub const BENZEGGAGH_KENANE: &'static str = "bilinear-benzeggagh-kenane";
    /// Name of the law with the power criterion.
    pub const POWER: &'static str = "bilinear-power";

    /// The law with `K` (MPa/mm), `T_n0`, `T_t0` (MPa), `G_Ic`, `G_IIc` (N/mm), all positive, and `eta`, 1 or more.
    ///
    /// # Errors
    /// [`LawError::Parameter`] for the first that is not allowed; a toughness so small that nothing is left of
    /// the falling branch (`lambda_f` below 1.5 `lambda_0`) is not.
    pub fn new(criterion: MixedModeCriterion, values: [f64; 6]) -> Result<Self, LawError> {
        let law = Self { criterion, values };
        check(KINDS[criterion as usize].parameters, &values, |c_n, c_t| {
            let (onset, end) = law.onset_and_end(c_n, c_t);
            [onset, onset, end]
        })?;
        Ok(law)
    }

    fn boxed(criterion: MixedModeCriterion, values: &[f64]) -> Result<Box<dyn CohesiveLaw>, LawError> {
        Ok(Box::new(Self::new(criterion, exactly(KINDS[criterion as usize].name, values)?)?))
    }

    fn onset_and_end(&self, c_n: f64, c_t: f64) -> (f64, f64) {
        let numbers = self.values.map(Number::constant);
        let shares = [c_n, c_t].map(|c| Number::constant(c * c));
        let (onset, end) = onset_and_end(self.criterion, numbers, shares);
        (onset.value, end.value)
    }

    fn secants(&self, jump: Jump) -> Secants<8> {
        let numbers: [Number; 6] = variables(self.values);
        rise_and_fall(jump, numbers[0], |shares| {
            let (onset, end) = onset_and_end(self.criterion, numbers, shares);
            Corners { onset, plateau: None, end }
        })
    }
}

/// Onset and end of the softening for the squared shares `c_n^2`, `c_t^2` of the modes, mm.
fn onset_and_end(criterion: MixedModeCriterion, values: [Number; 6], shares: [Number; 2]) -> (Number, Number) {
    let [onset, toughness] = onset_and_toughness(criterion, values, shares);
    (onset, 2.0 * toughness / (values[0] * onset))
}

impl CohesiveLaw for Bilinear {
    fn kind(&self) -> &'static LawKind {
        &KINDS[self.criterion as usize]
    }

    fn values(&self) -> Vec<f64> {
        self.values.to_vec()
    }

    answer_by_secants!();

    fn has_own_minima(&self) -> bool {
        true
    }

    fn peak(&self) -> Traction {
        Traction { normal: self.values[1], tangential: self.values[2] }
    }

    fn range(&self, index: usize) -> [f64; 2] {
        [if index == 5 { 1.0 } else { 0.0 }, f64::INFINITY]
    }

    fn limits(&self) -> Vec<LawLimit> {
        mixed_mode::limits::<8>(self.criterion, variables(self.values), None)
    }

    fn front_opening(&self) -> f64 {
        self.onset_and_end(1.0, 0.0).1
    }
}
