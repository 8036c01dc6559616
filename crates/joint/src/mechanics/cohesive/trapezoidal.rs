//! A trapezoidal law, for adhesives that yield before they soften (Tvergaard and Hutchinson 1992), with the mixed modes
//! of Camanho and Davila (2002), holonomic and with rounded corners.

use super::dual::Dual;
use super::mixed_mode::{self, Corners, MixedModeCriterion, check, onset_and_toughness, rise_and_fall, table};
use super::secants::{Secants, answer_by_secants};
use super::{
    CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, LawKind, LawLimit, Parameter, Traction, exactly,
    variables,
};

const fn with_plateau(criterion: MixedModeCriterion) -> [Parameter; 7] {
    let [a, b, c, d, e, f] = table(criterion);
    [
        a,
        b,
        c,
        d,
        e,
        f,
        Parameter { name: "plateau", unit: "1", meaning: "length of the plateau over that of plateau and fall" },
    ]
}

/// The trapezoidal law. With `lambda = sqrt(<D_n>^2 + D_t^2)` the traction, which points along the jump, grows as
/// `K lambda` up to the onset `lambda_0` of the bilinear law, stays up to `lambda_p = lambda_0 + s (lambda_f -
/// lambda_0)`, `s` the parameter `plateau`, and falls linearly to zero at `lambda_f`, where the work is the toughness
/// `G_c` of the mix: `lambda_f = (2 G_c/(K lambda_0) + s lambda_0)/(1 + s)`. With `s = 0` it is the bilinear law.
/// Compression and rounding are those of that law: the corners at `lambda_0` and `lambda_p` over a tenth of the onset,
/// that at the end such that the work stays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trapezoidal {
    criterion: MixedModeCriterion,
    values: [f64; 7],
}

pub(super) static KINDS: [LawKind; 2] = [
    LawKind {
        name: Trapezoidal::BENZEGGAGH_KENANE,
        parameters: &with_plateau(MixedModeCriterion::BenzeggaghKenane),
        make: |values| Trapezoidal::boxed(MixedModeCriterion::BenzeggaghKenane, values),
    },
    LawKind {
        name: Trapezoidal::POWER,
        parameters: &with_plateau(MixedModeCriterion::Power),
        make: |values| Trapezoidal::boxed(MixedModeCriterion::Power, values),
    },
];

/// Jump and parameters.
type Number = Dual<9>;

impl Trapezoidal {
    /// Name of the law with the criterion of Benzeggagh and Kenane.
    pub const BENZEGGAGH_KENANE: &'static str = "trapezoidal-benzeggagh-kenane";
    /// Name of the law with the power criterion.
    pub const POWER: &'static str = "trapezoidal-power";

    /// The law with `K` (MPa/mm), `T_n0`, `T_t0` (MPa), `G_Ic`, `G_IIc` (N/mm), all positive, `eta`, 1 or more, and the
    /// share `plateau` of what follows the rise, zero or
    /// more and below one.
    ///
    /// # Errors
    /// [`LawError::Parameter`] for the first that is not allowed; nor may the falling branch vanish.
    pub fn new(criterion: MixedModeCriterion, values: [f64; 7]) -> Result<Self, LawError> {
        let parameters = KINDS[criterion as usize].parameters;
        if !(0.0..1.0).contains(&values[6]) {
            let needed = "it must be zero or more, and below one";
            return Err(LawError::Parameter { key: parameters[6].key(), value: values[6], needed });
        }
        let law = Self { criterion, values };
        check(&parameters[..6], &values[..6], |c_n, c_t| law.corners(c_n, c_t))?;
        Ok(law)
    }

    fn boxed(criterion: MixedModeCriterion, values: &[f64]) -> Result<Box<dyn CohesiveLaw>, LawError> {
        Ok(Box::new(Self::new(criterion, exactly(KINDS[criterion as usize].name, values)?)?))
    }

    fn corners(&self, c_n: f64, c_t: f64) -> [f64; 3] {
        let shares = [c_n, c_t].map(|c| Number::constant(c * c));
        corners(self.criterion, self.values.map(Number::constant), shares).map(|corner| corner.value)
    }

    fn secants(&self, jump: Jump) -> Secants<9> {
        let numbers: [Number; 7] = variables(self.values);
        rise_and_fall(jump, numbers[0], |shares| {
            let [onset, plateau, end] = corners(self.criterion, numbers, shares);
            Corners { onset, plateau: Some(plateau), end }
        })
    }
}

/// Onset, end of the plateau and end for the squared shares `c_n^2`, `c_t^2` of the modes, mm.
fn corners(criterion: MixedModeCriterion, values: [Number; 7], shares: [Number; 2]) -> [Number; 3] {
    let [stiffness, t_n0, t_t0, g_ic, g_iic, eta, s] = values;
    let [onset, toughness] = onset_and_toughness(criterion, [stiffness, t_n0, t_t0, g_ic, g_iic, eta], shares);
    let end = (2.0 * toughness / (stiffness * onset) + s * onset) / (Number::constant(1.0) + s);
    [onset, onset + s * (end - onset), end]
}

impl CohesiveLaw for Trapezoidal {
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
        match index {
            5 => [1.0, f64::INFINITY],
            6 => [0.0, 1.0],
            _ => [0.0, f64::INFINITY],
        }
    }

    fn limits(&self) -> Vec<LawLimit> {
        let [stiffness, t_n0, t_t0, g_ic, g_iic, eta, plateau] = variables::<7, 9>(self.values);
        mixed_mode::limits(self.criterion, [stiffness, t_n0, t_t0, g_ic, g_iic, eta], Some(plateau))
    }

    fn front_opening(&self) -> f64 {
        self.corners(1.0, 0.0)[2]
    }
}
