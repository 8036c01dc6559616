//! Values that no metal, polymer or wood has, and tests that hardly load the adhesive: warned of by name.
//!
//! Thresholds are wide: what they catch is a wrong unit, a wrong row of a table, a wrong scale. docs/identification.md
//! lists them.

use crate::identify::{FitError, Problem, WORK_REACHED, share_beyond, work_along, wrong};
use crate::mechanics::Joint;
use crate::mechanics::cohesive::{CohesiveLaw, Jump, Traction};
use crate::mechanics::substrate::SubstrateLaw;
use crate::remark::{About, Code, Remark};

/// Young's moduli of solids, MPa: soft polymers to diamond.
const YOUNG: [f64; 2] = [10.0, 1.2e6];
/// Young's moduli of metals, MPa: lead to tungsten.
const YOUNG_OF_METALS: [f64; 2] = [10e3, 420e3];
/// Yield stress over Young's modulus: soft annealed metals to polymers.
const YIELD_STRAIN: [f64; 2] = [1e-4, 0.05];
/// Yield stress, MPa.
const YIELD: [f64; 2] = [1.0, 5e3];
/// `alpha` of Ramberg and Osgood.
const ALPHA: [f64; 2] = [1e-4, 10.0];
/// Largest hardening exponent.
const LARGEST_EXPONENT: f64 = 50.0;
/// Largest traction over Young's modulus of the strips.
const LARGEST_TRACTION: f64 = 0.05;
/// Largest traction over the yield stress of the strips: they would flow instead.
const LARGEST_OVER_YIELD: f64 = 5.0;
/// Least of the largest tractions of a law, MPa: a thousandth of a pascal, far below the weight of the strips.
const LEAST_TRACTION: f64 = 1e-9;
/// Works of separation, N/mm: below the first breaks like nothing that is glued, above the second like no adhesive.
const WORK: [f64; 2] = [1e-3, 100.0];
/// Scale of images, mm per pixel.
const PIXEL: [f64; 2] = [1e-6, 1.0];
/// Largest thickness of an adhesive, mm.
const THICKEST: f64 = 20.0;
/// Share of the jump at the largest traction that the joint must have reached: below it only the first slope of the law
/// is loaded.
const LOADED: f64 = 0.1;
/// The same for values that a fit starts from.
const LOADED_AT_START: f64 = 0.01;
/// Share of the work of a law beyond the furthest jump that is worth a word.
const BEYOND: f64 = 0.1;

/// The value in a remark with which a thousandth or a thousand times of the given one is meant.
pub(crate) const MEANT: &str = "meant";

/// The value of `name`, which hardly anything has.
fn implausible(code: Code, name: impl Into<String>, value: f64, unit: &str, text: impl Into<String>) -> Remark {
    let with_unit = if unit == "1" { "value".to_owned() } else { format!("value_{}", unit.replace('/', "_per_")) };
    Remark::new(code, About::Parameter(name.into()), text).with(with_unit, value)
}

/// What is implausible of a case: materials, thickness and scale (`mm_per_px`, where it is known) of its joint, and the
/// law that its fit starts from beside the measured jumps.
pub fn implausible_joint(problem: &Problem<'_>, mm_per_px: Option<f64>) -> Vec<Remark> {
    let law = problem.unknowns.law();
    let mut found = Vec::new();
    of_joint(problem.joint, law, mm_per_px, &mut found);
    if let Some(measured) = largest_jumps(problem) {
        let peak = at_peak(law);
        if measured.normal < LOADED_AT_START * peak.normal && measured.tangential < LOADED_AT_START * peak.tangential {
            let what = format!(
                "the fit starts from a law whose largest tractions are at {:.3e} mm of opening and {:.3e} mm of sliding, but the \
                 joint opens by {:.3e} and slides by {:.3e} mm at most: are all lengths in mm?",
                peak.normal, peak.tangential, measured.normal, measured.tangential
            );
            found.push(implausible(Code::StartImplausible, "start", peak.normal, "mm", what));
        }
        let open = law.front_opening();
        if measured.normal > 1e3 * open {
            let what = format!(
                "the joint opens by {:.3e} mm, the law that the fit starts from counts it as open at {open:.3e} mm: are all \
                 lengths in mm?",
                measured.normal
            );
            found.push(implausible(Code::StartImplausible, "opening", measured.normal, "mm", what));
        }
    }
    found
}

/// What is implausible of a joint that is computed with the law of its case: materials, thickness, law.
///
/// # Errors
/// A law that carries so little that nothing is held: the joint would be looked for for minutes.
pub fn implausible_simulation(joint: &Joint) -> Result<Vec<Remark>, FitError> {
    let peak = joint.law.peak();
    if let Some(least) = [peak.normal, peak.tangential].into_iter().find(|peak| *peak > 0.0 && *peak < LEAST_TRACTION) {
        let what = format!("the largest traction of the law is {least:.3e} MPa, which holds nothing: is it in MPa?");
        return Err(wrong("cohesive", "law", what));
    }
    let mut found = Vec::new();
    of_joint(joint, &*joint.law, None, &mut found);
    of_law(joint, &*joint.law, &mut found);
    Ok(found)
}

/// What is implausible of materials and lengths.
fn of_joint(joint: &Joint, law: &dyn CohesiveLaw, mm_per_px: Option<f64>, found: &mut Vec<Remark>) {
    let (model, groups) = (&joint.model, joint.model.mesh().groups());
    let mut seen: Vec<(&str, Vec<f64>)> = Vec::new();
    for (material, group) in model.materials().iter().zip(groups) {
        let same = (material.name(), material.values());
        if seen.contains(&same) {
            continue;
        }
        let of_group = if seen.is_empty() { String::new() } else { format!(" of {group}") };
        of_material(&**material, &of_group, law, found);
        seen.push(same);
    }
    lengths(joint, mm_per_px, found);
}

/// What is implausible of a case and not named as `meant` by it.
///
/// # Errors
/// What is off by a thousand: a fit to that takes long and means nothing.
pub(crate) fn unless_meant(found: Vec<Remark>, meant: &[String]) -> Result<Vec<Remark>, FitError> {
    const NAMES: [&str; 7] = ["E", "nu", "sigma_0", "alpha", "n", "pixel_size", "thickness"];
    if let Some(name) = meant.iter().find(|name| !NAMES.contains(&name.as_str())) {
        return Err(wrong("fit", "meant", format!("meant: no \"{name}\"; it takes {}", NAMES.join(", "))));
    }
    // "E of upper" is an E.
    let name = |remark: &Remark| match &remark.about {
        About::Parameter(name) => name.split(' ').next().unwrap_or_default().to_owned(),
        _ => String::new(),
    };
    let found: Vec<Remark> = found.into_iter().filter(|remark| !meant.contains(&name(remark))).collect();
    match found.iter().find(|remark| remark.values.contains_key(MEANT)) {
        Some(remark) => {
            let what = format!("{}; correct it, or give meant = [\"{}\"] if it is so", remark.text, name(remark));
            Err(wrong("fit", "meant", what))
        }
        None => Ok(found),
    }
}

/// What is implausible of the law that a fit ended at, beside its strips and the jumps that the joint reached.
pub fn implausible_result(problem: &Problem<'_>, law: &dyn CohesiveLaw) -> Vec<Remark> {
    let mut found = Vec::new();
    of_law(problem.joint, law, &mut found);
    if let Some(measured) = largest_jumps(problem) {
        let peak = at_peak(law);
        let modes = [("opening", measured.normal, peak.normal), ("sliding", measured.tangential, peak.tangential)];
        let weak: Vec<_> = modes.into_iter().filter(|(_, reached, at)| *reached < LOADED * at).collect();
        for (mode, reached, at) in &weak {
            let rest = match weak.len() {
                2 => "only the first slope of the law was loaded, all else of it is extrapolated",
                _ => {
                    "this mode was only loaded in its initial elastic range; its later part is inferred from the other mode"
                }
            };
            let what = format!(
                "the joint's largest {mode} is {reached:.3e} mm, the law's largest traction lies at {at:.3e} mm: {rest}"
            );
            found.push(implausible(Code::LawHardlyLoaded, *mode, *reached, "mm", what));
        }
    }
    found
}

/// A law of which a good part lies beyond the `furthest` jump of the joint.
pub(crate) fn extrapolated(law: &dyn CohesiveLaw, furthest: Option<Jump>) -> Option<Remark> {
    let jump = furthest?;
    let share = share_beyond(law, jump);
    let what = format!(
        "the pair that went furthest opened by {:.4} and slid by {:.4} mm, where the work is {:.4} N/mm ({WORK_REACHED}); {:.0} % of \
         the law's work lies beyond: works of separation are the law's own extrapolation",
        jump.normal,
        jump.tangential.abs(),
        work_along(law, jump),
        100.0 * share
    );
    let remark = || implausible(Code::LawExtrapolated, WORK_REACHED, share, "1", what);
    (share > BEYOND).then(remark)
}

/// Tractions beside what the strips can carry, and works of separation.
fn of_law(joint: &Joint, law: &dyn CohesiveLaw, found: &mut Vec<Remark>) {
    let peak = law.peak();
    for (name, mode, peak) in [("T_n_max", "normal", peak.normal), ("T_t_max", "tangential", peak.tangential)] {
        for material in joint.model.materials() {
            let sigma_0 = value(&**material, "sigma_0");
            let most = sigma_0.map_or(f64::INFINITY, |sigma_0| LARGEST_OVER_YIELD * sigma_0);
            if peak > most.min(LARGEST_TRACTION * material.young()) {
                let yielding = sigma_0.map_or(String::new(), |s| format!(" and sigma_0 = {s} MPa"));
                let what = format!(
                    "{name} = {peak:.4} MPa is a {mode} traction that exceeds what strips with E = {} MPa{yielding} can plausibly carry",
                    material.young()
                );
                found.push(implausible(Code::LawImplausible, name, peak, "MPa", what));
                break;
            }
        }
    }
    for (p, value) in law.parameters().iter().zip(law.values()).filter(|(p, _)| p.unit == "N/mm") {
        let extent = match value {
            value if value < WORK[0] => {
                format!("{value:.3e} N/mm ({:.2} J/m^2) is less than any bond takes", 1e3 * value)
            }
            value if value > WORK[1] => format!("{value:.4} N/mm (kJ/m^2) is more than any adhesive takes"),
            _ => continue,
        };
        let what = format!("{} = {extent}: are E in MPa and lengths in mm?", p.name);
        found.push(implausible(Code::LawImplausible, p.name, value, "N/mm", what));
    }
}

fn value(material: &dyn SubstrateLaw, name: &str) -> Option<f64> {
    material.parameters().iter().position(|p| p.name == name).map(|k| material.values()[k])
}

fn of_material(material: &dyn SubstrateLaw, of: &str, law: &dyn CohesiveLaw, found: &mut Vec<Remark>) {
    let young = material.young();
    let mut add = |name: &str, value: f64, unit, text: String, meant: Option<f64>| {
        let remark = implausible(Code::MaterialImplausible, format!("{name}{of}"), value, unit, text);
        found.push(meant.into_iter().fold(remark, |remark, meant| remark.with(MEANT, meant)));
    };
    let sigma_0 = value(material, "sigma_0");
    let peak = law.peak().normal.max(law.peak().tangential);
    let in_metals = |young: f64| (YOUNG_OF_METALS[0]..=YOUNG_OF_METALS[1]).contains(&young);
    let too_soft = young < YOUNG[0]
        || sigma_0.is_some_and(|sigma_0| sigma_0 > YIELD_STRAIN[1] * young)
        // The law is the start of a fit: it accuses a modulus that is one of metals in GPa, no other.
        || (in_metals(1e3 * young) && peak > LARGEST_TRACTION * young);
    let beside = match sigma_0 {
        Some(sigma_0) if sigma_0 > YIELD_STRAIN[1] * young => format!(" beside sigma_0 = {sigma_0} MPa"),
        _ if young >= YOUNG[0] => format!(" beside tractions of {peak:.3} MPa"),
        _ => String::new(),
    };
    if too_soft {
        let meant = Some(1e3 * young).filter(|gpa| in_metals(*gpa));
        let what = match meant {
            Some(gpa) => format!("GPa meant? ({gpa} MPa)"),
            None => "no metal, polymer or wood is so soft".to_owned(),
        };
        add("E", young, "MPa", format!("E{of} = {young} MPa{beside}: {what}"), meant);
    } else if young > YOUNG[1] {
        // Of 1000 times as much, too, no solid is meant.
        let pa = 1e-6 * young;
        let what = if in_metals(pa) { format!(": Pa meant? ({pa} MPa)") } else { String::new() };
        add("E", young, "MPa", format!("E{of} = {young} MPa is stiffer than diamond{what}"), Some(pa));
    }
    if let Some(nu) = value(material, "nu").filter(|nu| !(0.0..0.5).contains(nu)) {
        add("nu", nu, "1", format!("nu{of} = {nu}: Poisson's ratio of a solid lies between 0 and 0.5"), None);
    }
    if let Some(sigma_0) = sigma_0 {
        if !(YIELD[0]..=YIELD[1]).contains(&sigma_0) {
            let (unit, meant) = if sigma_0 < YIELD[0] { ("GPa", 1e3 * sigma_0) } else { ("Pa", 1e-6 * sigma_0) };
            let text = format!("sigma_0{of} = {sigma_0} MPa: nothing yields there; {unit} meant?");
            add("sigma_0", sigma_0, "MPa", text, Some(meant));
        } else if sigma_0 < YIELD_STRAIN[0] * young {
            let what = format!(
                "sigma_0{of} = {sigma_0} MPa is {:.1e} of E = {young} MPa: no metal is so soft",
                sigma_0 / young
            );
            add("sigma_0", sigma_0, "MPa", what, None);
        }
    }
    if let Some(alpha) = value(material, "alpha").filter(|alpha| !(ALPHA[0]..=ALPHA[1]).contains(alpha)) {
        let what = format!("alpha{of} = {alpha}: the plastic strain at sigma_0 is usually 0.01 to 1 of sigma_0/E");
        add("alpha", alpha, "1", what, None);
    }
    if let Some(n) = value(material, "n").filter(|n| *n > LARGEST_EXPONENT) {
        let what = format!("n{of} = {n}: hardening exponents of metals lie between 2 and {LARGEST_EXPONENT}");
        add("n", n, "1", what, None);
    }
}

fn lengths(joint: &Joint, mm_per_px: Option<f64>, found: &mut Vec<Remark>) {
    let mesh = joint.model.mesh();
    let gap = mesh.gap();
    if let Some(mm) = mm_per_px {
        if !(PIXEL[0]..=PIXEL[1]).contains(&mm) {
            let meant =
                if mm > PIXEL[1] { format!("; if micrometres are meant, it is {}", mm * 1e-3) } else { String::new() };
            let what = format!(
                "1 px = {mm} mm makes a joint of {:.4} mm with an adhesive {gap:.4} mm thick: is pixel_size_mm in mm?{meant}",
                mesh.extent()
            );
            found.push(implausible(Code::LengthImplausible, "pixel_size", mm, "mm", what).with(MEANT, mm * 1e-3));
        }
        if gap < mm && !mesh.interfaces().is_empty() {
            let what = format!(
                "the adhesive is {gap:.3e} mm thick, less than a pixel of {mm:.3e} mm: its faces cannot be told apart in the images"
            );
            found.push(implausible(Code::LengthImplausible, "thickness", gap, "mm", what));
        }
    }
    let height = strip_height(joint);
    let what = match gap {
        gap if gap > THICKEST => {
            let what = format!("an adhesive of {gap:.4} mm: are all lengths in mm?");
            found.push(implausible(Code::LengthImplausible, "thickness", gap, "mm", what).with(MEANT, gap * 1e-3));
            return;
        }
        gap if gap > height => {
            format!("the adhesive of {gap:.3e} mm is thicker than a strip of {height:.3e} mm beside it")
        }
        _ => return,
    };
    found.push(implausible(Code::LengthImplausible, "thickness", gap, "mm", what));
}

/// How far the thinnest strip beside the adhesive reaches from its face, mm: along the mean normal.
fn strip_height(joint: &Joint) -> f64 {
    let mesh = joint.model.mesh();
    let mut normal = [0.0; 2];
    for &corners in mesh.interfaces() {
        let t = mesh.twice_along(corners);
        normal = [normal[0] - t[1], normal[1] + t[0]];
    }
    let length = normal[0].hypot(normal[1]);
    if length == 0.0 {
        return f64::INFINITY;
    }
    let height = |side: usize| {
        let face = mesh.pairs()[0][side] as usize;
        let along = |node: usize| (0..2).map(|c| mesh.nodes()[node][c] * normal[c] / length).sum::<f64>();
        let of_strip = (0..mesh.nodes().len()).filter(|&node| mesh.strip()[node] == mesh.strip()[face]);
        of_strip.map(|node| (along(node) - along(face)).abs()).fold(0.0, f64::max)
    };
    height(0).min(height(1))
}

/// Largest measured opening and sliding of the pairs whose two nodes are measured, at the instants compared.
fn largest_jumps(problem: &Problem<'_>) -> Option<Jump> {
    let mesh = problem.joint.model.mesh();
    let observation = &problem.observation;
    let mut place = vec![None; mesh.nodes().len()];
    observation.nodes.iter().enumerate().for_each(|(k, &node)| place[node as usize] = Some(k));
    let mut most: Option<Jump> = None;
    for &[l1, l2, u1, u2] in mesh.interfaces() {
        let t = mesh.twice_along([l1, l2, u1, u2]);
        let length = t[0].hypot(t[1]);
        for [lower, upper] in [[l1, u1], [l2, u2]] {
            let (Some(lower), Some(upper)) = (place[lower as usize], place[upper as usize]) else { continue };
            for instant in &observation.instants {
                let d = [0, 1].map(|c| instant.displacement[2 * upper + c] - instant.displacement[2 * lower + c]);
                let normal = (d[1] * t[0] - d[0] * t[1]) / length;
                let tangential = ((d[0] * t[0] + d[1] * t[1]) / length).abs();
                let before = most.unwrap_or_default();
                most = Some(Jump { normal: before.normal.max(normal), tangential: before.tangential.max(tangential) });
            }
        }
    }
    most
}

/// The opening and the sliding at which the law has its largest tractions, each without the other.
fn at_peak(law: &dyn CohesiveLaw) -> Jump {
    let peak = law.peak();
    let search = |jump: fn(f64) -> Jump, pick: fn(Traction) -> f64, most: f64| {
        // The first of a geometric row of jumps at which nearly all of the largest traction is there.
        let mut s = 1e-6 * law.front_opening();
        while s < 1e6 * law.front_opening() && pick(law.response(jump(s)).traction) < 0.95 * most {
            s *= 1.05;
        }
        s
    };
    Jump {
        normal: search(|s| Jump { normal: s, tangential: 0.0 }, |t| t.normal, peak.normal),
        tangential: search(|s| Jump { normal: 0.0, tangential: s }, |t| t.tangential, peak.tangential),
    }
}
