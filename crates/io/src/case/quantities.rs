//! What is drawn from the fields of a case: points, lines, extensometers, openings, and what they are joined with.

use super::crack_path::CrackPath;
use super::is_default;
use super::lists::{name, point, two_names};
use crate::field::RemoveRigid;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The sections of a case file that say which quantities are drawn from the fields.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CaseQuantities {
    /// The section `[quantities]`.
    pub options: CaseQuantityOptions,
    /// The section `[load]`.
    pub load: Option<CaseLoad>,
    /// The sections `[[probe]]`.
    pub probes: Vec<CaseProbe>,
    /// The sections `[[line]]`.
    pub lines: Vec<CaseLine>,
    /// The sections `[[extensometer]]`.
    pub extensometers: Vec<CaseExtensometer>,
    /// The sections `[[opening]]`.
    pub openings: Vec<CaseOpening>,
    /// The sections `[[crack]]`.
    pub cracks: Vec<CaseCrack>,
}

impl CaseQuantities {
    /// Whether nothing is asked for. A load file alone asks for nothing.
    pub fn is_empty(&self) -> bool {
        let Self { options, load: _, probes, lines, extensometers, openings, cracks } = self;
        let none = probes.is_empty() && lines.is_empty() && extensometers.is_empty() && openings.is_empty();
        is_default(options) && none && cracks.is_empty()
    }
}

/// How quantities are drawn.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseQuantityOptions {
    /// The rigid motion that is subtracted first. Without it none is.
    #[schemars(extend("x-flag" = "--remove-rigid"))]
    pub remove_rigid: Option<RemoveRigid>,
}

/// What other instruments recorded.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseLoad {
    /// The load file: CSV with names and units in its header (or units in its second line) and a row for each image, or with a
    /// column `frame`, or with a column of times (docs/quantities.md).
    #[schemars(extend("x-flag" = "--load"))]
    pub file: String,
    /// The column of the file that says when its rows were taken: rows are then joined with the frames by time, interpolated.
    #[schemars(extend("x-flag" = "--load-time"))]
    pub time: Option<String>,
    /// Time between two frames, s: frame n was taken n times that after the reference.
    #[schemars(extend("x-flag" = "--frame-interval"))]
    pub frame_interval_s: Option<f64>,
    /// A file with the times of the frames instead: a row per image, with a column `time`.
    #[schemars(extend("x-flag" = "--frame-times"))]
    pub frame_times: Option<String>,
    /// Time of the reference in the load file, s; with `frame_times` what is added to these.
    #[schemars(extend("default" = 0, "x-flag" = "--load-start"))]
    pub start_s: Option<f64>,
    /// Area of the cross-section, mm2: adds a column `stress_MPa`, the force over it.
    #[schemars(extend("x-flag" = "--area"))]
    pub area_mm2: Option<f64>,
}

/// A point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseProbe {
    /// Its name; `point1`, `point2`, ... without.
    #[serde(default, deserialize_with = "name")]
    pub name: Option<String>,
    /// Where, `[x, y]`, px of the reference image.
    #[serde(deserialize_with = "point")]
    #[schemars(extend("x-flag" = "--point"))]
    pub point: [f64; 2],
}

/// A line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseLine {
    /// Its name; `line1`, `line2`, ... without.
    #[serde(default, deserialize_with = "name")]
    pub name: Option<String>,
    /// Its first point `[x, y]`, px.
    #[serde(deserialize_with = "point")]
    pub from: [f64; 2],
    /// Its end `[x, y]`, px.
    #[serde(deserialize_with = "point")]
    pub to: [f64; 2],
    /// Distance of its points, px; without, a quarter of the element size.
    #[schemars(extend("x-flag" = "--step"))]
    pub step_px: Option<f64>,
}

/// A virtual extensometer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseExtensometer {
    /// Its name; `extensometer1`, `extensometer2`, ... without.
    #[serde(default, deserialize_with = "name")]
    pub name: Option<String>,
    /// One end `[x, y]`, px.
    #[serde(deserialize_with = "point")]
    pub from: [f64; 2],
    /// The other end `[x, y]`, px.
    #[serde(deserialize_with = "point")]
    pub to: [f64; 2],
    /// Length of the gauge lines across its ends, px; 0: points.
    #[schemars(extend("default" = 0, "x-flag" = "--width"))]
    pub width_px: Option<f64>,
}

/// An opening between two zones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseOpening {
    /// Its name; `upper-lower` from the zones without.
    #[serde(default, deserialize_with = "name")]
    pub name: Option<String>,
    /// The zone `+` and the zone `-`, by name: for a horizontal joint the upper one first.
    #[serde(deserialize_with = "two_names")]
    #[schemars(extend("x-flag" = "--opening"))]
    pub zones: [String; 2],
}

/// A crack or joint along which the mesh is cut.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseCrack {
    /// Its name; `crack1`, `crack2`, ... without.
    #[serde(default, deserialize_with = "name")]
    pub name: Option<String>,
    /// Points along it in order, px of the reference image. An end inside a zone stays joined: a tip. Draw it some elements beyond the
    /// place that the tip reaches. Or `"auto"` (experimental): found from the residual of the last frames.
    #[schemars(extend("x-flag" = "--crack"))]
    pub path: CrackPath,
    /// Pixels nearer to the path are not measured, px: the gap of the open crack is no specimen.
    #[schemars(extend("default" = 3, "x-flag" = "--crack-guard"))]
    pub guard_px: Option<f64>,
    /// Young's modulus around the crack, MPa: with `nu` and the pixel size the stress intensity factors are found.
    #[serde(rename = "E_MPa")]
    #[schemars(extend("x-flag" = "--crack-young"))]
    pub young_mpa: Option<f64>,
    /// Poisson's ratio around the crack.
    #[serde(rename = "nu")]
    #[schemars(extend("x-flag" = "--crack-poisson"))]
    pub poisson: Option<f64>,
    /// Outer radius of the domain of the interaction integral, px; without, the largest that fits, up to twelve elements.
    #[schemars(extend("x-flag" = "--crack-radius"))]
    pub radius_px: Option<f64>,
}
