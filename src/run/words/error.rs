//! Why a run cannot be carried out.

use crate::backend::choice::DeviceError;
use crate::camera::CameraError;
use crate::camera::calibrate::CalibrationError;
use crate::camera::target::TargetFitError;
use crate::correlate::CorrelationError;
use crate::identify::FitError;
use crate::io::case::{CaseCameraError, CaseError};
use crate::io::foreign::FieldError;
use crate::io::images::{ReadError, WriteError};
use crate::io::joint::JointFileError;
use crate::io::load::LoadError;
use crate::io::mask::MaskError;
use crate::io::mesh_file::MeshFileError;
use crate::io::run_case::RunCaseError;
use crate::io::series::SeriesError;
use crate::io::store::StoreError;
use crate::io::text::shell_word;
use crate::io::watch::WatchError;
use crate::mechanics::cohesive::LawError;
use crate::mechanics::{JointError, ModelError};
use crate::metrology::target::TargetError;
use crate::report::ReportError;
use crate::run::words::chain;
use crate::synth::SynthError;
use crate::virtual_test::VirtualError;
use std::path::{Path, PathBuf};
use std::thread::{Builder, Scope, ScopedJoinHandle};

/// What the functions of this module give.
pub type Result<T> = std::result::Result<T, RunError>;

/// Why a run cannot be carried out. The text of each names the file, frame or option and says what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// What is asked for contradicts itself, or does not fit the images.
    #[error("{0}")]
    Refused(String),
    /// No reference is given, and the name of another image than the first says that it is.
    #[error(
        "no --reference is given, so that {} would be the reference, since it comes first; but the name of {} says that it is: \
         give --reference {}, or whichever it is (in a case file `reference`)",
        first.display(), named.display(), shell_word(&named.to_string_lossy())
    )]
    WhichReference {
        /// The first image.
        first: PathBuf,
        /// The one whose name says so.
        named: PathBuf,
    },
    /// The images of two cameras in one series.
    #[error("{0}")]
    TwoCameras(String),
    /// The folder holds the results of another run.
    #[error(
        "{}: holds the results of another run{}; choose another --output folder, or replace them with --overwrite",
        folder.display(), why.as_ref().map_or(String::new(), |why| format!(" ({why})"))
    )]
    HoldsAnother {
        /// The folder.
        folder: PathBuf,
        /// In what they differ, or what is the matter with its store.
        why: Option<String>,
    },
    /// Another process works on the folder.
    #[error("{}: is being worked on ({who}); wait for it, stop it, or choose another --output folder", folder.display())]
    Busy {
        /// The folder.
        folder: PathBuf,
        /// Which process, on which machine, since when.
        who: String,
    },
    /// A file that no run has written, with the name of a result.
    #[error(
        "{}: would be overwritten, and the folder holds no run that wrote it; choose another --output folder, or replace \
         it with --overwrite", path.display()
    )]
    FileOfOthers {
        /// The file.
        path: PathBuf,
    },
    /// A file in the place of the folder.
    #[error("{}: cannot be written, it is a file; results need a folder: choose another --output folder", path.display())]
    NoFolder {
        /// The file.
        path: PathBuf,
    },
    /// A folder that cannot be written to.
    #[error("{}: cannot be written ({source}); choose another --output folder", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The system gives no thread: memory or processes are limited.
    #[error(
        "the system gives no more threads ({0}); give fewer with --threads, or allow the process more memory (ulimit -v) or threads (ulimit -u)"
    )]
    Threads(std::io::Error),
    /// A file that something cannot be done with.
    #[error("{}: cannot be {what}: {}", path.display(), chain(source))]
    File {
        /// The file.
        path: PathBuf,
        /// `read`, `written`, `removed`, `locked`.
        what: &'static str,
        /// What the system says.
        source: std::io::Error,
    },
    /// What is stored of a frame beside the store is gone.
    #[error("frame {number}: its record is lost: {remedy}")]
    RecordLost {
        /// The frame, from 1.
        number: usize,
        /// What to do.
        remedy: &'static str,
    },
    /// The reference cannot be prepared; with the name of its file where it is to blame.
    #[error("{0}")]
    Reference(String),
    /// A thread ended without a word.
    #[error("{0}: this is a bug in quadrille")]
    Bug(&'static str),
    /// A frame cannot be correlated.
    #[error(transparent)]
    Correlation(#[from] CorrelationError),
    /// The device is not there.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The case file.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// The camera of a case, or its file.
    #[error(transparent)]
    CaseCamera(#[from] CaseCameraError),
    /// The camera does not fit the images.
    #[error("[camera]: {0}")]
    Camera(#[from] CameraError),
    /// Images that do not determine a camera.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// Images without the target that was asked for.
    #[error(transparent)]
    Target(#[from] TargetError),
    /// A target that does not determine a camera.
    #[error(transparent)]
    TargetFit(#[from] TargetFitError),
    /// A virtual test that cannot be computed.
    #[error(transparent)]
    Virtual(#[from] VirtualError),
    /// Images that cannot be computed.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// An image.
    #[error(transparent)]
    Image(#[from] ReadError),
    /// An image that cannot be written.
    #[error(transparent)]
    Written(#[from] WriteError),
    /// The list of images.
    #[error(transparent)]
    Series(#[from] SeriesError),
    /// The field of another program.
    #[error(transparent)]
    Foreign(#[from] FieldError),
    /// A mask.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// A mesh file.
    #[error(transparent)]
    MeshFile(#[from] MeshFileError),
    /// A load file.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The watched folder.
    #[error(transparent)]
    Watch(#[from] WatchError),
    /// The case file of a run from images to the report.
    #[error(transparent)]
    RunCase(#[from] RunCaseError),
    /// The case of a joint, or a table that it names.
    #[error(transparent)]
    Joint(#[from] JointFileError),
    /// The joint that a case describes.
    #[error(transparent)]
    JointModel(Box<JointError>),
    /// The values of a law.
    #[error(transparent)]
    Law(#[from] LawError),
    /// A joint that cannot be computed.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A fit that cannot be begun.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A figure or a page.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// A file that is not what it should be.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
}

/// A thread within `scope`, or an error where the system gives none.
pub(crate) fn thread<'scope, 'env, T: Send + 'scope>(
    scope: &'scope Scope<'scope, 'env>,
    work: impl FnOnce() -> T + Send + 'scope,
) -> Result<ScopedJoinHandle<'scope, T>> {
    Builder::new().spawn_scoped(scope, work).map_err(RunError::Threads)
}

impl RunError {
    /// `path` cannot be `what`.
    pub(crate) fn file(path: &Path, what: &'static str, source: std::io::Error) -> Self {
        Self::File { path: path.to_owned(), what, source }
    }
}

impl From<JointError> for RunError {
    fn from(error: JointError) -> Self {
        Self::JointModel(Box::new(error))
    }
}

impl From<String> for RunError {
    fn from(refusal: String) -> Self {
        Self::Refused(refusal)
    }
}

impl From<&str> for RunError {
    fn from(refusal: &str) -> Self {
        Self::Refused(refusal.to_owned())
    }
}
