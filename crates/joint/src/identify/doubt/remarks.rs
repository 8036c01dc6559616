//! What there is to say of the case of a fit; of values that hardly anything has see
//! [`crate::identify::doubt::plausibility`].

use crate::io::joint::JointRun;
use crate::remark::{About, Code, Remark};
use std::path::Path;

fn unused(key: &str, text: impl Into<String>) -> Remark {
    Remark::new(Code::KeyUnused, About::Key(key.to_owned()), text)
}

pub(crate) fn shared_unused() -> Remark {
    unused("[fit] shared", "[fit] shared is not used: it is for several tests ([[test]])")
}

pub(crate) fn uncertainty_unused(section: &str, key: &str, parameter: &str) -> Remark {
    let key = format!("[{section}] {key}");
    unused(&key, format!("{key} is not used: {parameter} is fitted")).with("parameter", parameter)
}

pub(crate) fn law_unused(note: &str) -> Remark {
    unused("[cohesive]", note)
}

/// Fits of laws that have [minima of their own](crate::mechanics::cohesive::CohesiveLaw::has_own_minima).
pub(crate) fn own_minima(law: &str) -> Remark {
    let text = format!(
        "fits of {law} end in one of several minima that are nearly as good (corners of the law, parameters that \
         stand for each other): standard uncertainties, intervals and bands belong to the one found and hold the \
         truth less often than they say; fit from other values before they are believed (docs/identification.md, \
         \"Law against law\")"
    );
    Remark::new(Code::LawOwnMinima, About::Law, text).with("law", law)
}

/// The instants `missing` are not in the table of measured displacements; `None` where all are.
pub(crate) fn instants_not_compared(missing: Vec<usize>, path: &Path) -> Option<Remark> {
    let numbers: Vec<String> = missing.iter().map(usize::to_string).collect();
    let text =
        format!("instants {} are not in {}: they are computed and not compared", numbers.join(", "), path.display());
    (!missing.is_empty()).then(|| Remark::new(Code::InstantsNotCompared, About::Instants(missing), text))
}

pub(crate) fn nodes_prescribed(n: usize) -> Remark {
    let text = format!("{n} of the nodes are prescribed and not compared");
    Remark::new(Code::NodesNotCompared, About::Joint, text).with("nodes", n)
}

pub(crate) fn nodes_lost(n: usize) -> Remark {
    let text = format!("{n} nodes were not measured in every frame and are not compared");
    Remark::new(Code::NodesNotCompared, About::Joint, text).with("nodes", n)
}

/// What smoothing leaves of the border is no noise; `kept`: it is smooth all the same.
pub(crate) fn border_not_smooth([along, across]: [usize; 2], ratio: f64, kept: bool) -> Remark {
    let so = match kept {
        true => "it is smoothed as [measurement] border = \"smooth\" says, and the parameters may be biased",
        false => "it is prescribed as measured, and its noise may bias the parameters through plasticity",
    };
    let text = format!(
        "the border is not smooth: fields of degrees {along} along the joint and {across} across leave {ratio:.2} times the noise; {so}"
    );
    Remark::new(Code::BorderNotSmooth, About::Joint, text).with("ratio", ratio)
}

pub(crate) fn weights_shifted(left_out: &[usize]) -> Remark {
    let n = left_out.len();
    let text = format!(
        "instant_weights counts the frames that converged: {n} did not, and the weights behind them are those of \
         earlier entries"
    );
    Remark::new(Code::WeightsShifted, About::Frames(left_out.to_vec()), text).with("frames", n)
}

pub(crate) fn nodes_unmeasured(n: usize) -> Remark {
    let text =
        format!("{n} nodes are not measured: the paper's weights are made from the largest displacement of the others");
    Remark::new(Code::NodesUnmeasured, About::Joint, text).with("nodes", n)
}

/// The instants `without` have no force; `None` where all have one.
pub(crate) fn force_unknown(without: Vec<usize>) -> Option<Remark> {
    let numbers: Vec<String> = without.iter().map(usize::to_string).collect();
    let text = format!("no force is known at instants {}", numbers.join(", "));
    (!without.is_empty()).then(|| Remark::new(Code::ForceUnknown, About::Instants(without), text))
}

pub(crate) fn normal_matrix_missing() -> Remark {
    let text = "the store holds no normal matrix for the fit (of an earlier version, with brightness for each element, or \
                regularised with a renewed reference): the covariance is that of an even texture";
    Remark::new(Code::NormalMatrixMissing, About::Run, text)
}

pub(crate) fn noise_contradicted(ratio: f64) -> Remark {
    let text = format!(
        "the noise stated for the correlation is contradicted by its residuals, which say {ratio:.2} times as much: \
         the standard uncertainties of the displacements, and all intervals with them, are wrong by about that factor"
    );
    Remark::new(Code::NoiseContradicted, About::Run, text).with("ratio", ratio)
}

/// The instants `staged` (from 0) of `n` were measured from a later reference; `None` where none was.
pub(crate) fn reference_later(run: &JointRun, staged: &[usize], n: usize) -> Option<Remark> {
    let &first = staged.first()?;
    let (from, reference) = (run.frames[first], run.measured_from[first]);
    let text = format!(
        "{} of {n} instants, from frame {from} on, were measured from a later reference (frame {reference}): their \
         covariance is taken to be that of the first reference, with the mean of the standard uncertainties that the \
         store states; theirs are larger",
        staged.len(),
    );
    let remark = Remark::new(Code::ReferenceLater, About::Instants(staged.iter().map(|k| k + 1).collect()), text);
    Some(
        remark
            .with("instants", staged.len())
            .with("of", n)
            .with("first_frame", from)
            .with("reference_frame", reference),
    )
}

pub(crate) fn force_turned(rotation_rad: f64) -> Remark {
    let text = format!(
        "the rigid motion that is subtracted turns by up to {rotation_rad:.2e} rad, and the force's direction is not \
         turned with it; give remove_rigid_motion = \"none\""
    );
    Remark::new(Code::ForceTurned, About::Load, text).with("rotation_rad", rotation_rad)
}

pub(crate) fn force_opposite(group: &str) -> Remark {
    let text = format!(
        "the measured load of {group} has the opposite sign of the computed one: give [force] direction the other way \
         round, or another group"
    );
    Remark::new(Code::ForceOpposite, About::Load, text).with("group", group)
}

/// `likely`: what would explain it.
pub(crate) fn force_scaled(group: &str, scale: f64, width_mm: f64, likely: &str) -> Remark {
    let text = format!(
        "the measured load of {group} is {scale:.3} times the computed one in the mean; what would bring them \
         together: {likely}; check that, the unit of the load, and whether the model holds all of the joint that bears it"
    );
    let remark = Remark::new(Code::ForceScaled, About::Load, text).with("group", group);
    remark.with("scale", scale).with("width_mm", width_mm)
}

pub(crate) fn scales_differ(test: &str, of_mesh: f64, of_table: f64) -> Remark {
    let text = format!(
        "its mesh was made with {of_mesh} mm per pixel, its [measurement] says {of_table}; one of them is wrong, and \
         all lengths with it"
    );
    let remark = Remark::new(Code::ScalesDiffer, About::Key("pixel_size_mm".to_owned()), text);
    remark.with("mesh_mm_per_px", of_mesh).with("measurement_mm_per_px", of_table).of_test(test)
}

fn of_tests(code: Code, [a, b]: [&str; 2], text: String) -> Remark {
    Remark::new(code, About::Tests(vec![a.to_owned(), b.to_owned()]), text)
}

pub(crate) fn data_twice(tests: [&str; 2]) -> Remark {
    let text = format!(
        "tests \"{}\" and \"{}\" hold the same displacements: one measurement counts twice, and what it tells has an \
         uncertainty that is too small by a factor of up to 1.4; take one away",
        tests[0], tests[1]
    );
    of_tests(Code::DataTwice, tests, text)
}

/// Two thicknesses of the adhesive; `other_unit` where a unit is the likely reason.
pub(crate) fn thickness_differs(tests: [&str; 2], [x, y]: [f64; 2], other_unit: bool) -> Remark {
    let why = match other_unit {
        true => "lengths in another unit?",
        false => "one law is fitted to both, although it may depend on the thickness",
    };
    let text = format!(
        "the adhesive is {x:.4} mm thick in test \"{}\" and {y:.4} mm in test \"{}\": {why}",
        tests[0], tests[1]
    );
    of_tests(Code::ThicknessDiffers, tests, text).with("first_mm", x).with("second_mm", y)
}

pub(crate) fn stiffness_differs(tests: [&str; 2], [x, y]: [f64; 2]) -> Remark {
    let text = format!(
        "the strips have E = {x} MPa in test \"{}\" and {y} MPa in test \"{}\": a modulus in another unit?",
        tests[0], tests[1]
    );
    of_tests(Code::StiffnessDiffers, tests, text).with("first_MPa", x).with("second_MPa", y)
}

pub(crate) fn uncertainties_differ(constant: &str) -> Remark {
    let text = format!("the tests state different uncertainties of {constant}: the larger one is taken for all");
    Remark::new(Code::UncertaintiesDiffer, About::Parameter(constant.to_owned()), text)
}

/// Finite rotations would change parameters, as `change` says: by up to `largest` standard uncertainties.
pub(crate) fn rotations_matter(change: &str, largest: f64, held: bool) -> Remark {
    let head = if held { "rotations are not quite small" } else { "small rotations do not hold" };
    let text =
        format!("{head}: finite ones would change {change}, to first order; take [cohesive] kinematics = \"finite\"");
    Remark::new(Code::RotationsMatter, About::Fit, text).with("largest_std", largest)
}

pub(crate) fn rotations_unknown() -> Remark {
    let text = "what finite rotations would change could not be computed (no solution with kinematics = \"finite\")";
    Remark::new(Code::RotationsMatter, About::Fit, text)
}
