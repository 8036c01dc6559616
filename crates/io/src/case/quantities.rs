//! What is drawn from the fields of a case: points, lines, extensometers, openings, and what they are joined with.

use super::crack_path::CrackPath;
use super::is_default;
use super::lists::{four_numbers, name, point, polygon, two_names, two_numbers};
use crate::field::RemoveRigid;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

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
    /// The sections `[[region]]`.
    pub regions: Vec<CaseRegion>,
    /// The sections `[[opening]]`.
    pub openings: Vec<CaseOpening>,
    /// The sections `[[crack]]`.
    pub cracks: Vec<CaseCrack>,
    /// The section `[tension]`.
    pub tension: Option<CaseTension>,
}

impl CaseQuantities {
    /// Whether nothing is asked for. A load file alone asks for nothing.
    pub fn is_empty(&self) -> bool {
        let Self { options, load: _, probes, lines, extensometers, regions, openings, cracks, tension: _ } = self;
        let none = probes.is_empty() && lines.is_empty() && extensometers.is_empty() && openings.is_empty();
        is_default(options) && none && regions.is_empty() && cracks.is_empty()
    }
}

/// How quantities are drawn.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Quantities"))]
#[serde(deny_unknown_fields)]
pub struct CaseQuantityOptions {
    /// The rigid motion that is subtracted first: of all nodes together, or of each zone. Without it none is.
    #[cfg_attr(feature = "cli", arg(long, value_name = "all|zone"))]
    pub remove_rigid: Option<RemoveRigid>,
    /// Poisson's ratio: the strain through the thickness, `ezz`, is written as that of plane stress.
    #[cfg_attr(feature = "cli", arg(long = "poisson", value_name = "NU", allow_negative_numbers = true))]
    pub nu: Option<f64>,
    /// Smooth quantities over time by polynomials of the second degree over so many seconds, and write their rates
    /// (`rates.csv`). The times of the frames have to be known.
    #[cfg_attr(feature = "cli", arg(long = "rate-window", value_name = "S", allow_negative_numbers = true))]
    pub rate_window_s: Option<f64>,
}

/// What other instruments recorded.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Input"))]
#[serde(deny_unknown_fields)]
pub struct CaseLoad {
    /// The load file: CSV with names and units in its header (or units in its second line) and a row for each image,
    /// or with a column `frame`, or with a column of times (docs/quantities.md). Without it the times of the frames are
    /// all that is known.
    #[serde(default, skip_serializing_if = "is_default")]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub file: String,
    /// The column of the load file that says when its rows were taken: rows are then joined with the frames by time,
    /// interpolated. Needs the times of the frames.
    #[cfg_attr(feature = "cli", arg(long = "load-time", value_name = "COLUMN"))]
    pub time: Option<String>,
    /// Time between two frames, s: frame n was taken n times that after the reference.
    #[cfg_attr(
        feature = "cli",
        arg(long = "frame-interval", value_name = "S", allow_negative_numbers = true, conflicts_with = "frame_times")
    )]
    pub frame_interval_s: Option<f64>,
    /// A file with the times of the frames instead: CSV, a row per image, with a column `time`, as cameras write it.
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub frame_times: Option<String>,
    /// Time of the reference in the load file, s; where the times of the frames come from a file, what is added to
    /// them.
    #[schemars(extend("default" = 0))]
    #[cfg_attr(feature = "cli", arg(long = "load-start", value_name = "S", allow_negative_numbers = true))]
    pub start_s: Option<f64>,
    /// The decimal mark of the load file, where the file itself does not show whether `1.250` is 1250.
    #[cfg_attr(feature = "cli", arg(long = "load-decimal", value_name = "point|comma"))]
    pub decimal: Option<Decimal>,
    /// Area of the cross-section, mm2 (as a flag also width by thickness, 12.5x3): adds a column `stress_MPa`, the force
    /// over it, and the true stress of extensometers.
    #[cfg_attr(
        feature = "cli",
        arg(long = "area", value_name = "MM2|WxT", value_parser = area, allow_negative_numbers = true)
    )]
    pub area_mm2: Option<f64>,
}

/// An area, or the width by the thickness of a section.
#[cfg(feature = "cli")]
fn area(text: &str) -> Result<f64, String> {
    let sides = text.split(['x', 'X', '*']).map(|side| side.trim().parse::<f64>());
    match sides.collect::<Result<Vec<_>, _>>().as_deref() {
        Ok(&[area]) => Ok(area),
        Ok(&[width, thickness]) => Ok(width * thickness),
        _ => Err(format!("'{text}' is no area; give mm2, or width by thickness in mm as 12.5x3")),
    }
}

/// The mark before the decimals of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Decimal {
    /// `1.25`.
    Point,
    /// `1,25`.
    Comma,
}

impl Decimal {
    /// The sign.
    pub fn mark(self) -> char {
        match self {
            Self::Point => '.',
            Self::Comma => ',',
        }
    }
}

impl FromStr for Decimal {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "point" => Ok(Self::Point),
            "comma" => Ok(Self::Comma),
            other => Err(format!("'{other}' is no decimal mark; give point or comma")),
        }
    }
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
    #[schemars(extend("default" = 0))]
    pub width_px: Option<f64>,
}

/// A part of the specimen over which means are taken: one of `roi`, `polygon`, `zone`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseRegion {
    /// Its name; that of its zone, or `region1`, `region2`, ... without.
    #[serde(default, deserialize_with = "name")]
    pub name: Option<String>,
    /// Its rectangle `[x0, y0, x1, y1]`, px of the reference image.
    #[serde(default, deserialize_with = "four_numbers")]
    pub roi: Option<[f64; 4]>,
    /// Its corners `[[x, y], ...]`, px, in order.
    #[serde(default, deserialize_with = "polygon")]
    pub polygon: Option<Vec<[f64; 2]>>,
    /// Name of a zone, all of which is meant.
    pub zone: Option<String>,
}

/// A bar under tension or compression: modulus, Poisson's ratio, proof stress, strength and Lankford's ratio follow from
/// the stress of `[load]` and the strains of its gauges.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Quantities"))]
#[serde(deny_unknown_fields)]
pub struct CaseTension {
    /// Constants of a tensile test (modulus, Poisson's ratio, proof stress, strength, Lankford's ratio): the extensometer or region
    /// that has the strain along the load. In a case file without it the first extensometer, else the first region.
    #[serde(default, deserialize_with = "name")]
    #[cfg_attr(feature = "cli", arg(id = "tension.along", long = "tension", value_name = "NAME"))]
    pub along: Option<String>,
    /// The extensometer or region that has the strain across the load; without, a region has both.
    #[serde(default, deserialize_with = "name")]
    #[cfg_attr(feature = "cli", arg(id = "tension.across", long = "across", value_name = "NAME"))]
    pub across: Option<String>,
    /// Direction of the load in the image, for regions: x or y; without, that of the larger strain.
    #[cfg_attr(
        feature = "cli",
        arg(id = "tension.axis", long = "load-axis", value_name = "x|y", hide_short_help = true)
    )]
    pub axis: Option<ImageAxis>,
    /// Strains between which modulus and Poisson's ratio are found (ISO 527-1 without; metals need less).
    #[serde(default, deserialize_with = "two_numbers")]
    #[schemars(extend("default" = [0.0005, 0.0025]))]
    #[cfg_attr(
        feature = "cli",
        arg(id = "tension.modulus_range", long = "modulus-range", value_name = "FROM,TO", value_parser = range)
    )]
    pub modulus_range: Option<[f64; 2]>,
    /// Plastic strain of the proof stress.
    #[schemars(extend("default" = 0.002))]
    #[cfg_attr(
        feature = "cli",
        arg(id = "tension.proof_strain", long = "proof-strain", value_name = "E", hide_short_help = true)
    )]
    pub proof_strain: Option<f64>,
    /// True plastic strains between which Lankford's ratio is found, up to the largest load.
    #[serde(default, deserialize_with = "two_numbers")]
    #[schemars(extend("default" = [0.02, 0.2]))]
    #[cfg_attr(
        feature = "cli",
        arg(id = "tension.r_range", long = "r-range", value_name = "FROM,TO", value_parser = range, hide_short_help = true)
    )]
    pub r_range: Option<[f64; 2]>,
    /// Standard uncertainty of the area of `[load]`, mm2; 1 % of it without.
    #[cfg_attr(
        feature = "cli",
        arg(id = "tension.area_mm2_std", long = "area-std", value_name = "MM2", hide_short_help = true)
    )]
    pub area_mm2_std: Option<f64>,
    /// Noise of the load cell, standard deviation, N.
    #[serde(rename = "load_N_std")]
    #[cfg_attr(
        feature = "cli",
        arg(id = "tension.load_N_std", long = "load-std", value_name = "N", hide_short_help = true)
    )]
    pub load_n_std: Option<f64>,
}

/// A direction in the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ImageAxis {
    /// To the right.
    X,
    /// Down.
    Y,
}

impl FromStr for ImageAxis {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "x" => Ok(Self::X),
            "y" => Ok(Self::Y),
            other => Err(format!("'{other}' is no direction in the image; give x or y")),
        }
    }
}

/// Two numbers with a comma between.
#[cfg(feature = "cli")]
fn range(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.split(',').map(|number| number.trim().parse::<f64>()).collect::<Result<Vec<_>, _>>();
    let numbers = numbers.ok().and_then(|numbers| <[f64; 2]>::try_from(numbers).ok());
    numbers.ok_or_else(|| format!("'{text}' is not two numbers FROM,TO, such as 0.0005,0.0025"))
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
    pub zones: [String; 2],
}

/// A crack or joint along which the mesh is cut.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Zones"))]
#[serde(deny_unknown_fields)]
pub struct CaseCrack {
    /// Its name; `crack1`, `crack2`, ... without.
    #[serde(default, deserialize_with = "name")]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub name: Option<String>,
    /// Points along it in order, px of the reference image. An end inside a zone stays joined: a tip. Draw it some
    /// elements beyond the place that the tip reaches. Or `"auto"` (experimental): found from the residual of the
    /// last frames.
    #[serde(skip_serializing_if = "is_default")]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub path: CrackPath,
    /// Whether a path that is drawn beside a crack is moved onto it, where the last frames show it open.
    #[schemars(extend("default" = true))]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub snap: Option<bool>,
    /// Of a path that was moved: as it was drawn. quadrille writes this to `run.toml`.
    #[serde(default, skip_serializing_if = "is_default")]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub drawn: Vec<[f64; 2]>,
    /// Pixels nearer to the path are not measured, px: the gap of the open crack is no specimen.
    #[schemars(extend("default" = 3))]
    #[cfg_attr(
        feature = "cli",
        arg(
            id = "crack.guard_px",
            long = "crack-guard",
            value_name = "PX",
            allow_hyphen_values = true,
            hide_short_help = true
        )
    )]
    pub guard_px: Option<f64>,
    /// Young's modulus around the crack, MPa: with Poisson's ratio and the pixel size the stress intensity factors at
    /// the tips are found, MPa sqrt(m).
    #[serde(rename = "E_MPa")]
    #[cfg_attr(
        feature = "cli",
        arg(
            id = "crack.E_MPa",
            long = "crack-young",
            value_name = "MPA",
            allow_hyphen_values = true,
            hide_short_help = true
        )
    )]
    pub young_mpa: Option<f64>,
    /// Poisson's ratio around the crack.
    #[serde(rename = "nu")]
    #[cfg_attr(
        feature = "cli",
        arg(
            id = "crack.nu",
            long = "crack-poisson",
            value_name = "NU",
            allow_hyphen_values = true,
            hide_short_help = true
        )
    )]
    pub poisson: Option<f64>,
    /// Outer radius of the domain of the interaction integral, px; without, the largest that fits, up to twelve
    /// elements.
    #[cfg_attr(
        feature = "cli",
        arg(
            id = "crack.radius_px",
            long = "crack-radius",
            value_name = "PX",
            allow_hyphen_values = true,
            hide_short_help = true
        )
    )]
    pub radius_px: Option<f64>,
}

/// Cracks as flags give them: several paths, and what holds for all of them.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Zones"))]
pub struct CrackFlags {
    /// Cut the mesh along a crack or joint, px: points along it in order, separated by blanks. An end inside a zone
    /// stays joined, a tip: draw it some elements further than the tip reaches. Writes opening, sliding and tips
    /// to DIR/quantities. Repeat it for several cracks; 'auto' (experimental) finds them in the residual of the last frames and
    /// says their paths. Replaces the cracks of the case file.
    #[cfg_attr(
        feature = "cli",
        arg(id = "crack.path", long = "crack", value_name = "'x,y x,y ...'|auto", allow_hyphen_values = true)
    )]
    pub path: Vec<CrackPath>,
    /// Guard, elasticity and domain.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub all: CaseCrack,
}
