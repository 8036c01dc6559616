//! Why the content of a case file makes no joint.

use super::cohesive::LawError;
use super::substrate::SubstrateError;
use super::{BoundaryFault, MeshFault, ModelError};
use crate::io::case::heading;
use thiserror::Error;

/// Why the content of a case file makes no joint.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum JointError {
    /// A key that is missing or not known.
    #[error("{} {what}", heading(section))]
    Key {
        /// The section.
        section: String,
        /// The key; none where the section itself is meant.
        key: Option<String>,
        /// What is wrong with which key.
        what: String,
    },
    /// A law of the adhesive that there is not.
    #[error(transparent)]
    Law(#[from] LawError),
    /// A material that there is not.
    #[error(transparent)]
    Substrate(#[from] SubstrateError),
    /// A mesh that makes no joint.
    #[error("{place}: {fault}")]
    Mesh {
        /// The file, or the table of the case.
        place: String,
        /// What is wrong with it.
        fault: MeshFault,
    },
    /// Prescribed displacements that cannot be used, with their file.
    #[error("{0}")]
    Boundary(String),
    /// Supports or loads that cannot be.
    #[error("[[support]] {0}")]
    Drives(BoundaryFault),
    /// A border that does not hold the mesh.
    #[error("[boundary] {0}")]
    Model(#[from] ModelError),
    /// Supports that do not.
    #[error("[[support]] {0}")]
    Held(ModelError),
}

pub(super) fn wrong(section: &str, key: Option<&str>, what: String) -> JointError {
    JointError::Key { section: section.to_owned(), key: key.map(str::to_owned), what }
}

impl JointError {
    /// The section of the case that it is about, and the key, where it is one.
    pub fn place(&self) -> Option<(&str, Option<&str>)> {
        match self {
            Self::Key { section, key, .. } => Some((section, key.as_deref())),
            Self::Law(LawError::Parameter { key, .. }) => Some(("cohesive", Some(key))),
            Self::Law(LawError::Unknown { .. }) => Some(("cohesive", Some("model"))),
            Self::Substrate(SubstrateError::Parameter { key, .. }) => Some(("substrate", Some(key))),
            Self::Substrate(SubstrateError::Curve { .. }) => Some(("substrate", Some("curve"))),
            Self::Substrate(SubstrateError::Unknown { .. }) => Some(("substrate", Some("model"))),
            Self::Mesh { place, .. } if place == OF_MESH => Some(("mesh", None)),
            Self::Model(_) => Some(("boundary", None)),
            Self::Drives(_) | Self::Held(_) => Some(("support", None)),
            _ => None,
        }
    }
}

/// Place of what is wrong with a mesh that no file holds.
pub(super) const OF_MESH: &str = "[mesh]";
