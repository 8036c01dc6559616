//! A bilinear law with mixed-mode propagation after Camanho and Davila (2002), holonomic and with rounded
//! corners.

use super::dual::Dual;
use super::{CohesiveLaw, CohesiveResponse, CohesiveStiffness, Jump, LawError, Parameter, Traction, all_positive};
use nalgebra::{Matrix2, RowVector2};

/// How the toughness depends on the mix of the modes, `B = G_II/(G_I + G_II)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MixedModeCriterion {
    /// `G_c = G_Ic + (G_IIc - G_Ic) B^eta` (Benzeggagh and Kenane 1996).
    #[default]
    BenzeggaghKenane,
    /// `((1 - B)/G_Ic)^eta + (B/G_IIc)^eta = G_c^-eta`.
    Power,
}

const fn table(eta: &'static str) -> [Parameter; 6] {
    [
        Parameter { name: "K", unit: "MPa/mm", meaning: "stiffness before the peak, both modes" },
        Parameter { name: "T_n0", unit: "MPa", meaning: "largest traction in pure opening" },
        Parameter { name: "T_t0", unit: "MPa", meaning: "largest traction in pure sliding" },
        Parameter { name: "G_Ic", unit: "N/mm", meaning: "work of separation in pure opening" },
        Parameter { name: "G_IIc", unit: "N/mm", meaning: "work of separation in pure sliding" },
        Parameter { name: "eta", unit: "1", meaning: eta },
    ]
}

static BENZEGGAGH_KENANE_TABLE: [Parameter; 6] = table("exponent of the Benzeggagh-Kenane criterion");
static POWER_TABLE: [Parameter; 6] = table("exponent of the power criterion");

impl MixedModeCriterion {
    /// The parameters of the law with this criterion.
    pub fn parameters(self) -> &'static [Parameter] {
        match self {
            Self::BenzeggaghKenane => &BENZEGGAGH_KENANE_TABLE,
            Self::Power => &POWER_TABLE,
        }
    }
}

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

/// Jump and parameters.
type Number = Dual<8>;

impl Bilinear {
    /// Name of the law with the criterion of Benzeggagh and Kenane.
    pub const BENZEGGAGH_KENANE: &'static str = "bilinear-benzeggagh-kenane";
    /// Name of the law with the power criterion.
    pub const POWER: &'static str = "bilinear-power";
    /// Half width of the rounding at the onset, as a share of the onset.
    pub const ROUNDING: f64 = 0.1;

    /// The law with `K` (MPa/mm), `T_n0`, `T_t0` (MPa), `G_Ic`, `G_IIc` (N/mm), all positive, and `eta`, 1 or more.
    ///
    /// # Errors
    /// [`LawError::Parameter`] for the first that is not allowed; a toughness so small that nothing is left of
    /// the falling branch (`lambda_f` below 1.5 `lambda_0`) is not.
    pub fn new(criterion: MixedModeCriterion, values: [f64; 6]) -> Result<Self, LawError> {
        let parameters = criterion.parameters();
        all_positive(parameters, &values)?;
        let [stiffness, t_n0, t_t0, g_ic, g_iic, eta] = values;
        let wrong = |k: usize, needed| LawError::Parameter { key: parameters[k].key(), value: values[k], needed };
        if eta < 1.0 {
            return Err(wrong(5, "it must be 1 or more, for the tangent to be bounded"));
        }
        for (k, peak, toughness) in [(3, t_n0, g_ic), (4, t_t0, g_iic)] {
            if 2.0 * toughness * stiffness < 1.5 * peak * peak {
                return Err(wrong(k, "2 G_c K must be at least 1.5 times the largest traction squared; raise K"));
            }
        }
        // Between the pure modes onset and toughness may fall differently: look along the mixes.
        let law = Self { criterion, values };
        for step in 0..=64 {
            let angle = f64::from(step) / 64.0 * std::f64::consts::FRAC_PI_2;
            let (onset, end) = law.onset_and_end(angle.cos(), angle.sin());
            if end.is_nan() || end <= 1.5 * onset {
                return Err(wrong(0, "at some mix of the modes the falling branch vanishes; raise K"));
            }
        }
        Ok(law)
    }

    fn onset_and_end(&self, c_n: f64, c_t: f64) -> (f64, f64) {
        let numbers = self.values.map(Number::constant);
        let shares = [c_n, c_t].map(|c| Number::constant(c * c));
        let (onset, end) = onset_and_end(self.criterion, &numbers, shares);
        (onset.value, end.value)
    }

    /// The stiffness `tau(lambda)/lambda` of the effective traction, with all derivatives.
    fn stiffness(&self, jump: Jump) -> Number {
        let numbers: [Number; 6] = std::array::from_fn(|k| Number::variable(self.values[k], 2 + k));
        let tangential = Number::variable(jump.tangential, 1);
        let normal = if jump.normal > 0.0 { Number::variable(jump.normal, 0) } else { Number::constant(0.0) };
        let (normal2, tangential2) = (normal.squared(), tangential.squared());
        let length2 = normal2 + tangential2;
        let stiffness = numbers[0];
        if length2.value < f64::MIN_POSITIVE {
            return stiffness;
        }
        let length = length2.sqrt();
        let (onset, end) = onset_and_end(self.criterion, &numbers, [normal2 / length2, tangential2 / length2]);
        // Slope of the falling branch, and the two corners rounded such that the area stays.
        let falling = stiffness * onset / (end - onset);
        let width = Self::ROUNDING * onset;
        let width_end = width * (end / onset).sqrt();
        let cut = (stiffness + falling) * rounded_ramp(length - onset, width);
        let tail = falling * rounded_ramp(length - end, width_end);
        if cut.value == 0.0 {
            return stiffness;
        }
        if length.value >= end.value + width_end.value {
            return Number::constant(0.0);
        }
        stiffness - (cut - tail) / length
    }
}

/// Onset and end of the softening for the squared shares `c_n^2`, `c_t^2` of the modes, mm.
fn onset_and_end(criterion: MixedModeCriterion, values: &[Number; 6], [c_n2, c_t2]: [Number; 2]) -> (Number, Number) {
    let [stiffness, t_n0, t_t0, g_ic, g_iic, eta] = *values;
    let one = Number::constant(1.0);
    let onset = one / (stiffness * (c_n2 / t_n0.squared() + c_t2 / t_t0.squared()).sqrt());
    let toughness = match criterion {
        MixedModeCriterion::BenzeggaghKenane => g_ic + (g_iic - g_ic) * c_t2.pow(eta),
        MixedModeCriterion::Power => {
            let sum = (c_n2 / g_ic).pow(eta) + (c_t2 / g_iic).pow(eta);
            one / sum.pow(one / eta)
        }
    };
    (onset, 2.0 * toughness / (stiffness * onset))
}

/// `max(x, 0)`, rounded by a parabola over `-width..width`.
fn rounded_ramp(x: Number, width: Number) -> Number {
    if x.value <= -width.value {
        Number::constant(0.0)
    } else if x.value >= width.value {
        x
    } else {
        (x + width).squared() / (4.0 * width)
    }
}

impl CohesiveLaw for Bilinear {
    fn name(&self) -> &'static str {
        match self.criterion {
            MixedModeCriterion::BenzeggaghKenane => Self::BENZEGGAGH_KENANE,
            MixedModeCriterion::Power => Self::POWER,
        }
    }

    fn parameters(&self) -> &'static [Parameter] {
        self.criterion.parameters()
    }

    fn values(&self) -> Vec<f64> {
        self.values.to_vec()
    }

    fn with_values(&self, values: &[f64]) -> Result<Box<dyn CohesiveLaw>, LawError> {
        Ok(Box::new(Self::new(self.criterion, super::exactly(self.name(), values)?)?))
    }

    fn response(&self, jump: Jump) -> CohesiveResponse {
        let secant = self.stiffness(jump);
        let mut traction = Traction { normal: secant.value * jump.normal, tangential: secant.value * jump.tangential };
        let by_jump = RowVector2::new(secant.by[0], secant.by[1]);
        let mut tangent = Matrix2::from_diagonal_element(secant.value) + jump.vector() * by_jump;
        if jump.normal <= 0.0 {
            traction.normal = self.values[0] * jump.normal;
            tangent.set_row(0, &RowVector2::new(self.values[0], 0.0));
        }
        CohesiveResponse { traction, tangent }
    }

    fn by_parameters(&self, jump: Jump, derivatives: &mut [Traction]) {
        let secant = self.stiffness(jump);
        assert_eq!(derivatives.len(), self.values.len(), "one derivative per parameter");
        for (k, derivative) in derivatives.iter_mut().enumerate() {
            let by = secant.by[2 + k];
            let normal = match jump.normal > 0.0 {
                true => by * jump.normal,
                false if k == 0 => jump.normal,
                false => 0.0,
            };
            *derivative = Traction { normal, tangential: by * jump.tangential };
        }
    }

    fn secant(&self, jump: Jump) -> CohesiveStiffness {
        let secant = self.stiffness(jump).value;
        Matrix2::new(if jump.normal > 0.0 { secant } else { self.values[0] }, 0.0, 0.0, secant)
    }

    fn peak(&self) -> Traction {
        Traction { normal: self.values[1], tangential: self.values[2] }
    }

    fn front_opening(&self) -> f64 {
        self.onset_and_end(1.0, 0.0).1
    }
}
