//! The sections that hold and load a joint by component: `[[support]]`, `[[applied_load]]`.

use super::lists::all;
use schemars::JsonSchema;
use serde::de::{self, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// Displacements of a group of nodes that are prescribed, by component. Beside `[boundary]`, or instead of it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseSupport {
    /// Its group of nodes, of `[groups]` or the mesh file.
    pub group: String,
    /// Displacement along x, mm: a number (at every instant), a list over the instants, `{ to = 2.0, instants = 40 }`
    /// (even steps from rest), or `{ file = "curve.csv", column = "u_mm" }`. Default: free.
    pub u_x_mm: Option<CaseHistory>,
    /// The same along y.
    pub u_y_mm: Option<CaseHistory>,
    /// Whether the nodes move as one body (loading block, lever) whose `point_mm` has these displacements; its
    /// rotation is free.
    #[serde(default, skip_serializing_if = "super::is_default")]
    #[schemars(extend("default" = false))]
    pub rigid: bool,
    /// The point of a rigid body that is held or loaded, mm at rest. Default: the middle of the nodes.
    pub point_mm: Option<[f64; 2]>,
    /// Components of the nodes that a rigid body moves: one for a lever on rollers (small rotations only).
    #[schemars(extend("default" = "both"))]
    pub tied: Option<CaseTied>,
}

/// How the history of border, supports and loads is followed; for `quadrille simulate` only.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CasePath {
    /// From instant to instant, jumping where the joint snaps; or (experimental) along the path of equilibria, whose
    /// points are then the instants of all results.
    #[schemars(extend("default" = "instants"))]
    pub control: Option<CasePathControl>,
    /// Of `arc-length`: largest change of a jump between points, relative to the opening that counts as cracked.
    #[schemars(extend("default" = 0.25))]
    pub step: Option<f64>,
    /// Of `arc-length`: largest number of points.
    #[schemars(extend("default" = 2000))]
    pub max_points: Option<usize>,
}

/// How a history is gone through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CasePathControl {
    /// From instant to instant.
    #[default]
    Instants,
    /// By the length of the path.
    ArcLength,
}

/// Which components a rigid body moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CaseTied {
    /// Both: the nodes are glued on.
    Both,
    /// Along x alone.
    X,
    /// Along y alone.
    Y,
}

/// Forces on a group of nodes, or at the point of a rigid body; they keep their direction.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseAppliedLoad {
    /// Its group of nodes, of `[groups]` or the mesh file.
    pub group: String,
    /// Force along x on the whole group, N per mm of width, in equal shares on its nodes; values as of `[[support]]`.
    #[serde(rename = "F_x_N_per_mm")]
    pub f_x_n_per_mm: Option<CaseHistory>,
    /// The same along y.
    #[serde(rename = "F_y_N_per_mm")]
    pub f_y_n_per_mm: Option<CaseHistory>,
    /// Traction along x on border edges between nodes of the group, MPa, of the edges at rest.
    #[serde(rename = "T_x_MPa")]
    pub t_x_mpa: Option<CaseHistory>,
    /// The same along y.
    #[serde(rename = "T_y_MPa")]
    pub t_y_mpa: Option<CaseHistory>,
}

/// A value over the instants.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum CaseHistory {
    /// The same at every instant.
    Constant(f64),
    /// One for each instant.
    List(Vec<f64>),
    /// Even steps from rest.
    Ramp {
        /// The value at the last instant.
        to: f64,
        /// How many instants.
        instants: usize,
    },
    /// A column of a CSV file, a row for each instant.
    Column {
        /// The file.
        file: String,
        /// Name of the column.
        column: String,
        /// Factor on its values.
        #[serde(skip_serializing_if = "Option::is_none")]
        factor: Option<f64>,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HistoryTable {
    to: Option<f64>,
    instants: Option<usize>,
    file: Option<String>,
    column: Option<String>,
    factor: Option<f64>,
}

impl<'de> Deserialize<'de> for CaseHistory {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct History;
        const FORMS: &str =
            "a number, a list of numbers, { to = 2.0, instants = 40 } or { file = \"curve.csv\", column = \"u_mm\" }";
        impl<'de> Visitor<'de> for History {
            type Value = CaseHistory;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(FORMS)
            }

            fn visit_f64<E: de::Error>(self, value: f64) -> Result<CaseHistory, E> {
                Ok(CaseHistory::Constant(value))
            }

            fn visit_i64<E: de::Error>(self, value: i64) -> Result<CaseHistory, E> {
                Ok(CaseHistory::Constant(value as f64))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<CaseHistory, A::Error> {
                all(list).map(CaseHistory::List)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<CaseHistory, A::Error> {
                match HistoryTable::deserialize(de::value::MapAccessDeserializer::new(map))? {
                    HistoryTable { to: Some(to), instants: Some(instants), file: None, column: None, factor: None } => {
                        Ok(CaseHistory::Ramp { to, instants })
                    }
                    HistoryTable { to: None, instants: None, file: Some(file), column: Some(column), factor } => {
                        Ok(CaseHistory::Column { file, column, factor })
                    }
                    _ => Err(de::Error::custom(format!("expected {FORMS}"))),
                }
            }
        }
        deserializer.deserialize_any(History)
    }
}
