//! The section `[force]`: what the load cell of the testing machine recorded.

use super::lists::name;
use super::quantities::{CaseLoad, Decimal};
use schemars::JsonSchema;
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// The load cell: beside the fields in the objective of a fit, or alone; or, with `use = false` or without a fit, held
/// against the prediction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseForce {
    /// The load file, as of `[load]` (docs/quantities.md): one row per instant (frame), or with a column of times.
    /// Default in `quadrille run`: that of `[load]`.
    pub file: Option<String>,
    /// Its column with the force. Default: the only one in N, or the one called `load` or `force`.
    pub column: Option<String>,
    /// Its column of times: rows are then joined with the instants (frames) by time, interpolated.
    pub time: Option<String>,
    /// Time between two instants (frames), s, from the reference on.
    pub frame_interval_s: Option<f64>,
    /// File with the times of the instants (frames) instead: one row each, column `time`.
    pub frame_times: Option<String>,
    /// Time of the reference in the load file, s; with `frame_times` what is added to these.
    #[schemars(extend("default" = 0))]
    pub start_s: Option<f64>,
    /// The decimal mark of the load file, where the file itself does not show whether `1.250` is 1250.
    pub decimal: Option<Decimal>,
    /// The group whose reaction it is: of `[groups]`, the mesh file, or the strips. Optional if there is only one.
    #[serde(default, deserialize_with = "name")]
    pub group: Option<String>,
    /// Its direction, or degrees from x towards y. A positive force pulls the group that way.
    #[schemars(with = "Option<DirectionKey>", extend("default" = "y"))]
    pub direction: Option<CaseDirection>,
    /// Width of the specimen across the plane of the images, mm. Required.
    pub width_mm: Option<f64>,
    /// Its standard uncertainty, including the gain of the load cell, mm. Default: 1 % of the width.
    pub width_mm_std: Option<f64>,
    /// Standard uncertainty of a force, N: noise of the load cell and what the model leaves out. Required unless `use
    /// = false`.
    #[serde(rename = "std_N")]
    pub std_n: Option<f64>,
    /// Whether it takes part in the fit; else it is only compared with the prediction.
    #[serde(rename = "use", default = "yes", skip_serializing_if = "is_true")]
    #[schemars(extend("default" = true))]
    pub used: bool,
}

impl CaseForce {
    /// How its file is read and joined with the instants; `None` without a file.
    pub fn load(&self) -> Option<CaseLoad> {
        let Self { file, time, frame_interval_s, frame_times, start_s, decimal, .. } = self.clone();
        Some(CaseLoad { file: file?, time, frame_interval_s, frame_times, start_s, decimal, area_mm2: None })
    }
}

impl Default for CaseForce {
    fn default() -> Self {
        Self {
            file: None,
            column: None,
            time: None,
            frame_interval_s: None,
            frame_times: None,
            start_s: None,
            decimal: None,
            group: None,
            direction: None,
            width_mm: None,
            width_mm_std: None,
            std_n: None,
            used: true,
        }
    }
}

fn yes() -> bool {
    true
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks for it so")]
fn is_true(value: &bool) -> bool {
    *value
}

/// A direction in the plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(untagged)]
pub enum CaseDirection {
    /// Along an axis.
    Axis(CaseAxis),
    /// Degrees from x towards y (counter-clockwise).
    Degrees(f64),
}

/// An axis, forth or back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CaseAxis {
    /// To the right.
    #[serde(rename = "x")]
    X,
    /// Up.
    #[serde(rename = "y")]
    Y,
    /// To the left.
    #[serde(rename = "-x")]
    MinusX,
    /// Down.
    #[serde(rename = "-y")]
    MinusY,
}

impl CaseDirection {
    /// The unit vector.
    pub fn unit(self) -> [f64; 2] {
        match self {
            Self::Axis(CaseAxis::X) => [1.0, 0.0],
            Self::Axis(CaseAxis::Y) => [0.0, 1.0],
            Self::Axis(CaseAxis::MinusX) => [-1.0, 0.0],
            Self::Axis(CaseAxis::MinusY) => [0.0, -1.0],
            Self::Degrees(degrees) => [degrees.to_radians().cos(), degrees.to_radians().sin()],
        }
    }
}

/// What a case file holds for [`CaseDirection`].
#[derive(JsonSchema)]
#[serde(untagged)]
#[expect(dead_code, reason = "it is there for its schema")]
enum DirectionKey {
    Axis(CaseAxis),
    Degrees(f64),
}

impl<'de> Deserialize<'de> for CaseDirection {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Direction;
        impl Visitor<'_> for Direction {
            type Value = CaseDirection;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"x\", \"y\", \"-x\", \"-y\" or degrees from x towards y")
            }

            fn visit_str<E: de::Error>(self, word: &str) -> Result<CaseDirection, E> {
                CaseAxis::deserialize(de::value::StrDeserializer::new(word)).map(CaseDirection::Axis)
            }

            fn visit_f64<E: de::Error>(self, degrees: f64) -> Result<CaseDirection, E> {
                match degrees.is_finite() {
                    true => Ok(CaseDirection::Degrees(degrees)),
                    false => Err(E::invalid_value(de::Unexpected::Float(degrees), &self)),
                }
            }

            fn visit_i64<E: de::Error>(self, degrees: i64) -> Result<CaseDirection, E> {
                Ok(CaseDirection::Degrees(degrees as f64))
            }
        }
        deserializer.deserialize_any(Direction)
    }
}
