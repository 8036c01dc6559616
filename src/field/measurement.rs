//! A measured displacement field.

use crate::mesh::Mesh;
use crate::units::Length;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How the correlation of one frame ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Status {
    /// The last correction is below the tolerance: the field can be used.
    Converged,
    /// The corrections were still above the tolerance after the largest number of iterations.
    IterationLimit,
    /// The corrections grew, or the deformed image does not match the reference under the field found.
    Diverged,
    /// Too much of a zone has moved out of the deformed image.
    LeftImage,
    /// The image could not be read, or is not an image of this series.
    Unreadable,
}

impl Status {
    /// Number used where a file cannot hold a word: 0 converged, 1 iteration limit, 2 diverged, 3 left the
    /// image, 4 unreadable.
    pub fn code(self) -> u8 {
        match self {
            Status::Converged => 0,
            Status::IterationLimit => 1,
            Status::Diverged => 2,
            Status::LeftImage => 3,
            Status::Unreadable => 4,
        }
    }

    /// The status with this [`code`](Self::code).
    ///
    /// ```
    /// use quadrille::field::Status;
    /// assert_eq!(Status::from_code(Status::LeftImage.code()), Some(Status::LeftImage));
    /// assert_eq!(Status::from_code(255), None);
    /// ```
    pub fn from_code(code: u8) -> Option<Self> {
        let all = [Self::Converged, Self::IterationLimit, Self::Diverged, Self::LeftImage, Self::Unreadable];
        all.into_iter().find(|status| status.code() == code)
    }

    /// Whether a frame that ended so has a field that may be shown: a diverged one is no measurement.
    pub fn has_field(self) -> bool {
        match self {
            Status::Converged | Status::IterationLimit | Status::LeftImage => true,
            Status::Diverged | Status::Unreadable => false,
        }
    }

    /// Name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Status::Converged => "converged",
            Status::IterationLimit => "iteration_limit",
            Status::Diverged => "diverged",
            Status::LeftImage => "left_image",
            Status::Unreadable => "unreadable",
        }
    }
}

/// The displacement field of one deformed image, on the nodes of a mesh of the reference image.
///
/// A node that was not measured (without texture, or outside the deformed image) has
/// `measured == false`; its other numbers are zero and mean nothing.
#[derive(Debug, Clone)]
pub struct Measurement<U: Length> {
    /// The mesh, in `U`.
    pub mesh: Arc<Mesh<U>>,
    /// How the correlation ended.
    pub status: Status,
    /// Displacement of each node, in `U`.
    pub displacement: Vec<[f64; 2]>,
    /// Standard uncertainty of each displacement, in `U`.
    pub sigma: Vec<[f64; 2]>,
    /// Whether the node was measured.
    pub measured: Vec<bool>,
    /// Root mean square of the residual `f - g` in each element, in grey levels.
    pub element_residual: Vec<f64>,
}
