//! Laws whose traction points along the jump and whose onset and toughness follow the mix of the modes (Camanho and Davila 2002).

use super::dual::Dual;
use super::{LawError, Parameter, all_positive};

/// How the toughness depends on the mix of the modes, `B = G_II/(G_I + G_II)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MixedModeCriterion {
    /// `G_c = G_Ic + (G_IIc - G_Ic) B^eta` (Benzeggagh and Kenane 1996).
    #[default]
    BenzeggaghKenane,
    /// `((1 - B)/G_Ic)^eta + (B/G_IIc)^eta = G_c^-eta`.
    Power,
}

impl MixedModeCriterion {
    /// That of a law's name.
    pub(super) fn of_law(name: &str) -> Self {
        if name.ends_with("power") { Self::Power } else { Self::BenzeggaghKenane }
    }

    /// What its exponent is.
    pub(super) const fn exponent(self) -> &'static str {
        match self {
            Self::BenzeggaghKenane => "exponent of the Benzeggagh-Kenane criterion",
            Self::Power => "exponent of the power criterion",
        }
    }
}

/// Half width of the rounding of a corner, as a share of the onset.
pub const ROUNDING: f64 = 0.1;

/// The parameters of such a law: `K, T_n0, T_t0, G_Ic, G_IIc, eta`.
pub const fn table(criterion: MixedModeCriterion) -> [Parameter; 6] {
    [
        Parameter { name: "K", unit: "MPa/mm", meaning: "stiffness before the peak, both modes" },
        Parameter { name: "T_n0", unit: "MPa", meaning: "largest traction in pure opening" },
        Parameter { name: "T_t0", unit: "MPa", meaning: "largest traction in pure sliding" },
        Parameter { name: "G_Ic", unit: "N/mm", meaning: "work of separation in pure opening" },
        Parameter { name: "G_IIc", unit: "N/mm", meaning: "work of separation in pure sliding" },
        Parameter { name: "eta", unit: "1", meaning: criterion.exponent() },
    ]
}

/// Refuses what no such law can have: values that are not positive, an exponent below one, a falling branch of which
/// nothing is left in a pure mode or, as `ends` tells (onset, end of the plateau, end, for the shares of the modes), in between.
pub fn check(parameters: &[Parameter], values: &[f64], ends: impl Fn(f64, f64) -> [f64; 3]) -> Result<(), LawError> {
    all_positive(parameters, values)?;
    let wrong = |k: usize, needed| Err(LawError::Parameter { key: parameters[k].key(), value: values[k], needed });
    if values[5] < 1.0 {
        return wrong(5, "it must be 1 or more, for the tangent to be bounded");
    }
    for (peak, toughness) in [(1, 3), (2, 4)] {
        if 2.0 * values[toughness] * values[0] < 1.5 * values[peak].powi(2) {
            return wrong(toughness, "2 G_c K must be at least 1.5 times the largest traction squared; raise K");
        }
    }
    // Between the pure modes onset and toughness may fall differently: look along the mixes.
    for step in 0..=64 {
        let angle = f64::from(step) / 64.0 * std::f64::consts::FRAC_PI_2;
        let [onset, plateau, end] = ends(angle.cos(), angle.sin());
        if end.is_nan() || end - plateau <= 0.5 * onset {
            return wrong(0, "at some mix of the modes the falling branch vanishes; raise K");
        }
    }
    Ok(())
}

/// Onset of the softening and toughness for the squared shares `c_n^2`, `c_t^2` of the modes, mm and N/mm.
pub fn onset_and_toughness<const N: usize>(
    criterion: MixedModeCriterion,
    values: [Dual<N>; 6],
    [c_n2, c_t2]: [Dual<N>; 2],
) -> [Dual<N>; 2] {
    let [stiffness, t_n0, t_t0, g_ic, g_iic, eta] = values;
    let one = Dual::constant(1.0);
    let onset = one / (stiffness * (c_n2 / t_n0.squared() + c_t2 / t_t0.squared()).sqrt());
    let toughness = match criterion {
        MixedModeCriterion::BenzeggaghKenane => g_ic + (g_iic - g_ic) * c_t2.pow(eta),
        MixedModeCriterion::Power => {
            let sum = (c_n2 / g_ic).pow(eta) + (c_t2 / g_iic).pow(eta);
            one / sum.pow(one / eta)
        }
    };
    [onset, toughness]
}

/// `max(x, 0)`, rounded by a parabola over `-width..width`.
pub fn rounded_ramp<const N: usize>(x: Dual<N>, width: Dual<N>) -> Dual<N> {
    if x.value <= -width.value {
        Dual::constant(0.0)
    } else if x.value >= width.value {
        x
    } else {
        (x + width).squared() / (4.0 * width)
    }
}
