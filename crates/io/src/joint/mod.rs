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
pub use case::{JointCase, read_joint_case};
pub use correlated::{JointRun, RunMatrix};
pub use curve::read_curves;
pub use drives::{DrivesInput, History};
pub use force::{ForceInput, read_force};
pub use measurement::{MeasurementTable, parse_measurement, read_measurement};
pub use mesh::{JointMeshFile, counter_clockwise, parse_joint_mesh, read_joint_mesh};
pub use run::read_joint_run;
pub use several::{IdentifyInput, TestInput, TestsInput, parse_identify, read_identify};
pub use table::{parse_table, read_table, write_table};

use super::case::{CaseError, CasePlace};
use super::load::LoadError;
use super::mesh_file::MeshFileError;
use std::io::{self, ErrorKind};
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
///
/// # Errors
/// See [`JointFileError`].
pub fn read_joint(path: &Path) -> Result<JointInput, JointFileError> {
    joint_of(read_joint_case(path)?)
}

/// The joint of a case: every file that it names is read.
fn joint_of(mut case: JointCase) -> Result<JointInput, JointFileError> {
    let base = case.base.clone();
    read_curves(&mut case.substrate, &base)?;
    let case = case;
    let wrong = |error: JointFileError| match error.section() {
        Some(section) => JointFileError::InCase { place: case.text.place(section, None), error: Box::new(error) },
        None => error,
    };
    let CaseJointMesh { file, store, element_size_mm, columns, rows, gap_mm, .. } = &case.mesh;
    let boundary = &case.boundary;
    let run = match (store, &boundary.store) {
        (None, None) => None,
        (Some(mesh), border) => {
            let run = read_joint_run(&case.base.join(mesh))?;
            if let Some(border) = border
                && run_folder(&case.base.join(border)) != run_folder(&case.base.join(mesh))
            {
                return Err(wrong(JointFileError::OtherRun));
            }
            Some(run)
        }
        (None, Some(_)) => return Err(wrong(JointFileError::OtherRun)),
    };
    let sizes = [element_size_mm.is_some(), columns.is_some(), rows.is_some(), gap_mm.is_some()];
    let mut mesh = match (file, &run, element_size_mm, columns, rows, gap_mm) {
        (Some(file), None, ..) if !sizes.contains(&true) => MeshInput::File(read_joint_mesh(&case.base.join(file))?),
        (None, Some(run), ..) if !sizes.contains(&true) => MeshInput::Run(run.mesh.clone()),
        (None, None, &Some(element_size), &Some(columns), &Some(rows), &Some(gap)) => {
            MeshInput::Rectangle { element_size, columns, rows, gap }
        }
        _ => return Err(wrong(JointFileError::NoMesh)),
    };
    if let Some(zones) = &case.mesh.zones {
        let (MeshInput::File(file) | MeshInput::Run(file)) = &mut mesh else { return Err(JointFileError::NoMesh) };
        let at = |name: &String| {
            let missing = || JointFileError::NoGroup { name: name.clone(), there: file.groups.join(", ") };
            file.groups.iter().position(|group| group == name).ok_or_else(missing)
        };
        let [first, second] = [at(&zones[0])?, at(&zones[1])?];
        if first == second {
            return Err(JointFileError::OneGroup { name: zones[0].clone() });
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
            _ => return Err(wrong(JointFileError::OtherMeasuredRun)),
        },
        // A load curve can be fitted alone.
        Some(CaseMeasurement { file: None, store: None, .. }) if case.force.is_some() => None,
        Some(_) => return Err(wrong(JointFileError::NoMeasurement)),
    };
    let boundary = match (&boundary.file, run) {
        (Some(file), _) if boundary.store.is_none() => BoundaryInput::Table(read_boundary(&case.base.join(file))?),
        (None, Some(run)) if boundary.store.is_some() => BoundaryInput::Run(run),
        (None, _) if boundary.store.is_none() && !case.supports.is_empty() => BoundaryInput::Drives,
        _ => return Err(wrong(JointFileError::NoBoundary)),
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
    /// There is no such file.
    #[error("{}: there is no such file; check the name and the folder", path.display())]
    NotFound {
        /// The file.
        path: PathBuf,
    },
    /// The file system refuses.
    #[error("{}: the file cannot be read: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: io::Error,
    },
    /// Not the JSON of a mesh.
    #[error("{}: no mesh of a joint in JSON ({reason}); it needs \"nodes\" [x, y] in mm and \"quads\", and \"cohesive\" where the faces are not to be found by geometry", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A `.msh` or `.vtu` file that cannot be used.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// A table without the columns that are needed.
    #[error("{}: the header must be {needed}, not '{found}'", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// The header that is needed.
        needed: &'static str,
        /// The header there is.
        found: String,
    },
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
    /// An instant without all nodes.
    #[error("{}: instant {instant} has no row for node {node}, which instant {other} has; every instant needs the same nodes", path.display())]
    MissingNode {
        /// The file.
        path: PathBuf,
        /// The instant without.
        instant: usize,
        /// The node.
        node: u32,
        /// An instant with it.
        other: usize,
    },
    /// Instants that are not 1, 2, 3, ....
    #[error("{}: there is no instant {instant}, but instant {last}; instants must be numbered 1, 2, 3, ... without a gap", path.display())]
    MissingInstant {
        /// The file.
        path: PathBuf,
        /// The one that is missing.
        instant: usize,
        /// The last one.
        last: usize,
    },
    /// Values of a support or a load that are none.
    #[error("{key}: {what}")]
    History {
        /// The key.
        key: &'static str,
        /// What is wrong.
        what: String,
    },
    /// A column that is not there.
    #[error("{}: there is no column \"{name}\"; it has {there}", path.display())]
    Column {
        /// The file.
        path: PathBuf,
        /// The column.
        name: String,
        /// Those that are there.
        there: String,
    },
    /// A table without rows.
    #[error("{}: the table has no row", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Something about a section of the case file, with its place.
    #[error("{place}: {error}")]
    InCase {
        /// Where.
        place: CasePlace,
        /// What.
        error: Box<JointFileError>,
    },
    /// Something about one of several tests.
    #[error("{place}: test \"{name}\": {error}")]
    InTest {
        /// Where the tests stand.
        place: CasePlace,
        /// The test.
        name: String,
        /// What.
        error: Box<JointFileError>,
    },
    /// Two tests of one name.
    #[error("another test has the same name; give each [[test]] a name = \"..\" of its own")]
    SameName,
    /// A name that no folder can have.
    #[error(
        "its results get a folder of its name; give it a name = \"..\" of letters, digits, - and _, other than figures"
    )]
    TestName,
    /// A test that begins with images.
    #[error("{}: is a case of quadrille run, whose images are not measured yet; run it, and give the folder of its results: case = \"RUN\"", path.display())]
    NotMeasuredYet {
        /// Its case file.
        path: PathBuf,
    },
    /// The case file itself.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// The store of a correlation run that cannot be read.
    #[cfg(feature = "store")]
    #[error(transparent)]
    Store(#[from] super::store::StoreError),
    /// The store of a correlation run, which this build cannot read.
    #[error("{}: quadrille was built without the stores of correlation runs (its feature `store`)", path.display())]
    BuiltWithoutStore {
        /// The store.
        path: PathBuf,
    },
    /// A correlation run without a scale.
    #[error("{}: the run has no pixel size; correlate again with --pixel-size MM", path.display())]
    NoPixelSize {
        /// The run.
        path: PathBuf,
    },
    /// A correlation run of splines.
    #[error("{}: the displacements of the run are cubic splines, whose nodes are bound to each other: intervals made of them would be too narrow; correlate again without --elements", path.display())]
    Splines {
        /// The run.
        path: PathBuf,
    },
    /// A correlation run without a frame that can be used.
    #[error("{}: no frame of the run converged; look at its summary.json", path.display())]
    NoFrame {
        /// The run.
        path: PathBuf,
    },
    /// No mesh, or more than one.
    #[error(
        "[mesh] needs file = \"mesh.json\", or store = \"run/fields.zarr\", or element_size_mm, columns, rows and gap_mm together"
    )]
    NoMesh,
    /// `[mesh] zones` names a group that is not there.
    #[error("[mesh] zones names \"{name}\"; the mesh has the groups {there}")]
    NoGroup {
        /// The name.
        name: String,
        /// Those that are there.
        there: String,
    },
    /// `[mesh] zones` names one group twice.
    #[error("[mesh] zones names \"{name}\" twice; name the two groups beside the adhesive")]
    OneGroup {
        /// The group.
        name: String,
    },
    /// No border, or more than one.
    #[error("[boundary] needs either file = \"displacements.csv\" or store = \"run/fields.zarr\"")]
    NoBoundary,
    /// No measurement, or two.
    #[error("[measurement] needs either file = \"measured.csv\" or store = \"run/fields.zarr\"")]
    NoMeasurement,
    /// Displacements in pixels, and nothing that says how large a pixel is.
    #[error("{}: the displacements are in pixels; give ux_mm,uy_mm with y up, or [measurement] pixel_size_mm", path.display())]
    NoScale {
        /// The table.
        path: PathBuf,
    },
    /// A curve in a file and in the case.
    #[error("[substrate] file and curve are both given; take one away")]
    CurveTwice,
    /// A `[force]` without a file.
    #[error("[force] names no load file; give file = \"load.csv\"")]
    NoForceFile,
    /// A load file that cannot be used.
    #[error("[force] {0}")]
    Force(#[from] LoadError),
    /// A scale that is none.
    #[error("[measurement] pixel_size_mm = {value}: it must be a finite number above zero")]
    BadScale {
        /// The value given.
        value: f64,
    },
    /// A measurement of another mesh.
    #[error("[measurement] store needs the same run as [mesh] store; for another mesh give file = \"measured.csv\"")]
    OtherMeasuredRun,
    /// A border that is measured on another mesh.
    #[error("[boundary] store needs the same run as [mesh] store; for another mesh give file = \"displacements.csv\"")]
    OtherRun,
}

impl JointFileError {
    /// The section of the case that it is about.
    fn section(&self) -> Option<&'static str> {
        match self {
            Self::NoMesh => Some("mesh"),
            Self::NoBoundary | Self::OtherRun => Some("boundary"),
            Self::NoMeasurement | Self::BadScale { .. } | Self::OtherMeasuredRun => Some("measurement"),
            Self::NoForceFile | Self::Force(_) => Some("force"),
            Self::CurveTwice => Some("substrate"),
            _ => None,
        }
    }
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, JointFileError> {
    std::fs::read(path).map_err(|reason| match reason.kind() {
        ErrorKind::NotFound => JointFileError::NotFound { path: path.to_owned() },
        _ => JointFileError::Io { path: path.to_owned(), reason },
    })
}
