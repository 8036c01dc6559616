//! Files of a joint: its case file, its mesh, the displacements of its border, the tables of a solution.
//!
//! Lengths in mm, stresses in MPa, x to the right and y **up** (THEORY 1); nodes are counted from 0, instants from 1.
//! [`read_joint`] reads everything that a case names; `mechanics::Joint` makes a model of it.

mod boundary;
mod case;
mod correlated;
mod curve;
mod drives;
mod force;
mod measurement;
mod mesh;
#[cfg(feature = "store")]
mod run;
#[cfg(not(feature = "store"))]
#[path = "no_run.rs"]
mod run;
mod several;
mod table;

pub use super::case::{CaseBoundary, CaseFit, CaseJointMesh, CaseJointOutput, CaseMeasurement, CaseNodes};
pub use boundary::{BoundaryTable, parse_boundary, read_boundary};
pub(crate) use case::LAW;
use case::NO_ADHESIVE;
pub use case::{JointCase, read_joint_case};
pub use correlated::{JointRun, RunCamera, RunMatrix};
pub use curve::read_curves;
pub use drives::{DrivesInput, History};
pub use force::{ForceInput, read_force};
pub use measurement::{MeasurementTable, parse_measurement, read_measurement};
pub use mesh::{JointMeshFile, counter_clockwise, parse_joint_mesh, read_joint_mesh};
pub use run::read_joint_run;
pub use several::{IdentifyInput, TestInput, TestsInput, parse_identify, read_identify};
pub use table::{parse_table, read_table, write_table};

use super::case::{CaseError, CasePlace, CaseText};
use super::load::LoadError;
use super::mesh_file::MeshFileError;
use super::text::read_file;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A case with the content of the files that it names.
#[derive(Debug, Clone, PartialEq)]
pub struct JointInput {
    /// The case file.
    pub case: JointCase,
    /// Where the mesh comes from.
    pub mesh: MeshInput,
    /// Where the displacements of the border come from.
    pub boundary: BoundaryInput,
    /// Supports and loads by component.
    pub drives: DrivesInput,
    /// What was measured, where the case says it.
    pub measurement: Option<MeasurementInput>,
    /// What the load cell recorded, where the case says it.
    pub force: Option<ForceInput>,
}

/// Where the displacements that parameters are fitted to come from.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one of them")]
pub enum MeasurementInput {
    /// A table.
    Table(MeasurementTable),
    /// The correlation run that the mesh is of.
    Run(JointRun),
}

/// Where the mesh of a joint comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum MeshInput {
    /// A mesh file.
    File(JointMeshFile),
    /// The zones of a correlation run.
    Run(JointMeshFile),
    /// Two strips of squares.
    Rectangle {
        /// Side of the elements, mm.
        element_size: f64,
        /// Elements along the joint.
        columns: usize,
        /// Rows of elements in each strip.
        rows: usize,
        /// Distance of the faces, mm.
        gap: f64,
    },
}

/// Where the displacements of the border come from.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one of them")]
pub enum BoundaryInput {
    /// A table.
    Table(BoundaryTable),
    /// The correlation run that the mesh is of.
    Run(JointRun),
    /// Supports and loads alone drive the joint.
    Drives,
}

/// Reads the case file `path` and every file that it names.
pub fn read_joint(path: &Path) -> Result<JointInput, JointFileError> {
    joint_of(read_joint_case(path)?)
}

/// No mesh, or more than one.
const NO_MESH: &str =
    "needs file = \"mesh.json\", or store = \"run/fields.zarr\", or element_size_mm, columns, rows and gap_mm together";
/// A border that is measured on another mesh.
const OTHER_RUN: &str = "store needs the same run as [mesh] store; for another mesh give file = \"displacements.csv\"";

/// The joint of a case: every file that it names is read.
fn joint_of(mut case: JointCase) -> Result<JointInput, JointFileError> {
    read_curves(&mut case.substrate, &case.base)?;
    let case = case;
    let wrong = |error: JointFileError| error.placed_in(&case.text);
    let section = |section, what: &str| Err(wrong(JointFileError::section(section, what)));
    let CaseJointMesh { file, store, element_size_mm, columns, rows, gap_mm, .. } = &case.mesh;
    let boundary = &case.boundary;
    let run = match (store, &boundary.store) {
        (None, None) => None,
        (Some(mesh), border) => {
            let run = read_joint_run(&case.base.join(mesh), case.mesh.zones.as_ref())?;
            if let Some(border) = border
                && run_folder(&case.base.join(border)) != run_folder(&case.base.join(mesh))
            {
                return section("boundary", OTHER_RUN);
            }
            let is_body = case.cohesive.model.as_deref() == Some(NO_ADHESIVE);
            Some(if is_body { run.of_body() } else { run })
        }
        (None, Some(_)) => return section("boundary", OTHER_RUN),
    };
    let sizes = [element_size_mm.is_some(), columns.is_some(), rows.is_some(), gap_mm.is_some()];
    let mut mesh = match (file, &run, element_size_mm, columns, rows, gap_mm) {
        (Some(file), None, ..) if !sizes.contains(&true) => MeshInput::File(read_joint_mesh(&case.base.join(file))?),
        (None, Some(run), ..) if !sizes.contains(&true) => MeshInput::Run(run.mesh.clone()),
        (None, None, &Some(element_size), &Some(columns), &Some(rows), &Some(gap)) => {
            MeshInput::Rectangle { element_size, columns, rows, gap }
        }
        _ => return section("mesh", NO_MESH),
    };
    if let Some(zones) = &case.mesh.zones {
        let (MeshInput::File(file) | MeshInput::Run(file)) = &mut mesh else {
            return Err(JointFileError::section("mesh", NO_MESH));
        };
        let at = |name: &String| {
            let there = file.groups.join(", ");
            let missing = || format!("[mesh] zones names \"{name}\"; the mesh has the groups {there}");
            file.groups.iter().position(|group| group == name).ok_or_else(|| JointFileError::Wrong(missing()))
        };
        let [first, second] = [at(&zones[0])?, at(&zones[1])?];
        if first == second {
            let what = format!("[mesh] zones names \"{}\" twice; name the two groups beside the adhesive", zones[0]);
            return Err(JointFileError::Wrong(what));
        }
        file.lower = Some(first as u32);
    }
    let measurement = match &case.measurement {
        None => None,
        Some(CaseMeasurement { file: Some(file), store: None, pixel_size_mm, .. }) => {
            Some(MeasurementInput::Table(read_measurement(&case.base.join(file), *pixel_size_mm).map_err(wrong)?))
        }
        Some(CaseMeasurement { file: None, store: Some(store), .. }) => match (&run, &case.mesh.store) {
            (Some(run), Some(mesh)) if run_folder(&case.base.join(store)) == run_folder(&case.base.join(mesh)) => {
                Some(MeasurementInput::Run(run.clone()))
            }
            _ => {
                let what = "store needs the same run as [mesh] store; for another mesh give file = \"measured.csv\"";
                return section("measurement", what);
            }
        },
        // A load curve can be fitted alone.
        Some(CaseMeasurement { file: None, store: None, .. }) if case.force.is_some() => None,
        Some(_) => {
            let what = "needs either file = \"measured.csv\" or store = \"run/fields.zarr\"";
            return section("measurement", what);
        }
    };
    let boundary = match (&boundary.file, run) {
        (Some(file), _) if boundary.store.is_none() => BoundaryInput::Table(read_boundary(&case.base.join(file))?),
        (None, Some(run)) if boundary.store.is_some() => BoundaryInput::Run(run),
        (None, _) if boundary.store.is_none() && !case.supports.is_empty() => BoundaryInput::Drives,
        _ => {
            return section("boundary", "needs either file = \"displacements.csv\" or store = \"run/fields.zarr\"");
        }
    };
    let drives = DrivesInput::read(&case.supports, &case.applied_loads, &case.base, &case.text)?;
    let force = read_force(&case, &boundary, &drives).map_err(wrong)?;
    Ok(JointInput { case, mesh, boundary, drives, measurement, force })
}

/// One name for each run, however it is written.
fn run_folder(path: &Path) -> PathBuf {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    if path.ends_with(super::STORE) { path.parent().map_or(path.clone(), Path::to_owned) } else { path }
}

/// Why a file of a joint cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum JointFileError {
    /// A file that cannot be read or does not hold what it should: what is wrong, and what to do.
    #[error("{}: {}", .0.display(), .1)]
    File(PathBuf, String),
    /// A `.msh` or `.vtu` file that cannot be used.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// A row that is none.
    #[error("{}, line {line}: {what}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
    /// Something about a section of the case file, with its place.
    #[error("{0}: {1}")]
    InCase(CasePlace, Box<JointFileError>),
    /// Something about one of several tests: where the tests stand, and its name.
    #[error("{0}: test \"{1}\": {2}")]
    InTest(CasePlace, String, Box<JointFileError>),
    /// A section of the case, by its name, that cannot be followed.
    #[error("[{0}] {1}")]
    Section(&'static str, String),
    /// Another fault of the case.
    #[error("{0}")]
    Wrong(String),
    /// The case file itself.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// The store of a correlation run that cannot be read.
    #[cfg(feature = "store")]
    #[error(transparent)]
    Store(#[from] super::store::StoreError),
    /// A load file that cannot be used.
    #[error("[force] {0}")]
    Force(#[from] LoadError),
}

impl JointFileError {
    fn file(path: &Path, what: impl Into<String>) -> Self {
        Self::File(path.to_owned(), what.into())
    }

    fn section(section: &'static str, what: impl Into<String>) -> Self {
        Self::Section(section, what.into())
    }

    /// With the place of the section of the case that it is about, if it is about one.
    fn placed_in(self, text: &CaseText) -> Self {
        let section = match &self {
            Self::Section(section, _) => section,
            Self::Force(_) => "force",
            _ => return self,
        };
        Self::InCase(text.place(section, None), Box::new(self))
    }
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, JointFileError> {
    let missing = |path| JointFileError::File(path, "there is no such file; check the name and the folder".to_owned());
    read_file(path, missing, |path, reason| JointFileError::File(path, format!("the file cannot be read: {reason}")))
}
