//! The case file of `quadrille run`: from images to the law of an adhesive, in one file.
//!
//! It holds the sections of a correlation ([`CaseFile`]), and those of a joint (as in
//! [`super::joint::JointCase`]) with [`CaseInterface`] in place of mesh and border, which come from the images.

use super::case::{CaseError, CaseFile, parse_case};
use facing::{Faces, face_each_other};
use serde::Deserialize;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use thiserror::Error;
use toml::{Table, Value};

mod facing;

/// Sections that belong to the joint.
const OF_JOINT: [&str; 8] = ["interface", "mesh", "boundary", "substrate", "cohesive", "output", "measurement", "fit"];

/// Share by which a given thickness may differ from the gap of the zones.
const SAME_THICKNESS: f64 = 0.02;

/// Everything between images and parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct RunCase {
    /// Images, correlation and zones. The facing edges of the two zones of the interface have their guard.
    pub correlation: CaseFile,
    /// The table `[interface]`.
    pub interface: CaseInterface,
    /// The other tables of the joint, as they stand in the file.
    pub joint: Table,
    /// Thickness of the adhesive: the gap between the facing edges of the zones, mm.
    pub thickness_mm: f64,
    /// Unit normal of the joint, from the first zone of the interface to the second; x to the right, y up.
    pub normal: [f64; 2],
    /// What was changed or may not be meant.
    pub notes: Vec<String>,
}

/// The table `[interface]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseInterface {
    /// Names of the zones beside the adhesive, whose normal points from the first to the second. Of two zones one below the other the
    /// first is the lower one.
    pub zones: [String; 2],
    /// Width along the facing edges whose pixels are left out, px; 3 unless given.
    pub guard_px: Option<f64>,
    /// Thickness of the adhesive, mm; it has to agree with the gap between the zones.
    pub thickness_mm: Option<f64>,
}

/// Why a case cannot be run.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunCaseError {
    /// The file, or its sections for the correlation.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// Something about a section of the joint.
    #[error("{}: {what}", path.display())]
    Wrong {
        /// The case file.
        path: PathBuf,
        /// What is wrong, and what to do.
        what: String,
    },
}

/// Reads the case file `path`.
///
/// # Errors
/// A file that cannot be read or is no TOML, a key that there is not, zones that do not face each other, no pixel size.
pub fn read_run_case(path: &Path) -> Result<RunCase, RunCaseError> {
    let bytes = std::fs::read(path).map_err(|reason| match reason.kind() {
        ErrorKind::NotFound => CaseError::NotFound { path: path.to_owned() },
        _ => CaseError::Io { path: path.to_owned(), reason },
    })?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        CaseError::NotText { path: path.to_owned(), line: 1 + before.iter().filter(|&&b| b == b'\n').count() }
    })?;
    parse_run_case(&text, path)
}

/// The case with the content `text`; `path` gives its folder and stands in messages.
///
/// # Errors
/// As [`read_run_case`], but only mesh files of zones are read.
pub fn parse_run_case(text: &str, path: &Path) -> Result<RunCase, RunCaseError> {
    let wrong = |what: String| RunCaseError::Wrong { path: path.to_owned(), what };
    let [of_correlation, of_joint] = parted(text);
    let mut joint: Table = toml::from_str(&of_joint).map_err(|error| {
        let before = of_joint.get(..error.span().map_or(0, |span| span.start)).unwrap_or("");
        CaseError::Invalid {
            path: path.to_owned(),
            line: 1 + before.matches('\n').count(),
            column: 1 + before.rsplit('\n').next().unwrap_or("").chars().count(),
            key: None,
            message: error.message().replace('\n', "; "),
        }
    })?;
    let mut correlation = parse_case(&of_correlation, path)?;
    let interface = joint.remove("interface").ok_or_else(|| {
        wrong("[interface] is missing; give zones = [\"lower\", \"upper\"], the names of two [[zone]]".into())
    })?;
    let interface: CaseInterface = interface.try_into().map_err(|error: toml::de::Error| {
        wrong(format!("[interface] {}; it takes zones, guard_px and thickness_mm", error.message().replace('\n', "; ")))
    })?;
    for section in ["substrate", "cohesive"] {
        if !joint.contains_key(section) {
            return Err(wrong(format!("[{section}] is missing; see docs/mechanics.md for its keys")));
        }
    }
    for (section, key) in
        [("boundary", "file"), ("boundary", "store"), ("measurement", "file"), ("measurement", "store")]
    {
        if joint.get(section).and_then(|table| table.get(key)).is_some() {
            return Err(wrong(format!(
                "[{section}] {key}: quadrille run measures it on the images; remove the key, or use quadrille identify"
            )));
        }
    }
    let mesh_keys = joint.get("mesh").and_then(Value::as_table).into_iter().flat_map(|table| table.keys());
    if let Some(key) = mesh_keys.into_iter().find(|key| *key != "refine") {
        return Err(wrong(format!(
            "[mesh] {key}: the mesh is that of the correlation; of this section only refine can be given"
        )));
    }
    let Some(pixel_size) = correlation.images.pixel_size_mm else {
        return Err(wrong(
            "[images] pixel_size_mm is missing; mm per pixel turn what is measured into what the joint feels".into(),
        ));
    };
    let guard = interface.guard_px.unwrap_or(3.0);
    if !(guard.is_finite() && (0.0..=1000.0).contains(&guard)) {
        return Err(wrong(format!("[interface] guard_px = {guard}; give a number of pixels from 0 on (3 is usual)")));
    }
    let element = f64::from(correlation.correlation.element_size_px.unwrap_or(16));
    let mut notes = Vec::new();
    let Faces { gap_px, normal } =
        face_each_other(&mut correlation, &interface.zones, guard, element, &mut notes).map_err(wrong)?;
    let thickness_mm = gap_px * pixel_size;
    if let Some(given) = interface.thickness_mm
        && (given.is_nan() || (given - thickness_mm).abs() > SAME_THICKNESS * thickness_mm)
    {
        return Err(wrong(format!(
            "[interface] thickness_mm = {given}, but the facing edges of the zones are {gap_px} px = {thickness_mm:.5} mm apart; \
             draw the edges where the faces of the adhesive are, or leave thickness_mm out"
        )));
    }
    Ok(RunCase { correlation, interface, joint, thickness_mm, normal, notes })
}

/// The lines of the correlation's sections and those of the joint's; the other's are blank, so that lines keep their numbers.
fn parted(text: &str) -> [String; 2] {
    let mut parts = [String::new(), String::new()];
    let mut of_joint = false;
    for line in text.lines() {
        let head = line.trim_start().trim_start_matches('[').trim_start();
        if line.trim_start().starts_with('[') && head.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
            let name = head.split([']', '.', ' ', '\t']).next().unwrap_or("");
            of_joint = OF_JOINT.contains(&name);
        }
        parts[usize::from(of_joint)].push_str(line);
        parts.iter_mut().for_each(|part| part.push('\n'));
    }
    parts
}

impl RunCase {
    /// The case of the joint for `quadrille identify` (or, without `[measurement]` and `[fit]`, `quadrille simulate`) when the
    /// correlation's store is at `store`, relative to the folder of that case.
    pub fn joint_case(&self, store: &str, with_fit: bool) -> String {
        let mut case = self.joint.clone();
        for section in ["mesh", "boundary", "measurement"] {
            let table = case.entry(section).or_insert_with(|| Value::Table(Table::new()));
            if let Value::Table(table) = table {
                table.insert("store".into(), store.into());
                // Upwards is what a joint takes by itself.
                if section == "mesh" && self.normal != [0.0, 1.0] {
                    table.insert("zones".into(), self.interface.zones.to_vec().into());
                }
            }
        }
        if !with_fit {
            case.remove("measurement");
            case.remove("fit");
        }
        // Tables of plain values: they have a form in TOML.
        let body = toml::to_string(&case).unwrap_or_else(|error| unreachable!("a case has a form in TOML: {error}"));
        format!("# Made by quadrille run. File names are relative to the folder of this file.\n{body}")
    }

    /// Whether parameters are to be found.
    pub fn has_fit(&self) -> bool {
        self.joint.contains_key("fit")
    }
}

#[cfg(test)]
mod tests {
    use super::super::case::CaseGuard;
    use super::*;

    const CASE: &str = "[images]\ndeformed = 'a*.png'\npixel_size_mm = 0.002\n[[zone]]\nname = 'lower'\nroi = [10, 90, 90, 140]\n\
                        [[zone]]\nname = 'upper'\nroi = [10, 10, 90, 60]\n[interface]\nzones = ['lower', 'upper']\n\
                        [substrate]\nE_MPa = 1.0\n[cohesive]\nr = 4.0\n[fit]\nparameters = ['phi_n']\n[fit.start]\nphi_n = 1.0\n";

    fn parse(text: &str) -> Result<RunCase, String> {
        parse_run_case(text, Path::new("case.toml")).map_err(|error| error.to_string())
    }

    #[track_caller]
    fn refused(from: &str, to: &str, words: &[&str]) {
        assert!(CASE.contains(from), "{from}");
        let message = parse(&CASE.replace(from, to)).unwrap_err();
        for word in words {
            assert!(message.contains(word), "'{word}' in: {message}");
        }
    }

    #[test]
    fn facing_edges_alone_are_guarded_and_the_upper_mesh_ends_at_its_face() {
        let case = parse(CASE).unwrap();
        let guard = |top, bottom| Some(CaseGuard::Rectangle { left: 0.0, top, right: 0.0, bottom });
        let [lower, upper] = &case.correlation.zones[..] else { panic!() };
        assert_eq!((lower.roi, &lower.guard_px), (Some([10.0, 90.0, 90.0, 140.0]), &guard(3.0, 0.0)));
        // 50 px hold three elements of 16: rows from 60 up to 12.
        assert_eq!((upper.roi, &upper.guard_px), (Some([10.0, 12.0, 90.0, 60.0]), &guard(0.0, 3.0)));
        assert!((case.thickness_mm - 0.06).abs() < 1e-12);
        assert!(case.notes[0].contains("y0 = 12"));
        let own = parse(&CASE.replace("roi = [10, 10, 90, 60]", "roi = [10, 12, 90, 60]\nguard_px = 5")).unwrap();
        assert_eq!(own.correlation.zones[1].guard_px, Some(CaseGuard::All(5.0)));
        assert!(own.notes.is_empty());
    }

    #[test]
    fn the_case_of_the_joint_has_the_store_in_place_of_the_images() {
        let case = parse(CASE).unwrap();
        let joint: Table = toml::from_str(&case.joint_case("correlation/fields.zarr", true)).unwrap();
        for section in ["mesh", "boundary", "measurement"] {
            assert_eq!(joint[section]["store"].as_str(), Some("correlation/fields.zarr"));
        }
        assert_eq!(joint["fit"]["start"]["phi_n"].as_float(), Some(1.0));
        let plain: Table = toml::from_str(&case.joint_case("s", false)).unwrap();
        assert!(!plain.contains_key("fit") && !plain.contains_key("measurement") && plain.contains_key("cohesive"));
    }

    #[test]
    fn what_cannot_be_run_is_said_with_what_to_do() {
        refused("[interface]\nzones = ['lower', 'upper']\n", "", &["[interface] is missing"]);
        refused("name = 'upper'", "name = 'top'", &["\"upper\"", "\"top\"", "add a [[zone]]"]);
        refused("['lower', 'upper']", "['upper', 'lower']", &["does not lie below", "swap"]);
        refused("['lower', 'upper']", "['lower', 'lower']", &["twice"]);
        refused("['lower', 'upper']", "['lower']", &["[interface]"]);
        refused("zones = ['lower', 'upper']", "zones = ['lower', 'upper']\nguard_px = -1", &["guard_px = -1"]);
        refused("zones = ['lower', 'upper']", "zones = ['lower', 'upper']\nthickness_mm = 0.08", &["0.08", "0.06"]);
        refused("roi = [10, 10, 90, 60]", "roi = [10, 10, 90, 95]", &["gap"]);
        refused("roi = [10, 10, 90, 60]", "mask = 'm.png'", &["\"upper\"", "rectangle"]);
        refused("pixel_size_mm = 0.002\n", "", &["pixel_size_mm is missing"]);
        refused("[cohesive]\nr = 4.0\n", "", &["[cohesive] is missing"]);
        refused("[fit]", "[measurement]\nstore = 'x'\n[fit]", &["[measurement] store", "quadrille identify"]);
        refused("[fit]", "[mesh]\ncolumns = 3\n[fit]", &["[mesh] columns", "refine"]);
        refused("deformed = 'a*.png'", "deforme = 'a*.png'", &["line 2", "deforme"]);
        refused("r = 4.0", "r = ", &["line 15"]);
    }
}
