//! What people look at: summaries and pictures of measured fields.

mod canvas;
pub mod map;
mod picture;
mod scale;
pub mod summary;

pub use map::{MapOptions, element_map, nodal_map};
pub use picture::{Area, Picture};
pub use scale::Palette;

use std::path::PathBuf;
use thiserror::Error;

/// Why a picture cannot be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The field is that of another mesh.
    #[error("{got} values do not fit a mesh of {expected} {what}")]
    Length {
        /// `nodes` or `elements`.
        what: &'static str,
        /// Number in the mesh.
        expected: usize,
        /// Values given.
        got: usize,
    },
    /// The range asked for has no extent, or no finite one.
    #[error("colours cannot span {low} to {high}; give a finite range with low < high")]
    Range {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// The PNG data cannot be written.
    #[error("the picture cannot be written")]
    Encode(#[source] image::ImageError),
    /// The file cannot be written.
    #[error("the picture cannot be written to {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}
