//! Why the content of a case file makes no joint.

use super::cohesive::LawError;
use super::error::{BoundaryFault, MeshFault, ModelError};
use super::substrate::SubstrateError;
use crate::io::case::heading;
use std::path::PathBuf;
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
    /// Displacements that cannot be used.
    #[error("{}: {fault}", path.display())]
    Boundary {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: BoundaryFault,
    },
    /// Supports or loads that cannot be.
    #[error("[[support]] {0}")]
    Drives(BoundaryFault),
    /// A node of the table that the mesh does not have.
    #[error("{}: node {node} at ({x}, {y}) mm is not a node of the mesh: {there}; nodes are counted from 0, y is up", path.display())]
    NotInMesh {
        /// The table.
        path: PathBuf,
        /// The node.
        node: u32,
        /// Where the table has it, mm.
        x: f64,
        /// Where the table has it, mm.
        y: f64,
        /// What the mesh has instead.
        there: String,
    },
    /// A node that the mesh file says is prescribed, without a row.
    #[error("{}: there is no row for node {node} at ({x}, {y}) mm, which the mesh file has among its prescribed nodes; give its displacement at every instant, or take it off that list", path.display())]
    NotPrescribed {
        /// The table.
        path: PathBuf,
        /// The node.
        node: u32,
        /// Its position, mm.
        x: f64,
        /// Its position, mm.
        y: f64,
    },
    /// A node of the outer border that was not measured.
    #[error("{}: frame {frame} has no displacement at node {node} of the outer border; correlate with fewer frames or another region", path.display())]
    NotMeasured {
        /// The run.
        path: PathBuf,
        /// The frame.
        frame: usize,
        /// The node.
        node: u32,
    },
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
