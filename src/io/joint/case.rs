//! The tables of a case file that describe a joint.

use crate::io::case::CaseError;
use serde::Deserialize;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The case file of `quadrille simulate`; what it does not say is `None`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointCase {
    /// Folder of the case file: relative names in it are relative to this.
    #[serde(skip)]
    pub base: PathBuf,
    /// The table `[mesh]`.
    pub mesh: CaseJointMesh,
    /// The table `[boundary]`.
    pub boundary: CaseBoundary,
    /// The table `[substrate]`, with `[substrate.NAME]` where groups of elements have their own material.
    pub substrate: toml::Table,
    /// The table `[cohesive]`.
    pub cohesive: toml::Table,
    /// The table `[output]`.
    #[serde(default)]
    pub output: CaseJointOutput,
}

/// The table `[mesh]`: a file, or a correlation run, or a rectangle.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseJointMesh {
    /// A mesh file: JSON, Gmsh `.msh`, or `.vtu`.
    pub file: Option<String>,
    /// The store `fields.zarr` of a correlation run with two zones, or the folder of the run.
    pub store: Option<String>,
    /// Side of the square elements, mm.
    pub element_size_mm: Option<f64>,
    /// Elements along the joint.
    pub columns: Option<usize>,
    /// Rows of elements in each strip.
    pub rows: Option<usize>,
    /// Distance of the faces, mm.
    pub gap_mm: Option<f64>,
    /// Cut every element into this many by as many.
    pub refine: Option<usize>,
}

/// The table `[boundary]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseBoundary {
    /// Table of displacements: `instant,node,x_mm,y_mm,ux_mm,uy_mm`.
    pub file: Option<String>,
    /// The store of a correlation run: its outer nodes are prescribed.
    pub store: Option<String>,
    /// `none` (default) or `overall`.
    pub remove_rigid_motion: Option<String>,
}

/// The table `[output]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseJointOutput {
    /// Instants to draw, from 1; default: first, middle, last.
    pub figures: Option<Vec<usize>>,
    /// Also the derivatives by the materials' parameters.
    #[serde(default)]
    pub substrate_sensitivities: bool,
}

/// Reads the case file `path`.
///
/// # Errors
/// A file that cannot be read, that is not TOML, or that has a key that such a file does not have.
pub fn read_joint_case(path: &Path) -> Result<JointCase, CaseError> {
    let text = std::fs::read_to_string(path).map_err(|reason| match reason.kind() {
        ErrorKind::NotFound => CaseError::NotFound { path: path.to_owned() },
        ErrorKind::InvalidData => CaseError::NotText { path: path.to_owned(), line: 1 },
        _ => CaseError::Io { path: path.to_owned(), reason },
    })?;
    let mut case: JointCase = toml::from_str(&text).map_err(|error| {
        let before = text.get(..error.span().map_or(0, |span| span.start)).unwrap_or("");
        CaseError::Invalid {
            path: path.to_owned(),
            line: 1 + before.matches('\n').count(),
            column: 1 + before.rsplit('\n').next().unwrap_or("").chars().count(),
            key: None,
            message: error.message().replace('\n', "; "),
        }
    })?;
    case.base = path.parent().map(Path::to_owned).unwrap_or_default();
    Ok(case)
}
