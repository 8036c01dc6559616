//! Laws whose traction points along the jump and whose onset and toughness follow the mix of the modes (Camanho and
//! Davila 2002).

use super::dual::Dual;
use super::secants::{Secants, opening_and_sliding};
use super::{Jump, LawError, LawLimit, Parameter, all_positive};

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
    /// What its exponent is.
    const fn exponent(self) -> &'static str {
        match self {
            Self::BenzeggaghKenane => "exponent of the Benzeggagh-Kenane criterion",
            Self::Power => "exponent of the power criterion",
        }
    }
}

/// Half width of the rounding of a corner, as a share of the onset.
const ROUNDING: f64 = 0.1;

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
/// nothing is left in a pure mode or, as `ends` tells (onset, end of the plateau, end, for the shares of the modes), in
/// between.
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

/// Where the falling branch of such a law vanishes, as [`check`] has it: in the pure modes and at the mix that is
/// nearest to it. `plateau` is its share where the law has one. With `q = 2 G_c/(K lambda_0^2)` that is where `q = 1 +
/// (1 + s)/(1 - s)/2`.
pub fn limits<const N: usize>(
    criterion: MixedModeCriterion,
    values: [Dual<N>; 6],
    plateau: Option<Dual<N>>,
) -> Vec<LawLimit> {
    let one = Dual::constant(1.0);
    let least = match plateau {
        None => Dual::constant(1.5),
        Some(s) => one + 0.5 * ((one + s) / (one - s)),
    };
    let distance = |step: u32| {
        let angle = f64::from(step) / 64.0 * std::f64::consts::FRAC_PI_2;
        let shares = [angle.cos(), angle.sin()].map(|c| Dual::constant(c * c));
        let [onset, toughness] = onset_and_toughness(criterion, values, shares);
        (2.0 * toughness / (values[0] * onset.squared()) / least).ln()
    };
    let mixed = (1..64).map(distance).min_by(|a, b| a.value.total_cmp(&b.value));
    let what = [
        "in opening nothing is left of the falling branch",
        "in sliding nothing is left of the falling branch",
        "at some mix of the modes nothing is left of the falling branch",
    ];
    let limit = |(distance, what): (Dual<N>, &'static str)| LawLimit {
        distance: distance.value,
        by: distance.by[2..].to_vec(),
        what,
    };
    [distance(0), distance(64)].into_iter().chain(mixed).zip(what).map(limit).collect()
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

/// Where the straight pieces of the traction meet, mm.
pub struct Corners<const N: usize> {
    /// End of the rise.
    pub onset: Dual<N>,
    /// End of the plateau; `None` for a law that has none.
    pub plateau: Option<Dual<N>>,
    /// Where nothing is left.
    pub end: Dual<N>,
}

/// A traction along the jump that rises with `stiffness`, stays up to the end of the plateau and falls linearly to
/// zero, with corners rounded such that the work stays; `corners` gives them for the squared shares `c_n^2`, `c_t^2` of
/// the modes. In compression the stiffness is that of the rise.
pub fn rise_and_fall<const N: usize>(
    jump: Jump,
    stiffness: Dual<N>,
    corners: impl FnOnce([Dual<N>; 2]) -> Corners<N>,
) -> Secants<N> {
    let along = |stiffness_here| Secants { normal: stiffness_here, tangential: stiffness_here, compression: stiffness };
    let [normal2, tangential2] = opening_and_sliding(jump).map(Dual::squared);
    let length2 = normal2 + tangential2;
    if length2.value < f64::MIN_POSITIVE {
        return along(stiffness);
    }
    let length = length2.sqrt();
    let Corners { onset, plateau, end } = corners([normal2 / length2, tangential2 / length2]);
    let falling = stiffness * onset / (end - plateau.unwrap_or(onset));
    let width = ROUNDING * onset;
    // What the roundings of a corner add to the work grows with its change of slope and its width squared.
    let (cut, width_end) = match plateau {
        None => ((stiffness + falling) * rounded_ramp(length - onset, width), width * (end / onset).sqrt()),
        Some(plateau) => (
            stiffness * rounded_ramp(length - onset, width) + falling * rounded_ramp(length - plateau, width),
            width * (stiffness / falling + Dual::constant(1.0)).sqrt(),
        ),
    };
    let tail = falling * rounded_ramp(length - end, width_end);
    if cut.value == 0.0 {
        return along(stiffness);
    }
    if length.value >= end.value + width_end.value {
        return along(Dual::constant(0.0));
    }
    along(stiffness - (cut - tail) / length)
}

/// `max(x, 0)`, rounded by a parabola over `-width..width`.
fn rounded_ramp<const N: usize>(x: Dual<N>, width: Dual<N>) -> Dual<N> {
    if x.value <= -width.value {
        Dual::constant(0.0)
    } else if x.value >= width.value {
        x
    } else {
        (x + width).squared() / (4.0 * width)
    }
}
