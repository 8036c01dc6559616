//! The law of the adhesive directly from loads and fields, without a model (THEORY 23): J, energy release rates by the
//! methods of the standards, and the traction as the derivative of J.

mod beams;
mod compliance;
mod methods;
mod remarks;
mod specimen;
mod traction;

pub use compliance::{Definition, StraightLine};
pub use methods::{Method, MethodResult};
pub use specimen::{Instant, Layout, LoadedSection, Mode, Specimen, sections};
pub use traction::TractionCurve;

use crate::field::Value;
use crate::remark::Remark;
use compliance::{begins, largest_load, straight_line};
use methods::{Test, evaluate};
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
    /// The traction, and the method whose J it is the derivative of.
    pub traction: Option<(Method, TractionCurve)>,
    /// Why there is none.
    pub no_traction: Option<&'static str>,
    /// What each uncertain constant does to the results.
    pub budget: Vec<BudgetLine>,
    /// What is to be looked at.
    pub remarks: Vec<Remark>,
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
        let curve = self.traction.as_ref().map(|(_, curve)| curve);
        let of_curve = curve.into_iter().flat_map(|curve| {
            [
                ("peak traction (MPa)", curve.peak_mpa),
                ("separation at the peak (mm)", curve.peak_at_mm),
                ("work (N/mm)", curve.work_n_per_mm),
            ]
            .map(|(name, value)| (name.to_owned(), value))
        });
        self.methods.iter().flat_map(of_method).chain(of_curve).collect()
    }
}

/// Reduces a test.
///
/// # Errors
/// See [`ReductionError`].
pub fn reduce(specimen: &Specimen, instants: &[Instant]) -> Result<Reduction, ReductionError> {
    let mut found = reduce_once(specimen, instants, None)?;
    let before = found.numbers();
    // What a constant does is no matter of how smooth the curve is.
    let smoothness = found.traction.as_ref().map(|(_, curve)| curve.smoothness);
    let mut line = |name: &'static str, relative_std: f64, moved: &Specimen, instants: &[Instant]| {
        if relative_std.is_nan() || relative_std <= 0.0 {
            return;
        }
        let Ok(moved) = reduce_once(moved, instants, smoothness) else { return };
        let after = moved.numbers();
        let change = |(name, value): &(String, Value)| {
            let there = after.iter().find(|(other, _)| other == name)?;
            Some((name.clone(), there.1.value - value.value))
        };
        found.budget.push(BudgetLine { name, changes: before.iter().filter_map(change).collect() });
    };
    let up = |value: Value| Value { value: value.value + value.sigma, ..value };
    let relative = |value: Option<Value>| value.map_or(0.0, |value| (value.sigma / value.value).abs());
    let Specimen { width_mm, arm_mm, crack_mm, young_mpa, load_scale_std, length_scale_std, .. } = *specimen;
    line("width", relative(Some(width_mm)), &Specimen { width_mm: up(width_mm), ..*specimen }, instants);
    line("thickness of an arm", relative(arm_mm), &Specimen { arm_mm: arm_mm.map(up), ..*specimen }, instants);
    line("Young's modulus", relative(young_mpa), &Specimen { young_mpa: young_mpa.map(up), ..*specimen }, instants);
    // What is measured of the crack begins at the initial tip.
    let longer = |instant: &Instant| {
        let by = crack_mm.map_or(0.0, |crack| crack.sigma);
        Instant { crack_mm: instant.crack_mm.map(|crack| Value { value: crack.value + by, ..crack }), ..*instant }
    };
    let of_crack = Specimen { crack_mm: crack_mm.map(up), ..*specimen };
    line("initial crack", relative(crack_mm), &of_crack, &instants.iter().map(longer).collect::<Vec<_>>());
    let initial = crack_mm.map_or(0.0, |crack| crack.value);
    let scaled = |load: f64, lengths: f64| {
        instants.iter().map(|instant| instant.scaled(load, lengths, initial)).collect::<Vec<_>>()
    };
    line("load cell", load_scale_std, specimen, &scaled(1.0 + load_scale_std, 1.0));
    line("pixel size", length_scale_std, specimen, &scaled(1.0, 1.0 + length_scale_std));
    Ok(found)
}

fn reduce_once(
    specimen: &Specimen,
    instants: &[Instant],
    smoothness: Option<Smoothness>,
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
    let curve =
        |result: &MethodResult| Some((result.method, curve_of(specimen, &instants, (result, &grows), smoothness)?));
    let traction = methods.iter().find_map(curve);
    let no_traction = traction
        .is_none()
        .then_some("six instants at least with J and a separation at the tip that grows beyond its noise are needed");
    Ok(Reduction { instants, line, begins, methods, missing, traction, no_traction, budget: Vec::new(), remarks })
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

/// The derivative of J by the separation, over the instants at which the joint opens.
fn curve_of(
    specimen: &Specimen,
    instants: &[Instant],
    (result, grows): (&MethodResult, &[bool]),
    smoothness: Option<Smoothness>,
) -> Option<TractionCurve> {
    let mode = Mode::of(specimen.layout);
    let sample = |(k, instant): (usize, &Instant)| -> Option<Sample> {
        let jump = instant.jump(mode).filter(|_| grows[k])?;
        let release = result.release[k]?;
        let separation = Value { value: jump.value.max(0.0), ..jump };
        let by_reference = instant.load_n.value * instant.rotation_common / specimen.width_mm.value;
        let relative = |value: Value| value.sigma / value.value;
        let mut common = [0.0; COMMON];
        common[0] = if result.method == Method::Rotation { by_reference } else { 0.0 };
        common[1] = release.value * relative(specimen.width_mm);
        common[2] = release.value * specimen.load_scale_std;
        // Of the image of the reference only what is not common scatters.
        let sigma = (release.sigma.powi(2) - common[0].powi(2)).max(0.0).sqrt();
        Some(Sample { separation, release: Value { sigma, ..release }, common })
    };
    let samples: Vec<Sample> = instants.iter().enumerate().filter_map(sample).collect();
    traction(&samples, smoothness)
}
