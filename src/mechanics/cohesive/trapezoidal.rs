//! A trapezoidal law, for adhesives that yield before they soften (Tvergaard and Hutchinson 1992), with the mixed modes of
//! Camanho and Davila (2002), holonomic and with rounded corners.

use super::dual::Dual;
use super::mixed_mode::{MixedModeCriterion, ROUNDING, check, onset_and_toughness, rounded_ramp, table};
use super::secants::{Secants, opening_and_sliding};
use super::{CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, Parameter, Traction};

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

static BENZEGGAGH_KENANE_TABLE: [Parameter; 7] = with_plateau(MixedModeCriterion::BenzeggaghKenane);
static POWER_TABLE: [Parameter; 7] = with_plateau(MixedModeCriterion::Power);

/// The trapezoidal law. With `lambda = sqrt(<D_n>^2 + D_t^2)` the traction, which points along the jump, grows as
/// `K lambda` up to the onset `lambda_0` of the bilinear law, stays up to `lambda_p = lambda_0 + s (lambda_f - lambda_0)`, `s` the parameter `plateau`, and
/// falls linearly to zero at `lambda_f`, where the work is the toughness `G_c` of the mix:
/// `lambda_f = (2 G_c/(K lambda_0) + s lambda_0)/(1 + s)`. With `s = 0` it is the bilinear law. Compression and rounding are those of
/// that law: the corners at `lambda_0` and `lambda_p` over a tenth of the onset, that at the end such that the work stays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trapezoidal {
    criterion: MixedModeCriterion,
    values: [f64; 7],
}

/// Jump and parameters.
type Number = Dual<9>;

impl Trapezoidal {
    /// Name of the law with the criterion of Benzeggagh and Kenane.
    pub const BENZEGGAGH_KENANE: &'static str = "trapezoidal-benzeggagh-kenane";
    /// Name of the law with the power criterion.
    pub const POWER: &'static str = "trapezoidal-power";

    /// Its name with a criterion.
    pub(super) const fn name_with(criterion: MixedModeCriterion) -> &'static str {
        match criterion {
            MixedModeCriterion::BenzeggaghKenane => Self::BENZEGGAGH_KENANE,
            MixedModeCriterion::Power => Self::POWER,
        }
    }

    /// Its parameters with a criterion.
    pub(super) fn parameters_with(criterion: MixedModeCriterion) -> &'static [Parameter] {
        match criterion {
            MixedModeCriterion::BenzeggaghKenane => &BENZEGGAGH_KENANE_TABLE,
            MixedModeCriterion::Power => &POWER_TABLE,
        }
    }

    /// The law with `K` (MPa/mm), `T_n0`, `T_t0` (MPa), `G_Ic`, `G_IIc` (N/mm), all positive, `eta`, 1 or more, and the share
    /// `plateau` of what follows the rise, zero or
    /// more and below one.
    ///
    /// # Errors
    /// [`LawError::Parameter`] for the first that is not allowed; nor may the falling branch vanish.
    pub fn new(criterion: MixedModeCriterion, values: [f64; 7]) -> Result<Self, LawError> {
        let parameters = Self::parameters_with(criterion);
        if !(0.0..1.0).contains(&values[6]) {
            let needed = "it must be zero or more, and below one";
            return Err(LawError::Parameter { key: parameters[6].key(), value: values[6], needed });
        }
        let law = Self { criterion, values };
        check(&parameters[..6], &values[..6], |c_n, c_t| law.corners(c_n, c_t))?;
        Ok(law)
    }

    fn corners(&self, c_n: f64, c_t: f64) -> [f64; 3] {
        let shares = [c_n, c_t].map(|c| Number::constant(c * c));
        corners(self.criterion, self.values.map(Number::constant), shares).map(|corner| corner.value)
    }

    /// The stiffness `tau(lambda)/lambda` of the effective traction, with all derivatives.
    fn stiffness(&self, jump: Jump) -> Number {
        let numbers: [Number; 7] = super::variables(self.values);
        let [normal2, tangential2] = opening_and_sliding(jump).map(Number::squared);
        let (length2, stiffness) = (normal2 + tangential2, numbers[0]);
        if length2.value < f64::MIN_POSITIVE {
            return stiffness;
        }
        let length = length2.sqrt();
        let shares = [normal2 / length2, tangential2 / length2];
        let [onset, plateau, end] = corners(self.criterion, numbers, shares);
        let falling = stiffness * onset / (end - plateau);
        let width = ROUNDING * onset;
        // What the roundings of a corner add to the work grows with its change of slope and its width squared.
        let width_end = width * (stiffness / falling + Number::constant(1.0)).sqrt();
        if length.value <= onset.value - width.value {
            return stiffness;
        }
        if length.value >= end.value + width_end.value {
            return Number::constant(0.0);
        }
        let cut = stiffness * rounded_ramp(length - onset, width) + falling * rounded_ramp(length - plateau, width);
        stiffness - (cut - falling * rounded_ramp(length - end, width_end)) / length
    }

    fn secants(&self, jump: Jump) -> Secants<9> {
        let stiffness = self.stiffness(jump);
        Secants { normal: stiffness, tangential: stiffness, compression: Number::variable(self.values[0], 2) }
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
    fn name(&self) -> &'static str {
        Self::name_with(self.criterion)
    }

    fn parameters(&self) -> &'static [Parameter] {
        Self::parameters_with(self.criterion)
    }

    fn values(&self) -> Vec<f64> {
        self.values.to_vec()
    }

    fn with_values(&self, values: &[f64]) -> Result<Box<dyn CohesiveLaw>, LawError> {
        Ok(Box::new(Self::new(self.criterion, super::exactly(self.name(), values)?)?))
    }

    fn response(&self, jump: Jump) -> CohesiveResponse {
        self.secants(jump).response(jump)
    }

    fn by_parameters(&self, jump: Jump, derivatives: &mut [Traction]) {
        self.secants(jump).by_parameters(jump, derivatives);
    }

    fn secant(&self, jump: Jump) -> CohesiveStiffness {
        self.secants(jump).matrix(jump)
    }

    fn peak(&self) -> Traction {
        Traction { normal: self.values[1], tangential: self.values[2] }
    }

    fn front_opening(&self) -> f64 {
        self.corners(1.0, 0.0)[2]
    }
}
