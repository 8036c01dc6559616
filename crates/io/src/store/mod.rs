//! The store of record of a run: `fields.zarr`, a Zarr V3 group.
//!
//! One array for each quantity and one chunk of it for each frame; mesh, units, definitions and options are
//! beside them (docs/formats.md has the tables). A frame is there once its chunk of `status` is: that one is
//! written last. A run can therefore be read while it goes on, and what a stopped run had finished stays.
//!
//! [`StoreWriter`] writes, [`Store`] reads.

mod attributes;
mod folder;
mod layout;
mod reader;
mod writer;

pub use super::STORE;

/// How the device of fields begins that were imported from another program.
pub const IMPORTED_FROM: &str = "imported from ";

pub use layout::{Place, Variable};
pub use reader::{Store, StoredFrame};
pub use writer::{EncodedField, StoreWriter, remove_store};

use crate::camera::Camera;
use crate::case::{CaseCamera, CaseCameraError};
use crate::field::{Elements, StrainDefinition, StrainWindow};
use crate::mesh::{Mesh, MeshError};
use crate::units::{PixelSize, Px};
use std::error::Error;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use thiserror::Error;
use zarrs::array::ArrayError;
use zarrs::storage::StorageError;

/// What holds for all frames of a store.
#[derive(Debug, Clone, PartialEq)]
pub struct StoreHeader {
    /// Version of the program that wrote it.
    pub quadrille: String,
    /// Device that computed the fields.
    pub device: String,
    /// The mesh on the reference image, px.
    pub mesh: Arc<Mesh<Px>>,
    /// Columns and rows of the images.
    pub image_size_px: [usize; 2],
    /// Files of the reference image.
    pub reference: Vec<String>,
    /// SHA-256 of each of them, in hexadecimal digits.
    pub reference_sha256: Vec<String>,
    /// Files of the deformed images; frame `n` is the one at `n - 1`.
    pub frames: Vec<String>,
    /// Scale of the images, when it is known.
    pub pixel_size: Option<PixelSize>,
    /// Largest less smallest grey level of the reference: the 100 % of residuals. Above zero.
    pub range_grey: f64,
    /// Size of the elements (square root of their mean area), px.
    pub element_size_px: f64,
    /// Definition of the strains.
    pub strain: StrainDefinition,
    /// Window of nodes over which strains stand beside those of elements and nodes.
    pub strain_window: Option<StrainWindow>,
    /// Text of `run.toml` as it was when the run began: every option, without the record of the images.
    pub case: String,
}

impl StoreHeader {
    /// What the displacement is between the nodes, as the case says; bilinear where it says nothing.
    pub fn elements(&self) -> Elements {
        let case: toml::Table = self.case.parse().unwrap_or_default();
        let named = case.get("correlation").and_then(|section| section.get("elements")).and_then(toml::Value::as_str);
        named.and_then(|name| name.parse().ok()).unwrap_or_default()
    }

    /// How the camera sees the plane, as the case says; a usual lens where it says nothing.
    ///
    /// # Errors
    /// Numbers that are no camera of these images.
    pub fn camera(&self) -> Result<Camera, CaseCameraError> {
        self.case_camera().unwrap_or_default().camera(self.image_size_px)
    }

    /// Relative standard uncertainty of the size of a pixel, where the camera states one.
    pub fn pixel_size_std(&self) -> f64 {
        self.case_camera().and_then(|camera| camera.pixel_size_relative_std).unwrap_or(0.0)
    }

    /// What the case says of the camera; nothing where it says nothing.
    pub fn case_camera(&self) -> Option<CaseCamera> {
        let case: toml::Table = self.case.parse().unwrap_or_default();
        case.get("camera").and_then(|section| section.clone().try_into().ok())
    }

    /// Puts another camera in the place of that of the case, and the size of a pixel that it states.
    fn see_by(&mut self, camera: &CaseCamera) -> Result<(), CaseCameraError> {
        let key = |key, what: String| CaseCameraError::Key { key, what };
        camera.camera(self.image_size_px)?;
        if let Some(mm) = camera.pixel_size_mm {
            let size = PixelSize::new(mm).ok_or_else(|| key("pixel_size_mm", format!("{mm} is not above zero")))?;
            self.pixel_size = Some(size);
        }
        let mut case: toml::Table = self.case.parse().unwrap_or_default();
        let section = toml::Value::try_from(camera).map_err(|error| key("file", error.to_string()))?;
        case.insert("camera".to_owned(), section);
        self.case = case.to_string();
        Ok(())
    }

    /// The program that measured the fields, where they were imported.
    pub fn imported_from(&self) -> Option<&str> {
        self.device.strip_prefix(IMPORTED_FROM)
    }

    /// How the standard uncertainties are made.
    fn sigma(&self) -> &'static str {
        if self.imported_from().is_some() { attributes::SIGMA_IMPORTED } else { attributes::SIGMA }
    }

    /// What a reader must know, a line each: version, device, reference frame, units, uncertainties and strains.
    pub fn about(&self) -> Vec<String> {
        let mut lines = vec![
            format!("quadrille {}, {}", self.quadrille, self.device),
            format!("frame of reference: {}", attributes::FRAME_OF_REFERENCE),
        ];
        let is_there = |variable: &Variable| self.strain_window.is_some() || !variable.is_of_window();
        for variable in Variable::ALL.into_iter().filter(is_there) {
            lines.push(format!("{} [{}]: {}", variable.name(), variable.unit(), variable.meaning()));
        }
        lines.push(format!("sigma: {}", self.sigma()));
        lines.extend(self.strain.describe(self.element_size_px));
        lines.extend(self.strain_window.iter().flat_map(|window| window.describe(self.element_size_px)));
        lines
    }
}

/// Why a store cannot be written or read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum StoreError {
    /// There is no store at this place.
    #[error("{}: there is no {STORE} here; name the folder that `quadrille correlate` wrote", path.display())]
    NotFound {
        /// What was named.
        path: PathBuf,
    },
    /// Something else stands where the store should be.
    #[error("{}: this is not a store of quadrille ({reason}); move it away or name another folder", path.display())]
    NotAStore {
        /// The folder.
        path: PathBuf,
        /// What shows it.
        reason: String,
    },
    /// The store has a layout that this program does not know.
    #[error(
        "{}: the layout of this store has version {found}, written by quadrille {writer}; this is quadrille {}, which \
         reads version {}: take the program that wrote it",
        path.display(), env!("CARGO_PKG_VERSION"), layout::VERSION
    )]
    Version {
        /// The store.
        path: PathBuf,
        /// Its version.
        found: u64,
        /// Version of the program that wrote it.
        writer: String,
    },
    /// A file of metadata is damaged.
    #[error("{}: the metadata is damaged: {reason}; run `quadrille correlate` again", file.display())]
    Metadata {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The mesh of the store is none.
    #[error("{}: the store holds no valid mesh; run `quadrille correlate` again", path.display())]
    Mesh {
        /// The store.
        path: PathBuf,
        /// What is wrong.
        source: MeshError,
    },
    /// A chunk that should be there is not.
    #[error("{}: this chunk is missing, though the store says that it was written; {}", file.display(), again(*frame))]
    MissingChunk {
        /// The file that is missing.
        file: PathBuf,
        /// Number of the frame; none for what all frames share.
        frame: Option<usize>,
    },
    /// A chunk does not hold what was written.
    #[error("{}: this chunk is damaged ({reason}); {}", file.display(), again(*frame))]
    DamagedChunk {
        /// The file.
        file: PathBuf,
        /// Number of the frame; none for what all frames share.
        frame: Option<usize>,
        /// What is wrong.
        reason: String,
    },
    /// A frame that the series does not have.
    #[error("there is no frame {number}; the series has {n_frames}, counted from 1")]
    NoFrame {
        /// What was asked for.
        number: usize,
        /// Frames of the series.
        n_frames: usize,
    },
    /// A field that does not belong to the mesh of the store.
    #[error("frame {number}: the field has {found} {what}, the store {wanted}")]
    WrongSize {
        /// Number of the frame.
        number: usize,
        /// Nodes or elements.
        what: &'static str,
        /// How many the field has.
        found: usize,
        /// How many the store has.
        wanted: usize,
    },
    /// The file system refuses to read.
    #[error("{}: cannot be read: {reason}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// The file system refuses to write, or the disk is full.
    #[error("{}: cannot be written: {reason}", file.display())]
    Write {
        /// The file.
        file: PathBuf,
        /// What the system says.
        reason: String,
    },
}

/// What to do about a chunk that is lost.
fn again(frame: Option<usize>) -> String {
    match frame {
        Some(number) => format!("frame {number} is lost, the others can be used: correlate its image again"),
        None => "no field can be read without it: run `quadrille correlate` again".to_owned(),
    }
}

impl StoreError {
    fn write(file: PathBuf, error: impl Error) -> Self {
        Self::Write { file, reason: error.to_string() }
    }

    fn reading(file: PathBuf, error: &io::Error) -> Self {
        Self::Read { file, reason: error.to_string() }
    }

    /// What no file can cause.
    fn unexpected(file: PathBuf, error: &dyn Error) -> Self {
        Self::Write { file, reason: format!("{error} (this is a bug in quadrille)") }
    }

    /// A chunk that is there and cannot be used.
    fn chunk(file: PathBuf, frame: Option<usize>, error: &ArrayError) -> Self {
        match error {
            ArrayError::StorageError(StorageError::IOError(error)) => Self::reading(file, error),
            error => Self::DamagedChunk { file, frame, reason: error.to_string() },
        }
    }
}
