//! The law of the adhesive directly from loads and fields, without a model (THEORY 23): J, energy release rates by the
//! methods of the standards, and the traction as the derivative of J.

mod beams;
mod compliance;
mod direct;
mod lap;
mod methods;
mod remarks;
mod section;
mod specimen;
mod traction;
mod validity;

pub use compliance::{Definition, StraightLine};
pub use lap::{Adherend, LapCurve, shear_along};
pub use methods::{Method, MethodResult};
pub use section::{ArmPart, ArmSection};
pub use specimen::{Instant, Layout, LoadedSection, Mode, Specimen, sections};
pub use traction::TractionCurve;
pub use validity::Check;

use crate::field::Value;
use crate::remark::Remark;
use compliance::{begins, largest_load, straight_line};
use methods::{Test, evaluate};
use serde::{Deserialize, Serialize};
use thiserror::Error;
use traction::{COMMON, Sample, Smoothness, traction};

/// Why a test cannot be reduced.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReductionError {
    /// Fewer instants with a load than anything can be made of.
    #[error("{n} instants have a load; at least 4 are needed")]
    Few {
        /// How many.
        n: usize,
    },
    /// Loads that do not rise.
    #[error("the largest load is {load_n} N; a load above zero is needed")]
    NoLoad {
        /// The largest.
        load_n: f64,
    },
    /// J is negative while the joint opens.
    #[error(
        "J by loads and rotations is negative ({release:.4} N/mm at instant {instant}): name the sections in the order of the layout"
    )]
    Reversed {
        /// The smallest.
        release: f64,
        /// Where.
        instant: usize,
    },
    /// The tip closes while loads pull it open.
    #[error(
        "the tip closes by {closing_mm:.4} mm at instant {instant} while loads pull the arms apart: the sections and the zones of the \
         opening name the arms in different orders"
    )]
    Closes {
        /// By how much.
        closing_mm: f64,
        /// Where.
        instant: usize,
    },
    /// No method has what it needs.
    #[error("no method has what it needs: {0}")]
    Nothing(String),
}

/// What a test says of the adhesive.
#[derive(Debug, Clone, PartialEq)]
pub struct Reduction {
    /// The instants, as they were used.
    pub instants: Vec<Instant>,
    /// The straight begin.
    pub line: Option<StraightLine>,
    /// Each definition of the begin of growth and its instant, with its fraction, from 0.
    pub begins: Vec<(Definition, f64)>,
    /// Energy release rates by each method that has what it needs.
    pub methods: Vec<MethodResult>,
    /// The other methods, and what they lack.
    pub missing: Vec<(Method, String)>,
    /// The traction; of a mixed test that along both jumps, and behind it those of opening and sliding alone where a
    /// method tells their shares of J.
    pub tractions: Vec<Traction>,
    /// Why there is none.
    pub no_traction: Option<&'static str>,
    /// What the standards ask of a test.
    pub checks: Vec<Check>,
    /// What each uncertain constant does to the results.
    pub budget: Vec<BudgetLine>,
    /// What is to be looked at.
    pub remarks: Vec<Remark>,
}

/// A traction: the slope of an energy release rate over a jump at the tip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Traction {
    /// The method whose energy release rate it is the slope of.
    #[serde(rename = "of")]
    pub method: Method,
    /// The jump that it is drawn over.
    #[serde(rename = "over")]
    pub mode: Mode,
    /// Opening and sliding at the separations of the curve, mm.
    pub jumps_mm: Vec<[f64; 2]>,
    /// The curve.
    #[serde(flatten)]
    pub curve: TractionCurve,
}

/// What a constant does to the results when it is off by its standard uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct BudgetLine {
    /// The constant.
    pub name: &'static str,
    /// Each result and its change, in its unit.
    pub changes: Vec<(String, f64)>,
}

impl Reduction {
    /// The results as numbers, each with its name.
    pub fn numbers(&self) -> Vec<(String, Value)> {
        let largest = largest_load(&self.instants);
        let of_method = |result: &MethodResult| {
            let name = |what: &str| format!("{} {what} (N/mm)", result.method.name());
            let begins: Vec<(String, Value)> =
                result.at_begin.iter().map(|(definition, value)| (name(definition.name()), *value)).collect();
            let at_largest = largest.and_then(|k| result.release[k]).map(|value| (name("at the largest load"), value));
            begins.into_iter().chain(at_largest).chain(result.growth.map(|value| (name("growth"), value)))
        };
        let of_curve = |(k, Traction { mode, curve, .. }): (usize, &Traction)| {
            // The first needs no name: it is that of the test.
            let of = if k == 0 { String::new() } else { format!(" of {}", mode.names()[1]) };
            let [peak, at] = curve.peak.map_or([None; 2], |peak| peak.map(Some));
            let all = [
                ("peak traction", "MPa", peak),
                ("separation at the peak", "mm", at),
                ("initial stiffness", "MPa/mm", curve.stiffness_mpa_per_mm),
                ("work", "N/mm", Some(curve.work())),
            ];
            all.into_iter().filter_map(move |(name, unit, value)| Some((format!("{name}{of} ({unit})"), value?)))
        };
        let of_curves = self.tractions.iter().enumerate().flat_map(of_curve);
        self.methods.iter().flat_map(of_method).chain(of_curves).collect()
    }
}

/// Reduces a test; `by_camera` are its instants with the camera off by each of its uncertainties, by name.
///
/// # Errors
/// See [`ReductionError`].
pub fn reduce(
    specimen: &Specimen,
    instants: &[Instant],
    by_camera: &[(&'static str, Vec<Instant>)],
) -> Result<Reduction, ReductionError> {
    let mut found = reduce_once(specimen, instants, &[])?;
    let before = found.numbers();
    // What a constant does is no matter of how smooth the curve is.
    let smoothness: Vec<(Mode, Smoothness)> =
        found.tractions.iter().map(|traction| (traction.mode, traction.curve.smoothness)).collect();
    let mut line = |name: &'static str, relative_std: f64, moved: &Specimen, instants: &[Instant]| {
        if relative_std.is_nan() || relative_std <= 0.0 {
            return;
        }
        let Ok(moved) = reduce_once(moved, instants, &smoothness) else { return };
        let after = moved.numbers();
        let change = |(name, value): &(String, Value)| {
            let there = after.iter().find(|(other, _)| other == name)?;
            Some((name.clone(), there.1.value - value.value))
        };
        found.budget.push(BudgetLine { name, changes: before.iter().filter_map(change).collect() });
    };
    let up = |value: Value| Value { value: value.value + value.sigma, ..value };
    let relative = |value: Option<Value>| value.map_or(0.0, |value| (value.sigma / value.value).abs());
    let Specimen {
        width_mm, arm_mm, crack_mm, crack_front_std_mm, young_mpa, load_scale_std, length_scale_std, ..
    } = *specimen;
    line("width", relative(Some(width_mm)), &Specimen { width_mm: up(width_mm), ..*specimen }, instants);
    line("thickness of an arm", relative(arm_mm), &Specimen { arm_mm: arm_mm.map(up), ..*specimen }, instants);
    // Stresses of the measured field are as large as the modulus.
    let stiffer = |instant: &Instant| {
        let times = |of: Value| Value { value: of.value * (1.0 + relative(young_mpa)), ..of };
        Instant { section: instant.section.map(times), ..*instant }
    };
    let of_young = Specimen { young_mpa: young_mpa.map(up), ..*specimen };
    line("Young's modulus", relative(young_mpa), &of_young, &instants.iter().map(stiffer).collect::<Vec<_>>());
    // What is measured of the crack begins at the initial tip.
    let longer = |by: f64, least: f64| -> Vec<Instant> {
        let of = |crack: Value| Value { value: crack.value + if crack.value >= least { by } else { 0.0 }, ..crack };
        instants.iter().map(|instant| Instant { crack_mm: instant.crack_mm.map(of), ..*instant }).collect()
    };
    let of_crack = Specimen { crack_mm: crack_mm.map(up), ..*specimen };
    line("initial crack", relative(crack_mm), &of_crack, &longer(crack_mm.map_or(0.0, |crack| crack.sigma), 0.0));
    // A crack that has hardly grown has the front that it was made with, and does not count as grown by this.
    let grown = crack_mm.map_or(0.0, |crack| crack.value + crack_front_std_mm);
    line("crack front", crack_front_std_mm, specimen, &longer(crack_front_std_mm, grown));
    let initial = crack_mm.map_or(0.0, |crack| crack.value);
    let scaled = |load: f64, lengths: f64| {
        instants.iter().map(|instant| instant.scaled(load, lengths, initial)).collect::<Vec<_>>()
    };
    line("load cell", load_scale_std, specimen, &scaled(1.0 + load_scale_std, 1.0));
    line("pixel size", length_scale_std, specimen, &scaled(1.0, 1.0 + length_scale_std));
    by_camera.iter().for_each(|(name, moved)| line(name, 1.0, specimen, moved));
    Ok(found)
}

fn reduce_once(
    specimen: &Specimen,
    instants: &[Instant],
    smoothness: &[(Mode, Smoothness)],
) -> Result<Reduction, ReductionError> {
    let instants: Vec<Instant> = instants.iter().filter(|instant| instant.load_n.value.is_finite()).copied().collect();
    if instants.len() < 4 {
        return Err(ReductionError::Few { n: instants.len() });
    }
    let largest = largest_load(&instants).map_or(0.0, |k| instants[k].load_n.value);
    if largest <= 0.0 {
        return Err(ReductionError::NoLoad { load_n: largest });
    }
    if Mode::of(specimen.layout) == Mode::Opening
        && let Some(instant) = largest_load(&instants).map(|k| instants[k])
        && let Some(opening) = instant.opening_mm.filter(|opening| opening.value < -5.0 * opening.sigma)
    {
        return Err(ReductionError::Closes { closing_mm: -opening.value, instant: instant.frame });
    }
    let mut remarks = Vec::new();
    let line = straight_line(&instants);
    remarks.extend(remarks::slack(line.as_ref(), &instants));
    let crack = specimen.crack_mm.map(|crack| crack.value);
    let definitions = [Definition::NonLinear, Definition::Visual, Definition::FivePercent];
    let begins: Vec<(Definition, f64)> = (definitions.into_iter())
        .filter_map(|definition| Some((definition, begins(definition, &instants, line.as_ref(), crack)?)))
        .collect();
    let grows = loading(&instants);
    remarks.extend(remarks::unloading(&instants, &grows));
    remarks.extend(remarks::jumps(&instants, &grows));
    let test = Test { specimen, instants: &instants, line: line.as_ref(), begins: &begins, grows: &grows };
    let (mut methods, mut missing) = (Vec::new(), Vec::new());
    for method in Method::of(specimen.layout) {
        match evaluate(method, test) {
            Ok(result) => methods.push(result),
            Err(lacks) => missing.push((method, lacks)),
        }
    }
    if methods.is_empty() {
        let lacks: Vec<String> = missing.iter().map(|(method, lacks)| format!("{}: {lacks}", method.name())).collect();
        return Err(ReductionError::Nothing(lacks.join("; ")));
    }
    if let Some(by_rotation) = methods.iter().find(|result| result.method == Method::Rotation) {
        let known = by_rotation.release.iter().enumerate().filter_map(|(k, release)| Some((k, (*release)?)));
        let least = known.min_by(|a, b| a.1.value.total_cmp(&b.1.value));
        if let Some((k, release)) = least.filter(|(_, release)| release.value < -3.0 * release.sigma) {
            let most = by_rotation.release.iter().flatten().map(|release| release.value).fold(0.0, f64::max);
            if most < release.value.abs() {
                return Err(ReductionError::Reversed { release: release.value, instant: instants[k].frame });
            }
        }
        remarks.extend(remarks::falls(&instants, by_rotation, &grows, Mode::of(specimen.layout)));
    }
    remarks.extend(methods.iter().find_map(|result| remarks::implausible(result, specimen)));
    remarks.extend(remarks::disagree(&methods));
    let tractions = tractions(specimen, &instants, (&methods, &grows), smoothness);
    remarks.extend(tractions.first().and_then(|first| remarks::smeared(&first.curve)));
    let no_traction = tractions
        .is_empty()
        .then_some("six instants at least with J and a separation at the tip that grows beyond its noise are needed");
    let checks = validity::checks(specimen, &instants, &methods);
    Ok(Reduction {
        instants,
        line,
        begins,
        methods,
        missing,
        tractions,
        no_traction,
        checks,
        budget: Vec::new(),
        remarks,
    })
}

/// The tractions that a test tells: over its own jump by the first method that bears it, and of a mixed test the others
/// by the share of each mode in it; as smooth as is `given`.
fn tractions(
    specimen: &Specimen,
    instants: &[Instant],
    (methods, grows): (&[MethodResult], &[bool]),
    given: &[(Mode, Smoothness)],
) -> Vec<Traction> {
    let smoothness = |mode: Mode| given.iter().find(|(of, _)| *of == mode).map(|(_, smoothness)| *smoothness);
    let sharing = methods.iter().find(|result| result.sliding_share.iter().any(Option::is_some));
    let share = |mode: Mode, k: usize| match mode {
        _ if mode == Mode::of(specimen.layout) => Some(1.0),
        Mode::Opening => Some(1.0 - sharing?.sliding_share[k]?),
        _ => sharing?.sliding_share[k],
    };
    let of_mode = |mode: &Mode| {
        methods.iter().find_map(|result| {
            let share = |k: usize| share(*mode, k);
            let curve = curve_of(specimen, instants, (result, grows), (*mode, &share), smoothness(*mode))?;
            let jumps_mm = curve.separation_mm.iter().map(|at| jump_at(instants, *mode, *at)).collect();
            Some(Traction { method: result.method, mode: *mode, jumps_mm, curve })
        })
    };
    let all = Mode::all_of(specimen.layout);
    // Parts without the whole are none.
    let Some(whole) = all.first().and_then(of_mode) else { return Vec::new() };
    std::iter::once(whole).chain(all.iter().skip(1).filter_map(of_mode)).collect()
}

/// Whether the joint is opened further at each instant than at all before: at others it is unloaded. By what is known of
/// most instants: the displacement of the load, which has the least noise, else the jump at the tip.
fn loading(instants: &[Instant]) -> Vec<bool> {
    let picks: [fn(&Instant) -> Option<Value>; 4] =
        [|at| at.displacement_mm, |at| at.jump(Mode::Path), |at| at.opening_mm, |at| at.sliding_mm];
    let known = |of: &fn(&Instant) -> Option<Value>| instants.iter().filter_map(of).count();
    // The first of those that are known alike.
    let Some(of) = picks.into_iter().rev().max_by_key(known) else { return vec![true; instants.len()] };
    let range = instants.iter().filter_map(of).map(|value| value.value.abs()).fold(0.0, f64::max);
    let mut most = f64::NEG_INFINITY;
    let next = |instant: &Instant| {
        let Some(Value { value, sigma }) = of(instant) else { return true };
        let further = value >= most - (6.0 * sigma).max(0.01 * range);
        most = most.max(value);
        further
    };
    instants.iter().map(next).collect()
}

/// Opening and sliding where the tip has come to this separation: both together in the ratio of the nearest instant.
fn jump_at(instants: &[Instant], mode: Mode, separation: f64) -> [f64; 2] {
    let of_instant = |instant: &Instant| {
        let (n, t) = (instant.opening_mm?.value, instant.sliding_mm?.value);
        let both = n.hypot(t);
        (both > 0.0).then(|| ((both - separation).abs(), [n / both, t / both]))
    };
    let nearest = || instants.iter().filter_map(of_instant).min_by(|a, b| a.0.total_cmp(&b.0));
    match mode {
        Mode::Opening => [separation, 0.0],
        Mode::Sliding => [0.0, separation],
        Mode::Path => nearest().map_or([0.0; 2], |(_, along)| along.map(|c| c * separation)),
    }
}

/// The derivative of a share of J by the separation, over the instants at which the joint opens.
fn curve_of(
    specimen: &Specimen,
    instants: &[Instant],
    (result, grows): (&MethodResult, &[bool]),
    (mode, share): (Mode, &dyn Fn(usize) -> Option<f64>),
    smoothness: Option<Smoothness>,
) -> Option<TractionCurve> {
    let sample = |(k, instant): (usize, &Instant)| -> Option<Sample> {
        let jump = instant.jump(mode).filter(|_| grows[k])?;
        let (release, share) = (result.release[k]?, share(k)?);
        let release = Value { value: share * release.value, sigma: share * release.sigma };
        let separation = Value { value: jump.value.max(0.0), ..jump };
        let by_reference = share * instant.load_n.value * instant.rotation_common / specimen.width_mm.value;
        let relative = |value: Value| value.sigma / value.value;
        let mut common = [0.0; COMMON];
        common[0] = if result.method == Method::Rotation { by_reference } else { 0.0 };
        common[1] = release.value * relative(specimen.width_mm);
        common[2] = release.value * specimen.load_scale_std;
        // Of the image of the reference only what is not common scatters.
        let sigma = (release.sigma.powi(2) - common[0].powi(2)).max(0.0).sqrt();
        // Of a part of the modes nobody knows what it is there.
        let other_end = instant.other_end_mm.filter(|_| mode == Mode::of(specimen.layout)).unwrap_or(0.0);
        Some(Sample { separation, release: Value { sigma, ..release }, other_end, common })
    };
    let samples: Vec<Sample> = instants.iter().enumerate().filter_map(sample).collect();
    traction(&samples, smoothness)
}
