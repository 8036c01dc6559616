//! The tables of a case file that describe a joint, what was measured on it, and what is to be found.

use crate::io::case::CaseError;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The case file of `quadrille simulate` and `quadrille identify`; what it does not say is `None`.
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
    /// The table `[measurement]`: displacements that the parameters are fitted to.
    pub measurement: Option<CaseMeasurement>,
    /// The table `[fit]`.
    pub fit: Option<CaseFit>,
}

/// The table `[measurement]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseMeasurement {
    /// Table of displacements: `instant,node,ux_mm,uy_mm`.
    pub file: Option<String>,
    /// The store of the correlation run that the mesh is of.
    pub store: Option<String>,
    /// Which nodes are compared.
    pub nodes: Option<CaseNodes>,
    /// `paper`, `uniform` or `covariance`.
    pub weights: Option<String>,
    /// What is known of the prescribed displacements: `measured` (noisy, prescribed as they are), `estimated` (noisy,
    /// unknowns of the fit) or `exact`.
    pub boundary: Option<String>,
    /// Standard deviation of each nodal displacement of one frame, mm. Of a table without it, it is estimated from
    /// the residual.
    pub noise_mm: Option<f64>,
    /// Relative standard uncertainty of the noise itself; default 0.1, or what the residual tells where it is estimated from that.
    pub noise_relative_std: Option<f64>,
    /// Whether all frames were compared with one noisy reference; default true.
    pub common_reference: Option<bool>,
    /// Scale of a table in pixels (`ux_px`, `uy_px`, with y up), mm per pixel.
    pub pixel_size_mm: Option<f64>,
    /// Factor on the weight of each instant, from the first; 0 leaves an instant out.
    pub instant_weights: Option<Vec<f64>>,
}

/// Which nodes are compared: a word (`selected`, `free`) or a list of numbers.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum CaseNodes {
    /// `selected`: the list of the mesh file; `free`: all that are not prescribed.
    Word(String),
    /// Numbers of nodes.
    List(Vec<u32>),
}

/// The table `[fit]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseFit {
    /// Symbols of the parameters that are fitted.
    pub parameters: Vec<String>,
    /// Where the fit starts; over the value of `[cohesive]`.
    #[serde(default)]
    pub start: BTreeMap<String, f64>,
    /// Least values.
    #[serde(default)]
    pub lower: BTreeMap<String, f64>,
    /// Largest values.
    #[serde(default)]
    pub upper: BTreeMap<String, f64>,
    /// Further starts: a value for each of `parameters`, in their order.
    #[serde(default)]
    pub starts: Vec<Vec<f64>>,
    /// So many further starts, spread over the box of the bounds (which then have to be given).
    pub latin_hypercube: Option<usize>,
    /// Seed of these starts.
    pub seed: Option<u64>,
    /// Forward runs that one start may take.
    pub max_evaluations: Option<usize>,
    /// Also the profile likelihood of this parameter.
    pub profile: Option<String>,
    /// The effect of the element size: `included` in the 95 % intervals (a store), `stated` beside them (a table), `off`.
    pub discretisation: Option<String>,
    /// `auto` (of the profile likelihood where linear theory is in doubt), `linear` or `profile`.
    pub intervals: Option<String>,
    /// Draws of the bootstrap that goes with intervals of the profile likelihood: a number, 0 for none, or `auto`.
    pub bootstrap: Option<toml::Value>,
    /// Standard uncertainty of the adhesive's thickness, mm.
    pub thickness_mm_std: Option<f64>,
    /// Relative standard uncertainty of the pixel size.
    pub pixel_size_relative_std: Option<f64>,
    /// Standard uncertainty of the position of each face of the adhesive, px.
    pub face_position_px_std: Option<f64>,
    /// The same in mm.
    pub face_position_mm_std: Option<f64>,
    /// Constants without uncertainty: `true`, or a list of `thickness`, `faces`, `pixel_size`, `noise_level`.
    pub exact: Option<toml::Value>,
    /// `quadrille sweep`: values at which a parameter is prescribed.
    #[serde(default)]
    pub sweep: BTreeMap<String, Vec<f64>>,
}

/// The table `[mesh]`: a file, or a correlation run, or a rectangle.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseJointMesh {
    /// A mesh file: JSON, Gmsh `.msh`, or `.vtu`.
    pub file: Option<String>,
    /// The store `fields.zarr` of a correlation run with two zones, or the folder of the run.
    pub store: Option<String>,
    /// The two groups of elements (zones of the run) beside the adhesive: its normal points from the first to the second. Without, up.
    pub zones: Option<[String; 2]>,
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
