//! What a case states of the uncertainty of its constants, and the defaults for what it does not state.

use crate::identify::doubt::remarks::uncertainty_unused;
use crate::identify::{Constant, ConstantKind, Face, FitError, LoadCell, NOISE_LEVEL, Source, wrong};
use crate::io::case::{CaseCohesive, CaseExact, CaseFit, CaseMaterial, CaseMeasurement, CaseSubstrate, EXACT, STD};
use crate::io::joint::{JointInput, MeasurementInput, MeshInput, RunCamera};
use crate::mechanics::Joint;
use crate::mechanics::cohesive::Parameter;
use crate::remark::Remark;
use std::collections::BTreeMap;

/// Default standard uncertainty of Young's modulus, by its value.
pub const DEFAULT_E: f64 = 0.03;
/// Default standard uncertainty of Poisson's ratio.
pub const DEFAULT_NU: f64 = 0.01;
/// Default standard uncertainty of the angle of an orthotropic material, degrees.
pub const DEFAULT_ANGLE: f64 = 1.0;
/// Default standard uncertainty of `sigma_0`, `n` and the stresses of a curve, by their value.
pub const DEFAULT_YIELD: f64 = 0.05;
/// Default standard uncertainty of `alpha`, by its value.
pub const DEFAULT_ALPHA: f64 = 0.2;
/// Default standard uncertainty of a prescribed parameter of the law, by its value.
pub const DEFAULT_LAW: f64 = 0.25;
/// Default standard uncertainty of the thickness of the adhesive, px.
pub const DEFAULT_THICKNESS_PX: f64 = 1.0;
/// Default standard uncertainty of the position of each face, px.
pub const DEFAULT_FACE_PX: f64 = 0.5;
/// Default standard uncertainty of the pixel size, by its value.
pub const DEFAULT_PIXEL_SIZE: f64 = 0.005;
/// Default standard uncertainty of the noise, by its value.
pub const DEFAULT_NOISE: f64 = 0.1;

/// Default standard uncertainty of the width of the specimen, with that of the load cell's gain, by its value.
pub const DEFAULT_WIDTH: f64 = 0.01;

/// What `[fit] exact` may name.
const OF_FIT: [&str; 7] = ["thickness", "faces", "pixel_size", NOISE_LEVEL, ROTATIONS, WIDTH, CAMERA];
/// Of these the one whose uncertainty the correlation states.
const CAMERA: &str = "camera";
/// Of these that of the specimen across the plane, by which forces are counted.
const WIDTH: &str = "width";
/// Of these the one that is no constant: that rotations are small, as of data that were computed so.
const ROTATIONS: &str = "rotations";

/// Scale of the images behind a case, mm per pixel, where it is known.
pub(crate) fn mm_per_px(input: &JointInput) -> Option<f64> {
    let of_mesh = match &input.mesh {
        MeshInput::File(file) | MeshInput::Run(file) => file.mm_per_px,
        MeshInput::Rectangle { .. } => None,
    };
    let of_run = match &input.measurement {
        Some(MeasurementInput::Run(run)) => run.mesh.mm_per_px,
        _ => None,
    };
    of_run.or(of_mesh).or(input.case.measurement.as_ref().and_then(|table| table.pixel_size_mm))
}

/// Whether each of `known` is named by the key `exact` of a section.
fn exact_of(section: &'static str, given: Option<&CaseExact>, known: &[&str]) -> Result<Vec<bool>, FitError> {
    let names = match given {
        None => return Ok(vec![false; known.len()]),
        Some(CaseExact::All(all)) => return Ok(vec![*all; known.len()]),
        Some(CaseExact::Names(names)) => names,
    };
    let mut exact = vec![false; known.len()];
    for name in names {
        let at = known.iter().position(|known| known == name);
        exact[at.ok_or_else(|| {
            let there = known.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
            let what = format!("{EXACT} names \"{name}\": there is no such constant; there are {there}");
            wrong(section, EXACT, what)
        })?] = true;
    }
    Ok(exact)
}

/// Whether rotations that are taken as small are to be judged: unless the case names them as exact. That all constants
/// are exact is not that rotations are small.
pub(crate) fn judge_rotations(fit: &CaseFit) -> bool {
    !matches!(&fit.exact, Some(CaseExact::Names(names)) if names.iter().any(|name| name == ROTATIONS))
}

/// The standard uncertainty under `key`, above zero.
fn std_of(section: &'static str, given: &BTreeMap<String, f64>, key: &str) -> Result<Option<f64>, FitError> {
    given.get(key).map(|std| positive(section, key, *std)).transpose()
}

fn positive(section: &'static str, key: &str, value: f64) -> Result<f64, FitError> {
    match value.is_finite() && value > 0.0 {
        true => Ok(value),
        false => Err(wrong(
            section,
            key,
            format!("{key} = {value}: it must be a finite number above zero; exact says that there is none"),
        )),
    }
}

/// What holds of a constant: stated, exact, the default, or nothing.
fn choose(
    section: &'static str,
    key: &str,
    stated: Option<f64>,
    exact: bool,
    default: Option<f64>,
) -> Result<(f64, Source), FitError> {
    match (stated, exact, default.filter(|std| std.is_finite() && *std > 0.0)) {
        (Some(_), true, _) => {
            Err(wrong(section, key, format!("{key} is given, and {EXACT} says that there is none; take one away")))
        }
        (Some(std), false, _) => Ok((std, Source::Stated)),
        (None, true, _) => Ok((0.0, Source::Exact)),
        (None, false, Some(std)) => Ok((std, Source::Default)),
        (None, false, None) => Ok((0.0, Source::Unknown)),
    }
}

/// The constants of a case, each with what the case states of it, or the default; what is stated and not used is named
/// in `found`.
pub(crate) fn constants(
    joint: &Joint,
    input: &JointInput,
    fit: &CaseFit,
    measurement: &CaseMeasurement,
    force: Option<&LoadCell>,
    found: &mut Vec<Remark>,
) -> Result<Vec<Constant>, FitError> {
    let mut list = materials(joint, &input.case.substrate, fit, found)?;
    list.extend(law(joint, &input.case.cohesive, fit, found)?);
    list.extend(lengths(joint, mm_per_px(input), fit, measurement)?);
    list.extend(camera(input, fit)?);
    list.extend(force.map(|cell| width(input, fit, cell)).transpose()?);
    Ok(list)
}

fn constant(
    name: impl Into<String>,
    kind: ConstantKind,
    value: Option<f64>,
    unit: &'static str,
    (std, source): (f64, Source),
) -> Constant {
    Constant { name: name.into(), kind, value, unit, std, source }
}

/// Lens, tilt and distance of the run that was measured, in standard uncertainties.
fn camera(input: &JointInput, fit: &CaseFit) -> Result<Vec<Constant>, FitError> {
    let Some(MeasurementInput::Run(run)) = &input.measurement else { return Ok(Vec::new()) };
    let exact = exact_of("fit", fit.exact.as_ref(), &OF_FIT)?[6];
    let line = |(term, of): (usize, &RunCamera)| {
        let std = match (exact, of.is_stated) {
            (true, _) => (0.0, Source::Exact),
            (false, true) => (1.0, Source::Stated),
            (false, false) => (1.0, Source::Default),
        };
        constant(&of.name, ConstantKind::Camera { term }, None, "1", std)
    };
    Ok(run.camera.iter().enumerate().map(line).collect())
}

fn width(input: &JointInput, fit: &CaseFit, cell: &LoadCell) -> Result<Constant, FitError> {
    let (section, key) = ("force", "width_mm_std");
    let exact = exact_of("fit", fit.exact.as_ref(), &OF_FIT)?;
    let stated = input.case.force.as_ref().and_then(|force| force.width_mm_std);
    let stated = stated.map(|std| positive(section, key, std)).transpose()?;
    let (std, source) = choose(section, key, stated, exact[5], Some(DEFAULT_WIDTH * cell.width_mm))?;
    Ok(constant(WIDTH, ConstantKind::Width, Some(cell.width_mm), "mm", (std, source)))
}

fn materials(
    joint: &Joint,
    substrate: &CaseSubstrate,
    fit: &CaseFit,
    found: &mut Vec<Remark>,
) -> Result<Vec<Constant>, FitError> {
    let section = "substrate";
    let (model, groups) = (&joint.model, joint.model.mesh().groups());
    let CaseSubstrate { common, groups: own } = substrate;
    let shared = substrate.without_own(groups);
    if shared.is_empty()
        && let Some(key) = common.values.keys().find(|key| key.ends_with(STD))
    {
        let what =
            format!("{key}: every group of elements has a table of its own; state it in [substrate.{}]", groups[0]);
        return Err(wrong(section, key, what));
    }
    let mut list = Vec::new();
    let mut of_table =
        |given: &CaseMaterial, exact: Option<&CaseExact>, members: Vec<usize>, suffix: &str| -> Result<(), FitError> {
            let Some(&first) = members.first() else { return Ok(()) };
            let material = &model.materials()[first];
            let names: Vec<&str> = material.parameters().iter().map(|p| p.name).collect();
            let exact = exact_of(section, exact, &names)?;
            for (index, (p, value)) in material.parameters().iter().zip(material.values()).enumerate() {
                let key = format!("{}{STD}", p.key());
                let stated = std_of(section, &given.values, &key)?;
                // Only those of [substrate] itself can be fitted.
                if suffix.is_empty() && fit.parameters.iter().any(|name| name == p.name) {
                    found.extend(stated.map(|_| uncertainty_unused(section, &key, p.name)));
                    continue;
                }
                let default = match p.name {
                    "E" | "E_1" | "E_2" | "E_3" | "G_12" => DEFAULT_E * value,
                    "nu" | "nu_12" | "nu_13" | "nu_23" => DEFAULT_NU,
                    "angle" => DEFAULT_ANGLE,
                    "alpha" => DEFAULT_ALPHA * value,
                    _ => DEFAULT_YIELD * value,
                };
                let std = choose(section, &key, stated, exact[index], Some(default))?;
                let kind = ConstantKind::Material { groups: members.clone(), index };
                list.push(constant(format!("{}{suffix}", p.name), kind, Some(value), p.unit, std));
            }
            Ok(())
        };
    of_table(common, common.exact.as_ref(), shared, "")?;
    for (g, name) in groups.iter().enumerate() {
        if let Some(given) = own.get(name) {
            of_table(given, given.exact.as_ref().or(common.exact.as_ref()), vec![g], &format!("_{name}"))?;
        }
    }
    Ok(list)
}

fn law(joint: &Joint, given: &CaseCohesive, fit: &CaseFit, found: &mut Vec<Remark>) -> Result<Vec<Constant>, FitError> {
    let section = "cohesive";
    let parameters: &[Parameter] = joint.law.parameters();
    let names: Vec<&str> = parameters.iter().map(|p| p.name).collect();
    let exact = exact_of(section, given.exact.as_ref(), &names)?;
    let mut list = Vec::new();
    for (index, (p, value)) in parameters.iter().zip(joint.law.values()).enumerate() {
        let key = format!("{}{STD}", p.key());
        let stated = std_of(section, &given.values, &key)?;
        if fit.parameters.iter().any(|name| name == p.name) {
            found.extend(stated.map(|_| uncertainty_unused(section, &key, p.name)));
            continue;
        }
        let default = DEFAULT_LAW * value.abs();
        let std = choose(section, &key, stated, exact[index], Some(default))?;
        list.push(constant(p.name, ConstantKind::Law { index }, Some(value), p.unit, std));
    }
    Ok(list)
}

fn lengths(
    joint: &Joint,
    mm_per_px: Option<f64>,
    fit: &CaseFit,
    measurement: &CaseMeasurement,
) -> Result<Vec<Constant>, FitError> {
    let section = "fit";
    let exact = exact_of(section, fit.exact.as_ref(), &OF_FIT)?;
    let given = |key: &str, std: Option<f64>| std.map(|std| positive(section, key, std)).transpose();
    let in_px = |px: f64| mm_per_px.map(|mm| px * mm);
    let key = "thickness_mm_std";
    let stated = given(key, fit.thickness_mm_std)?;
    let (std, source) = choose(section, key, stated, exact[0], in_px(DEFAULT_THICKNESS_PX))?;
    let gap = Some(joint.model.mesh().gap());
    let mut list = vec![constant("thickness", ConstantKind::Thickness, gap, "mm", (std, source))];
    let px = given("face_position_px_std", fit.face_position_px_std)?;
    let mm = given("face_position_mm_std", fit.face_position_mm_std)?;
    let refused = |what: &str| wrong(section, "face_position_px_std", what);
    let stated = match (px, mm) {
        (Some(_), Some(_)) => {
            return Err(refused("face_position_px_std and face_position_mm_std are both given; take one away"));
        }
        (Some(px), None) => Some(in_px(px).ok_or_else(|| {
            refused("face_position_px_std: the size of a pixel is not known here; give face_position_mm_std")
        })?),
        (None, mm) => mm,
    };
    let faces = choose(section, "face_position_px_std", stated, exact[1], in_px(DEFAULT_FACE_PX))?;
    if joint.model.mesh().interfaces().is_empty() {
        list.clear();
    } else {
        list.push(constant("face_lower", ConstantKind::Face(Face::Lower), None, "mm", faces));
        list.push(constant("face_upper", ConstantKind::Face(Face::Upper), None, "mm", faces));
    }
    let key = "pixel_size_relative_std";
    let default = mm_per_px.map(|_| DEFAULT_PIXEL_SIZE);
    let (std, source) = choose(section, key, given(key, fit.pixel_size_relative_std)?, exact[2], default)?;
    // Without a scale the relative size is meant.
    let (value, unit) = mm_per_px.map_or((1.0, "1"), |mm| (mm, "mm"));
    list.push(constant("pixel_size", ConstantKind::PixelSize, Some(value), unit, (std * value, source)));
    let key = "noise_relative_std";
    let stated = measurement.noise_relative_std.map(|std| positive("measurement", key, std)).transpose()?;
    let noise = choose("measurement", key, stated, exact[3], Some(DEFAULT_NOISE))?;
    list.push(constant(NOISE_LEVEL, ConstantKind::NoiseLevel, None, "1", noise));
    Ok(list)
}
