//! The case file of `quadrille run`: from images to the law of an adhesive, in one file.
//!
//! It holds the sections of a correlation ([`CaseFile`]), and those of a joint (as in
//! [`super::joint::JointCase`]) with [`CaseInterface`] in place of mesh and border, which come from the images.

use super::case::{
    CaseDocument, CaseError, CaseFile, CaseForce, CaseJointMesh, CaseLoad, CaseText, Reader, read_document,
};
use super::joint::{LAW, read_curves};
use facing::{Faces, face_each_other};
use std::path::{Path, PathBuf};
use thiserror::Error;

mod facing;

pub use super::case::CaseInterface;

/// Share by which a given thickness may differ from the gap of the zones.
const SAME_THICKNESS: f64 = 0.02;

/// Everything between images and parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct RunCase {
    /// Images, correlation and zones. The facing edges of the two zones of the interface have their guard.
    pub correlation: CaseFile,
    /// The section `[interface]`.
    pub interface: CaseInterface,
    /// The other sections of the joint, as they stand in the file.
    pub joint: CaseFile,
    /// The text of the file.
    pub text: CaseText,
    /// Thickness of the adhesive: the gap between the facing edges of the zones, mm.
    pub thickness_mm: f64,
    /// Unit normal of the joint, from the first zone of the interface to the second; x to the right, y up.
    pub normal: [f64; 2],
    /// What was changed or may not be meant.
    pub notes: Vec<String>,
}

/// Why a case cannot be run.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunCaseError {
    /// The file, or its sections for the correlation.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// Something about a section of the joint.
    #[error("{}: {}", .0.display(), .1)]
    Wrong(PathBuf, String),
}

/// Reads the case file `path`.
///
/// # Errors
/// A file that cannot be read or is no TOML, a key that there is not, zones that do not face each other, no pixel size.
pub fn read_run_case(path: &Path) -> Result<RunCase, RunCaseError> {
    read_document(path)?.run()
}

/// The case with the content `text`; `path` gives its folder and stands in messages.
///
/// # Errors
/// As [`read_run_case`], but only mesh files of zones are read.
pub fn parse_run_case(text: &str, path: &Path) -> Result<RunCase, RunCaseError> {
    CaseDocument::parse(text, path)?.run()
}

impl CaseDocument {
    /// What a run from the images to the parameters takes of it.
    ///
    /// # Errors
    /// Zones that do not face each other, no pixel size, a section that is missing, a key for what is measured here.
    pub fn run(self) -> Result<RunCase, RunCaseError> {
        self.taken_by(Reader::Run)?;
        let text = &self.text.clone();
        let mut correlation = self.part(Reader::Correlation)?;
        let mut joint = self.part(Reader::Joint)?;
        let wrong = |what: String| RunCaseError::Wrong(text.path().to_owned(), what);
        let refused = |section, key, what: String| text.refuse(section, Some(key), format!("[{section}] {what}"));
        let missing = |section, hint| CaseError::Missing(text.path().to_owned(), section, hint);
        let names = "give zones = [\"lower\", \"upper\"], the names of two [[zone]]";
        let interface = self.case.interface.ok_or_else(|| missing("interface", names))?;
        // The case of the joint is written into another folder: it holds the curves themselves.
        let base = correlation.base.clone();
        let substrate = joint.substrate.as_mut().ok_or_else(|| missing("substrate", LAW))?;
        read_curves(substrate, &base).map_err(|error| wrong(error.to_string()))?;
        joint.cohesive.as_ref().ok_or_else(|| missing("cohesive", LAW))?;
        let boundary = joint.boundary.as_ref().map(|section| ("boundary", &section.file, &section.store));
        let measurement = joint.measurement.as_ref().map(|section| ("measurement", &section.file, &section.store));
        for (section, file, store) in boundary.into_iter().chain(measurement) {
            if let Some((key, _)) = [("file", file), ("store", store)].into_iter().find(|(_, given)| given.is_some()) {
                let what = format!(
                    "{key}: quadrille run measures it on the images; remove the key, or use quadrille identify"
                );
                return Err(refused(section, key, what).into());
            }
        }
        let CaseJointMesh { file, store, zones, element_size_mm, columns, rows, gap_mm, crack, refine: _ } =
            joint.mesh.clone().unwrap_or_default();
        let of_other_meshes = [
            ("file", file.is_some()),
            ("store", store.is_some()),
            ("zones", zones.is_some()),
            ("element_size_mm", element_size_mm.is_some()),
            ("columns", columns.is_some()),
            ("crack", crack.is_some()),
            ("rows", rows.is_some()),
            ("gap_mm", gap_mm.is_some()),
        ];
        if let Some((key, _)) = of_other_meshes.into_iter().find(|(_, given)| *given) {
            let what = format!("{key}: the mesh is that of the correlation; of this section only refine can be given");
            return Err(refused("mesh", key, what).into());
        }
        let of_camera = || correlation.camera.as_ref()?.resolved(&correlation.base).ok()?.pixel_size_mm;
        let Some(pixel_size) = correlation.images.pixel_size_mm.or_else(of_camera) else {
            let what = "pixel_size_mm is missing; mm per pixel turn what is measured into what the joint feels";
            return Err(refused("images", "pixel_size_mm", what.into()).into());
        };
        let guard = interface.guard_px.unwrap_or(3.0);
        if !(guard.is_finite() && (0.0..=1000.0).contains(&guard)) {
            let what = format!("guard_px = {guard}; give a number of pixels from 0 on (3 is usual)");
            return Err(refused("interface", "guard_px", what).into());
        }
        let element = f64::from(correlation.correlation.element_size_px.unwrap_or(16));
        let mut notes = Vec::new();
        let Faces { gap_px, normal } =
            face_each_other(&mut correlation, &interface.zones, guard, element, &mut notes).map_err(wrong)?;
        let thickness_mm = gap_px * pixel_size;
        if let Some(given) = interface.thickness_mm
            && (given.is_nan() || (given - thickness_mm).abs() > SAME_THICKNESS * thickness_mm)
        {
            let what = format!(
                "thickness_mm = {given}, but the facing edges of the zones are {gap_px} px = {thickness_mm:.5} mm apart; \
                 draw the edges where the faces of the adhesive are, or leave thickness_mm out"
            );
            return Err(refused("interface", "thickness_mm", what).into());
        }
        Ok(RunCase { correlation, interface, joint, text: text.clone(), thickness_mm, normal, notes })
    }
}

impl RunCase {
    /// The case of the joint for `quadrille identify` (or, without `[measurement]` and `[fit]`, `quadrille simulate`)
    /// when the correlation's store is at `store`, relative to the folder of that case.
    pub fn joint_case(&self, store: &str, with_fit: bool) -> String {
        let mut case = self.joint.clone();
        case.force = case.force.map(|force| self.force_from_anywhere(force));
        let mesh = case.mesh.get_or_insert_default();
        mesh.store = Some(store.to_owned());
        // Upwards is what a joint takes by itself, and all zones.
        let more = self.correlation.zones.len() > 2;
        mesh.zones = (more || self.normal != [0.0, 1.0]).then(|| self.interface.zones.clone());
        case.boundary.get_or_insert_default().store = Some(store.to_owned());
        case.measurement.get_or_insert_default().store = Some(store.to_owned());
        if !with_fit {
            case.measurement = None;
            case.fit = None;
        }
        let body = case.to_toml();
        format!("# Made by quadrille run. File names are relative to the folder of this file.\n{body}")
    }

    /// `[force]` with files that are found from any folder; without a file it is that of `[load]`.
    fn force_from_anywhere(&self, mut force: CaseForce) -> CaseForce {
        if let (None, Some(CaseLoad { file, time, frame_interval_s, frame_times, start_s, decimal, area_mm2: _ })) =
            (&force.file, self.correlation.load.clone())
        {
            let file = Some(file).filter(|file| !file.is_empty());
            force = CaseForce { file, time, frame_interval_s, frame_times, start_s, decimal, ..force };
        }
        let found = |file: String| {
            let path = self.correlation.base.join(&file);
            std::path::absolute(&path).unwrap_or(path).to_string_lossy().into_owned()
        };
        force.file = force.file.map(found);
        force.frame_times = force.frame_times.map(found);
        force
    }

    /// Whether parameters are to be found.
    pub fn has_fit(&self) -> bool {
        self.joint.fit.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::super::case::CaseGuard;
    use super::*;
    use toml::Table;

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
