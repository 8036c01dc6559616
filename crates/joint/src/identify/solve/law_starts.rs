//! Where the fit of a law starts that the case does not start: with the strengths and works of separation of one that
//! it does.

use crate::identify::{Asked, FitError, Unknowns, wrong};
use crate::mechanics::cohesive::{
    Bilinear, CohesiveLaw, ExponentialDamage, ExtendedXuNeedleman, Jump, ParkPaulinoRoesler, SmithFerrante,
    Trapezoidal, XuNeedleman, law_by_name, parameters_by_name,
};
use std::f64::consts::E;

/// Points of the quadrature of the works of separation.
const POINTS: u32 = 4000;
/// Parameters that keep the value of their start: exponents and shapes that a test of few mode mixities leaves open.
const KEPT: [&str; 3] = ["eta", "r_star", "beta"];
/// Exponents, where the started law has none of the same meaning: linear, and that of Benzeggagh and Kenane for epoxy.
const ETA_POWER: f64 = 1.0;
const ETA_BENZEGGAGH_KENANE: f64 = 1.5;
/// Share of the plateau, shape and share of the rise that a fit begins with.
const PLATEAU: f64 = 0.25;
const SHAPE: f64 = 3.0;
const RISE: f64 = 0.1;

/// What a law comes to in pure opening and pure sliding.
struct Character {
    /// Work of separation, N/mm.
    works: [f64; 2],
    /// Largest tractions, MPa.
    peaks: [f64; 2],
    /// Stiffness at rest, MPa/mm.
    stiffness: [f64; 2],
}

impl Character {
    fn of(law: &dyn CohesiveLaw) -> Option<Self> {
        let peak = law.peak();
        let tangent = law.response(Jump::default()).tangent;
        let peaks = [peak.normal, peak.tangential];
        let traction = |mode: usize, s: f64| match mode {
            0 => law.response(Jump { normal: s, tangential: 0.0 }).traction.normal,
            _ => law.response(Jump { normal: 0.0, tangential: s }).traction.tangential,
        };
        let work = |mode: usize| {
            let mut end = law.front_opening();
            for _ in 0..60 {
                if traction(mode, end).abs() <= 1e-4 * peaks[mode] {
                    break;
                }
                end *= 1.3;
            }
            let at = |k: u32| traction(mode, end * f64::from(k) / f64::from(POINTS));
            let inner: f64 = (1..POINTS).map(at).sum();
            end / f64::from(POINTS) * (inner + 0.5 * at(POINTS))
        };
        let found = Self { works: [work(0), work(1)], peaks, stiffness: [tangent.m11, tangent.m22] };
        let numbers = [found.works, found.peaks, found.stiffness];
        numbers.as_flattened().iter().all(|v| v.is_finite() && *v > 0.0).then_some(found)
    }
}

/// The value of the parameter `name` of `law`, where it has one.
fn value_of(law: &dyn CohesiveLaw, name: &str) -> Option<f64> {
    law.parameters().iter().zip(law.values()).find(|(p, _)| p.name == name).map(|(_, value)| value)
}

/// The law called `name` with the strengths and works of separation of `like`; `None` where it cannot have them, or
/// there is no such law.
pub fn law_like(name: &str, like: &dyn CohesiveLaw) -> Option<Box<dyn CohesiveLaw>> {
    if name == like.name() {
        return like.with_values(&like.values()).ok();
    }
    let Character { works: [g_n, g_t], peaks: [t_n, t_t], stiffness } = Character::of(like)?;
    let exponent = || {
        let own = if name.ends_with("power") { ETA_POWER } else { ETA_BENZEGGAGH_KENANE };
        let same = like.name().ends_with("power") == name.ends_with("power");
        value_of(like, "eta").filter(|_| same).unwrap_or(own)
    };
    let stiff = |k: f64| {
        let strong = |t: f64, g: f64| 1.5 * t * t / g;
        2.0_f64.powf(k) * (stiffness[0] * stiffness[1]).sqrt().max(strong(t_n, g_n)).max(strong(t_t, g_t))
    };
    // Between the pure modes the falling branch may vanish although it does in neither: a stiffer rise leaves more of
    // it.
    let stiffer =
        |values: &dyn Fn(f64) -> Vec<f64>| (0..8).find_map(|k| law_by_name(name, &values(stiff(f64::from(k)))).ok());
    let delta_t = (2.0 / E).sqrt() * g_t / t_t;
    match name {
        ExtendedXuNeedleman::NAME => law_by_name(name, &[g_n, g_n / (E * t_n), delta_t, g_t / g_n]).ok(),
        XuNeedleman::NAME => {
            let r_star = value_of(like, "r_star").unwrap_or(0.0);
            law_by_name(name, &[g_n, g_n / (E * t_n), delta_t, g_t / g_n, r_star]).ok()
        }
        SmithFerrante::NAME => law_by_name(name, &[g_n, g_n / (E * t_n), t_t / t_n]).ok(),
        ExponentialDamage::NAME => law_by_name(name, &[g_n, g_n / (E * t_n), t_n / t_t]).ok(),
        Bilinear::BENZEGGAGH_KENANE | Bilinear::POWER => stiffer(&|k| vec![k, t_n, t_t, g_n, g_t, exponent()]),
        Trapezoidal::BENZEGGAGH_KENANE | Trapezoidal::POWER => {
            let plateau = value_of(like, "plateau").unwrap_or(PLATEAU);
            stiffer(&|k| vec![k, t_n, t_t, g_n, g_t, exponent(), plateau])
        }
        ParkPaulinoRoesler::NAME => law_by_name(name, &[g_n, g_t, t_n, t_t, SHAPE, SHAPE, RISE, RISE]).ok(),
        _ => None,
    }
}

/// The unknowns of the law called `name`, started with strengths and works of separation of `like`: all of its
/// parameters but exponents and shapes that are known beforehand or not at all. Errors: no such law; one that cannot be
/// started so.
pub(crate) fn start_law(name: &str, like: &dyn CohesiveLaw) -> Result<Unknowns, FitError> {
    parameters_by_name(name)?;
    let law = law_like(name, like).ok_or_else(|| {
        let what = format!(
            "laws: '{name}' has no values in [cohesive], and it cannot be started with the strengths and works of separation of \
             '{}' there; start that nearer to the adhesive, or run '{name}' on its own",
            like.name()
        );
        wrong("fit", "laws", what)
    })?;
    // The weight of the sliding in the exponential laws has the name of a shape elsewhere.
    let kept = |p: &str| KEPT.contains(&p) && ![SmithFerrante::NAME, ExponentialDamage::NAME].contains(&name);
    let values = law.values();
    let list: Vec<Asked> = (law.parameters().iter().enumerate())
        .filter(|(_, p)| !kept(p.name))
        .map(|(index, _)| (index, values[index], None, None))
        .collect();
    Unknowns::new(&*law, &list)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanics::cohesive::LAW_NAMES;

    /// The quadrature ends where a ten-thousandth of the peak is left: 1e-3 of the work of an exponential law.
    #[test]
    fn every_law_starts_with_the_strengths_and_works_of_every_other() {
        let first = law_by_name(ExtendedXuNeedleman::NAME, &[1.0, 0.005, 0.05, 4.0]).unwrap();
        for from in LAW_NAMES {
            let like = law_like(from, &*first).unwrap();
            let wanted = Character::of(&*like).unwrap();
            for to in LAW_NAMES {
                let unknowns = start_law(to, &*like).unwrap();
                let found = Character::of(unknowns.law()).unwrap();
                for mode in 0..2 {
                    // The exponential laws have one parameter for strength and work of sliding; rounding lowers the
                    // peaks of polygons by up to 4 %.
                    let one_work = [SmithFerrante::NAME, ExponentialDamage::NAME].contains(&to) && mode == 1;
                    let work = found.works[mode] / wanted.works[mode] - 1.0;
                    assert!(one_work || work.abs() < 5e-3, "{from} to {to}: work {mode} off by {work}");
                    let peak = found.peaks[mode] / wanted.peaks[mode] - 1.0;
                    assert!(peak.abs() < 1e-9, "{from} to {to}: peak {mode} off by {peak}");
                }
            }
        }
    }
}
