//! Energy release rates over a test by each method.

use super::beams::{self, Moduli, Section};
use super::compliance::{Definition, Line, StraightLine, fit_line};
use super::specimen::{Instant, Layout, Specimen};
use crate::field::Value;
use serde::{Deserialize, Serialize};

/// How an energy release rate is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// J: loads times rotations (Paris and Paris 1988).
    #[serde(rename = "J")]
    Rotation,
    /// Corrected beam theory, ISO 25217.
    #[serde(rename = "CBT")]
    CorrectedBeam,
    /// Experimental compliance (Berry), ISO 25217.
    #[serde(rename = "ECM")]
    ExperimentalCompliance,
    /// Compliance-based beam with an equivalent crack (de Moura et al. 2008, 2009).
    #[serde(rename = "CBBM")]
    EquivalentCrack,
    /// Mixed-mode bending, ASTM D6671.
    #[serde(rename = "D6671")]
    MixedModeBending,
    /// J of the measured field of both arms behind the tip, and of the loads and rotations ahead of it.
    #[serde(rename = "J_field")]
    Field,
}

impl Method {
    /// Those for a layout, the most general first.
    pub(super) fn of(layout: Layout) -> Vec<Self> {
        let more: &[Self] = match layout {
            Layout::Dcb => &[Self::EquivalentCrack, Self::CorrectedBeam, Self::ExperimentalCompliance, Self::Field],
            Layout::Enf => &[Self::EquivalentCrack, Self::Field],
            Layout::Mmb => &[Self::MixedModeBending, Self::Field],
            Layout::Slb => &[Self::Field],
            Layout::Peel | Layout::Lap => &[],
        };
        [Self::Rotation].into_iter().chain(more.iter().copied()).collect()
    }

    /// Its short name, that of the standards where there is one.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rotation => "J",
            Self::CorrectedBeam => "CBT",
            Self::ExperimentalCompliance => "ECM",
            Self::EquivalentCrack => "CBBM",
            Self::MixedModeBending => "D6671",
            Self::Field => "J_field",
        }
    }

    /// What it is.
    pub fn in_words(self) -> &'static str {
        match self {
            Self::Rotation => "loads and rotations",
            Self::CorrectedBeam => "corrected beam theory",
            Self::ExperimentalCompliance => "experimental compliance",
            Self::EquivalentCrack => "beam with an equivalent crack",
            Self::MixedModeBending => "mixed-mode bending",
            Self::Field => "integral of the measured field behind the tip",
        }
    }
}

/// What a method says.
#[derive(Debug, Clone, PartialEq)]
pub struct MethodResult {
    /// Which.
    pub method: Method,
    /// Energy release rate at each instant, N/mm; its standard uncertainty is that of images and load values.
    pub release: Vec<Option<Value>>,
    /// Length of the crack that goes with it, mm: measured, or that of the beam.
    pub crack_mm: Vec<Option<f64>>,
    /// Share of sliding in it, where the method tells.
    pub sliding_share: Vec<Option<f64>>,
    /// Its value where growth begins, by each definition.
    pub at_begin: Vec<(Definition, Value)>,
    /// Mean after growth has begun.
    pub growth: Option<Value>,
    /// Scatter about that mean, N/mm.
    pub scatter: f64,
    /// Young's modulus that the initial compliance asks for with the initial crack, MPa.
    pub young_of_compliance: Option<Value>,
    /// What was fitted for it, in words; empty for nothing.
    pub note: String,
}

/// The number that `of` makes of `inputs`, with what their uncertainties, independent, do to first order.
fn carry<const N: usize>(inputs: [Value; N], of: impl Fn([f64; N]) -> Option<f64>) -> Option<Value> {
    let at = inputs.map(|input| input.value);
    let value = of(at).filter(|value| value.is_finite())?;
    let mut variance = 0.0;
    for (k, input) in inputs.iter().enumerate().filter(|(_, input)| input.sigma > 0.0) {
        let moved = |by: f64| {
            let mut there = at;
            there[k] += by * input.sigma;
            of(there)
        };
        variance += match (moved(0.5), moved(-0.5)) {
            (Some(above), Some(below)) => (above - below).powi(2),
            (Some(one), None) | (None, Some(one)) => (2.0 * (one - value)).powi(2),
            (None, None) => 0.0,
        };
    }
    Some(Value { value, sigma: variance.sqrt() })
}

/// A rotation is seen where it is so many standard uncertainties.
const VISIBLE: f64 = 3.0;
const NO_CRACK: &str =
    "no length of the crack: give crack_opening_mm (the separation where it ends), an opening and crack_mm";
/// What methods look at.
#[derive(Clone, Copy)]
pub(super) struct Test<'a> {
    pub(super) specimen: &'a Specimen,
    pub(super) instants: &'a [Instant],
    pub(super) line: Option<&'a StraightLine>,
    pub(super) begins: &'a [(Definition, f64)],
    /// Whether the joint is opened further at each instant.
    pub(super) grows: &'a [bool],
}

impl Test<'_> {
    /// The section of an arm; the error says that its thickness is missing.
    fn section(&self) -> Result<Section, String> {
        let arm = self.specimen.arm_mm.ok_or("arm_mm is missing")?.value;
        Ok(Section { width: self.specimen.width_mm.value, arm })
    }

    /// The displacement of the load without what it takes before the load rises.
    fn displacement(&self, instant: &Instant) -> Option<Value> {
        let slack = self.line.map_or(0.0, |line| line.slack_mm);
        instant.displacement_mm.map(|u| Value { value: u.value - slack, ..u })
    }

    /// Says that no displacement is known.
    fn needs_displacement(&self) -> Result<(), String> {
        match self.instants.iter().any(|instant| instant.displacement_mm.is_some()) {
            true => Ok(()),
            false => {
                Err("no displacement of the loads: name the sections where they act, or a column displacement".into())
            }
        }
    }
}

/// What `method` says of a test; the error is what it lacks.
pub(super) fn evaluate(method: Method, test: Test<'_>) -> Result<MethodResult, String> {
    let Test { specimen, instants, begins, grows, .. } = test;
    let n = instants.len();
    let mut result = MethodResult {
        method,
        release: vec![None; n],
        crack_mm: instants.iter().map(|instant| Some(instant.crack_mm?.value)).collect(),
        sliding_share: vec![None; n],
        at_begin: Vec::new(),
        growth: None,
        scatter: 0.0,
        young_of_compliance: None,
        note: String::new(),
    };
    let b = specimen.width_mm.value;
    match method {
        Method::Rotation => {
            if instants.iter().all(|instant| instant.rotation.is_none()) {
                return Err("no rotation of the sections where loads act is measured: name them in sections, as regions in view".into());
            }
            let turns = |at: &Instant| at.rotation.is_some_and(|of| of.value.abs() > VISIBLE * of.sigma);
            if !instants.iter().any(turns) {
                return Err("the sections where loads act turn by less than the noise of the images".into());
            }
            for (release, instant) in result.release.iter_mut().zip(instants) {
                *release =
                    instant.rotation.and_then(|rotation| carry([instant.load_n, rotation], |[p, r]| Some(p * r / b)));
            }
        }
        Method::CorrectedBeam | Method::ExperimentalCompliance => {
            if instants.iter().all(|instant| instant.crack_mm.is_none()) {
                return Err(NO_CRACK.into());
            }
            test.needs_displacement()?;
            // While it grows: before, a compliance that changes is none of the crack.
            let seen = begins.iter().find(|(definition, _)| *definition == Definition::Visual);
            let first = seen.map_or(f64::INFINITY, |(_, at)| *at);
            let of = |(k, instant): (usize, &Instant)| {
                let (crack, u) = (instant.crack_mm?.value, test.displacement(instant)?.value);
                let used = grows[k] && k as f64 >= first && crack > 0.0 && u > 0.0 && instant.load_n.value > 0.0;
                used.then(|| (crack, u / instant.load_n.value / beams::stiffened(u, crack, specimen.end_block_mm)))
            };
            let points: Vec<(f64, f64)> = instants.iter().enumerate().filter_map(of).collect();
            let fit = |x: fn(f64) -> f64, y: fn(f64) -> f64| {
                fit_line(&points.iter().map(|(a, c)| (x(*a), y(*c))).collect::<Vec<_>>())
            };
            let few = || format!("{} instants show the crack grow; 3 at least are needed", points.len());
            let is_corrected = method == Method::CorrectedBeam;
            // Of all instants: what the fit is off, the energy release rates are off together.
            let fitted = if is_corrected {
                let Line { slope, offset, zero_std, .. } = fit(|a| a, f64::cbrt).ok_or_else(few)?;
                let correction = Value { value: offset / slope, sigma: zero_std };
                result.note = format!(
                    "Delta = {:.3} \u{b1} {zero_std:.3} mm, from C^(1/3) over a of {} instants",
                    correction.value,
                    points.len()
                );
                correction
            } else {
                let Line { slope, slope_std, .. } = fit(f64::ln, f64::ln).ok_or_else(few)?;
                result.note =
                    format!("n = {slope:.3} \u{b1} {slope_std:.3}, from ln C over ln a of {} instants", points.len());
                Value { value: slope, sigma: slope_std }
            };
            if !(fitted.value.is_finite() && fitted.sigma.is_finite()) || (!is_corrected && fitted.value <= 0.0) {
                return Err("the compliance does not grow with the crack".into());
            }
            let of = if is_corrected { beams::corrected_beam } else { beams::experimental };
            let by = |inputs: [f64; 4]| Some(of(inputs, b, specimen.end_block_mm));
            for (release, instant) in result.release.iter_mut().zip(instants) {
                let inputs =
                    test.displacement(instant).zip(instant.crack_mm).map(|(u, a)| [instant.load_n, u, a, fitted]);
                *release = inputs.and_then(|inputs| carry(inputs, by));
            }
        }
        Method::EquivalentCrack => equivalent_crack(test, &mut result)?,
        Method::MixedModeBending => mixed_mode_bending(test, &mut result)?,
        Method::Field => {
            if instants.iter().all(|instant| instant.section.is_none()) {
                return Err(
                    "no arms behind the tip: arm_mm, E_MPa and G_MPa are needed, and some arms' length of both in view"
                        .into(),
                );
            }
            for (release, instant) in result.release.iter_mut().zip(instants) {
                let inputs = instant.section.zip(instant.rotation_ahead);
                *release = inputs.and_then(|(of_arms, ahead)| {
                    carry([of_arms, instant.load_n, ahead], |[j, p, r]| Some(j + p * r / b))
                });
            }
        }
    }
    if result.release.iter().all(Option::is_none) {
        return Err("it has no value at any instant".into());
    }
    summarise(&mut result, begins, grows);
    Ok(result)
}

/// Values where growth begins, and the mean after it.
fn summarise(result: &mut MethodResult, begins: &[(Definition, f64)], grows: &[bool]) {
    let at = |place: f64| -> Option<Value> {
        let (k, t) = (place as usize, place.fract());
        let here = (*result.release.get(k)?)?;
        let Some(Some(next)) = result.release.get(k + 1).filter(|_| t > 0.0) else { return Some(here) };
        let between = |a: f64, b: f64| a + t * (b - a);
        Some(Value { value: between(here.value, next.value), sigma: between(here.sigma, next.sigma) })
    };
    result.at_begin = begins.iter().filter_map(|&(definition, place)| Some((definition, at(place)?))).collect();
    let first = begins.iter().map(|(_, at)| *at).fold(0.0, f64::max);
    let grown: Vec<Value> = (result.release.iter().enumerate())
        .filter(|(k, _)| !begins.is_empty() && *k as f64 > first && grows[*k])
        .filter_map(|(_, release)| *release)
        .collect();
    if grown.is_empty() {
        return;
    }
    let n = grown.len() as f64;
    let mean = grown.iter().map(|release| release.value).sum::<f64>() / n;
    let square = grown.iter().map(|release| (release.value - mean).powi(2)).sum::<f64>();
    result.scatter = if grown.len() > 1 { (square / (n - 1.0)).sqrt() } else { 0.0 };
    // What images and load values do is partly common: it is not made smaller by their number.
    let sigma = (grown.iter().map(|release| release.sigma.powi(2)).sum::<f64>() / n).sqrt();
    result.growth = Some(Value { value: mean, sigma: sigma.hypot(result.scatter / n.sqrt()) });
}

/// Young's modulus: that of the case, or the one that gives the initial compliance with the initial crack by `of`, which
/// is noted in the result.
fn modulus(test: Test<'_>, result: &mut MethodResult, of: impl Fn(f64, f64) -> f64) -> Result<Value, String> {
    if let (Some(crack), Some(line)) = (test.specimen.crack_mm, test.line) {
        // Stiffer arms, less compliance.
        let (mut low, mut high) = (1e-9, 1e15);
        for _ in 0..200 {
            let middle = f64::sqrt(low * high);
            *(if of(middle, crack.value) > line.compliance_mm_per_n { &mut low } else { &mut high }) = middle;
        }
        let sigma = low * line.compliance_std / line.compliance_mm_per_n;
        result.young_of_compliance = Some(Value { value: low, sigma });
    }
    // What is stated is a line of the budget.
    if let Some(young) = test.specimen.young_mpa {
        return Ok(Value { value: young.value, sigma: 0.0 });
    }
    let young = result.young_of_compliance;
    let young = young.ok_or("give E_MPa, or crack_mm and a straight begin of the curve, of which it follows")?;
    let compliance = test.line.map_or(0.0, |line| line.compliance_mm_per_n);
    result.note = format!("E_f = {:.0} MPa, of the initial compliance {compliance:.4e} mm/N", young.value);
    Ok(young)
}

fn equivalent_crack(test: Test<'_>, result: &mut MethodResult) -> Result<(), String> {
    let (specimen, section) = (test.specimen, test.section()?);
    let shear = specimen.shear_mpa;
    let half = match (specimen.layout, specimen.half_span_mm) {
        (Layout::Enf, None) => return Err("half_span_mm is missing".into()),
        (_, half) => half.unwrap_or(0.0),
    };
    test.needs_displacement()?;
    let enf = specimen.layout == Layout::Enf;
    let compliance = move |crack: f64, moduli: Moduli| match enf {
        true => beams::enf_compliance(crack, half, section, moduli),
        // Within a block an arm does not bend.
        false => {
            beams::dcb_compliance(crack, section, moduli)
                - beams::dcb_compliance(specimen.end_block_mm[1], section, moduli)
        }
    };
    // A beam whose arms turn at the tip is longer than the crack.
    let young = modulus(test, result, |young, crack| {
        let moduli = Moduli { young, shear };
        let longer = beams::root_correction(section.arm, moduli) * if enf { 0.42 } else { 1.0 };
        compliance(crack + longer, moduli)
    })?;
    if shear.is_none() {
        let more = "shear of the arms is left out (no G_MPa)";
        result.note = if result.note.is_empty() { more.into() } else { format!("{}; {more}", result.note) };
    }
    for (k, instant) in test.instants.iter().enumerate() {
        result.crack_mm[k] = None;
        let Some(u) = test.displacement(instant).filter(|_| instant.load_n.value > 0.0) else { continue };
        let crack = |[load, u, young]: [f64; 3]| {
            let moduli = Moduli { young, shear };
            beams::equivalent_crack(u / load, 1e5, |crack| compliance(crack, moduli))
        };
        let release = |inputs: [f64; 3]| {
            let (crack, [load, _, young]) = (crack(inputs)?, inputs);
            Some(match enf {
                true => beams::enf_release(load, crack, section, young),
                false => beams::dcb_release(load, crack, section, Moduli { young, shear }),
            })
        };
        result.crack_mm[k] = crack([instant.load_n.value, u.value, young.value]);
        result.release[k] = carry([instant.load_n, u, young], release);
        result.sliding_share[k] = result.release[k].map(|_| if enf { 1.0 } else { 0.0 });
    }
    Ok(())
}

fn mixed_mode_bending(test: Test<'_>, result: &mut MethodResult) -> Result<(), String> {
    let (specimen, section) = (test.specimen, test.section()?);
    let (Some(half), Some(lever)) = (specimen.half_span_mm, specimen.lever_mm) else {
        return Err("half_span_mm and lever_mm are needed".into());
    };
    let chi = |young: f64| beams::root_correction(section.arm, Moduli { young, shear: specimen.shear_mpa });
    let young =
        modulus(test, result, |young, crack| beams::mmb_compliance(crack, [half, lever], section, young, chi(young)))?;
    let (young, chi_h) = (young.value, chi(young.value));
    for (k, instant) in test.instants.iter().enumerate() {
        // Measured, or that of the beam's compliance.
        let of_beam = |[load, u]: [f64; 2]| {
            beams::equivalent_crack(u / load, 1e5, |crack| {
                beams::mmb_compliance(crack, [half, lever], section, young, chi_h)
            })
        };
        let parts = |load: f64, crack: f64| beams::mmb_release(load, crack, [half, lever], section, young, chi_h);
        if instant.load_n.value <= 0.0 {
            continue;
        }
        let (release, crack) = match (instant.crack_mm, test.displacement(instant)) {
            (Some(crack), _) => {
                (carry([instant.load_n, crack], |[p, a]| Some(parts(p, a).iter().sum())), Some(crack.value))
            }
            (None, Some(u)) => {
                let release =
                    carry([instant.load_n, u], |inputs| Some(parts(inputs[0], of_beam(inputs)?).iter().sum()));
                (release, of_beam([instant.load_n.value, u.value]))
            }
            (None, None) => (None, None),
        };
        result.sliding_share[k] = crack.map(|crack| {
            let [opening, sliding] = parts(instant.load_n.value, crack);
            sliding / (opening + sliding)
        });
        (result.release[k], result.crack_mm[k]) = (release, crack);
    }
    Ok(())
}
