//! The section `[reduction]`: a test of the standards, reduced without a model (THEORY 23).

use super::lists::point;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A test of the standards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CaseLayout {
    /// Double cantilever beam: both arms are pulled apart.
    Dcb,
    /// End-notched flexure: three-point bending.
    Enf,
    /// Mixed-mode bending: a lever.
    Mmb,
    /// Single-leg bending: three-point bending, one arm is not supported.
    Slb,
    /// A thin arm is pulled off.
    Peel,
    /// A lap joint: the shear traction along it, from the strain of the upper adherend.
    Lap,
}

impl CaseLayout {
    /// Its name in a case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dcb => "dcb",
            Self::Enf => "enf",
            Self::Mmb => "mmb",
            Self::Slb => "slb",
            Self::Peel => "peel",
            Self::Lap => "lap",
        }
    }
}

/// J, energy release rates by the standards and the traction from images and loads, for `quadrille reduce`
/// (docs/reduction.md).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseReduction {
    /// The test: double cantilever beam, end-notched flexure, mixed-mode bending, single-leg bending, peel, or
    /// lap joint.
    pub layout: CaseLayout,
    /// Folder of a run of `quadrille correlate` (or of `import`), with `[load]`, the loads of its frames. In `quadrille
    /// run` neither it nor a table: the run has its own fields.
    pub run: Option<String>,
    /// Or a table with a row for each instant: `load_N`, and of `displacement_mm`, `rotation_1` (the sum of the shares
    /// of the load times the sine of the rotation), `opening_mm`, `sliding_mm`, `crack_mm` those that are known, each
    /// with `sigma_...` beside it, and `other_end_mm`: as in `reduction.csv`.
    pub table: Option<String>,
    /// Names of the `[[region]]`s where loads act, in the order that the layout has (docs/reduction.md). Without them
    /// J is not known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sections: Vec<String>,
    /// Name of the `[[opening]]` between the arms, the upper one first. Default: the only one.
    pub opening: Option<String>,
    /// The initial tip `[x, y]`, px: separations are those at this place of the joint.
    #[serde(default, deserialize_with = "some_point")]
    #[schemars(with = "Option<[f64; 2]>")]
    pub tip: Option<[f64; 2]>,
    /// Separation at which the crack ends, mm: its length is measured where the opening (of enf: the sliding) falls
    /// below it. Without it no length is measured.
    pub crack_opening_mm: Option<f64>,
    /// Column of the load. Default: the only one in N, or the one called `load` or `force`.
    pub force: Option<String>,
    /// Standard uncertainty of a value of the load cell, N.
    #[serde(rename = "force_std_N")]
    pub force_std_n: Option<f64>,
    /// Relative standard uncertainty of all its values together: its gain.
    pub force_scale_std: Option<f64>,
    /// Column of the machine's displacement, mm, in place of that of the sections.
    pub displacement: Option<String>,
    /// Compliance of the machine, mm/N: what it gives way is taken off its displacement.
    #[serde(rename = "machine_compliance_mm_per_N")]
    pub machine_compliance_mm_per_n: Option<f64>,
    /// Width of the specimen, mm.
    pub width_mm: f64,
    /// Its standard uncertainty, mm.
    pub width_mm_std: Option<f64>,
    /// Thickness of one arm, mm.
    pub arm_mm: Option<f64>,
    /// Its standard uncertainty, mm.
    pub arm_mm_std: Option<f64>,
    /// Thickness of the adhesive, mm: separations are then those of its faces, by the strain between them and the nodes.
    /// Without it they are those of the nodes.
    pub adhesive_mm: Option<f64>,
    /// From the line of the load (in bending: the support of the cracked end) to the initial tip, mm.
    pub crack_mm: Option<f64>,
    /// Its standard uncertainty, mm.
    pub crack_mm_std: Option<f64>,
    /// Standard uncertainty of the length of the crack over the width, mm: its front is not straight, and the camera
    /// sees one side.
    pub crack_front_mm_std: Option<f64>,
    /// End blocks of a double cantilever beam, mm: from the pin to the middle of the arm, and half of the length.
    pub end_block_mm: Option<[f64; 2]>,
    /// Half the distance of the supports, mm.
    pub half_span_mm: Option<f64>,
    /// From the middle to the load on the lever of mixed-mode bending, mm.
    pub lever_mm: Option<f64>,
    /// Young's modulus along the arms, MPa. Without it, it follows from the initial compliance and `crack_mm`.
    #[serde(rename = "E_MPa")]
    pub young_mpa: Option<f64>,
    /// Its standard uncertainty, MPa.
    #[serde(rename = "E_MPa_std")]
    pub young_mpa_std: Option<f64>,
    /// Shear modulus of the arms, MPa. Without it beams do not shear.
    #[serde(rename = "G_MPa")]
    pub shear_mpa: Option<f64>,
}

fn some_point<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<[f64; 2]>, D::Error> {
    point(from).map(Some)
}
