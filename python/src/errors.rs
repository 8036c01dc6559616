//! Errors of the library as exceptions of `quadrille._errors`, with the same text.

use pyo3::prelude::*;
use pyo3::types::PyType;
use quadrille::backend::choice::DeviceError;
use quadrille::correlate::CorrelationError;
use quadrille::imaging::ImageError;
use quadrille::io::case::CaseError;
use quadrille::io::images::ReadError;
use quadrille::io::joint::JointFileError;
use quadrille::metrology::MetrologyError;
use quadrille::run::{RunError, chain};
use std::error::Error;

/// The exception `kind` of `quadrille._errors`.
pub fn raise(kind: &str, text: String) -> PyErr {
    Python::attach(|py| {
        let class = py.import("quadrille._errors").and_then(|module| module.getattr(kind));
        match class.and_then(|class| Ok(class.cast_into::<PyType>()?)) {
            Ok(class) => PyErr::from_type(class, text),
            Err(error) => error,
        }
    })
}

/// What the library says went wrong, as an exception.
pub trait Raised {
    /// The name of the class in `quadrille._errors`.
    fn kind(&self) -> &'static str;
}

impl Raised for CorrelationError {
    fn kind(&self) -> &'static str {
        match self {
            Self::Mesh(_) => "ZoneError",
            Self::Option { .. } => "OptionError",
            Self::NoTexture { .. } | Self::FaceWithoutTexture { .. } | Self::Textureless { .. } => "TextureError",
            Self::Size { .. } | Self::Constant { .. } => "ImageError",
            Self::Backend(_) => "DeviceError",
            _ => "QuadrilleError",
        }
    }
}

impl Raised for RunError {
    fn kind(&self) -> &'static str {
        match self {
            Self::Refused(_) | Self::WhichReference { .. } | Self::TwoCameras(_) => "OptionError",
            Self::Reference(_) | Self::Image(_) | Self::Series(_) | Self::Target(_) => "ImageError",
            Self::Calibration(_) | Self::TargetFit(_) => "CalibrationError",
            Self::HoldsAnother { .. }
            | Self::Busy { .. }
            | Self::NoFolder { .. }
            | Self::Folder { .. }
            | Self::File { .. }
            | Self::RecordLost { .. }
            | Self::Json { .. }
            | Self::Watch(_)
            | Self::Written(_) => "FolderError",
            Self::Correlation(error) => error.kind(),
            Self::Device(_) => "DeviceError",
            Self::Case(_)
            | Self::CaseCamera(_)
            | Self::Camera(_)
            | Self::RunCase(_)
            | Self::Joint(_)
            | Self::Load(_) => "CaseError",
            Self::Mask(_) | Self::MeshFile(_) => "ZoneError",
            Self::Store(_) => "StoreError",
            Self::JointModel(_) | Self::Law(_) | Self::Model(_) => "ModelError",
            Self::Virtual(_) | Self::Synth(_) => "OptionError",
            Self::Fit(_) => "FitError",
            _ => "QuadrilleError",
        }
    }
}

macro_rules! kinds {
    ($($error:ty => $kind:literal),+) => {
        $(impl Raised for $error {
            fn kind(&self) -> &'static str {
                $kind
            }
        })+
    };
}

kinds!(
    CaseError => "CaseError",
    DeviceError => "DeviceError",
    ImageError => "ImageError",
    JointFileError => "CaseError",
    MetrologyError => "ImageError",
    ReadError => "ImageError",
    rayon::ThreadPoolBuildError => "OptionError"
);

/// Makes an exception of it.
pub fn raised<E: Raised + Error>(error: E) -> PyErr {
    raise(error.kind(), chain(&error))
}
