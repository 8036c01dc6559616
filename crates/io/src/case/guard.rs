//! The guard of a zone, in the forms that a case file may give it.

use super::lists::{Corner, all, pairs};
use schemars::JsonSchema;
use serde::Serialize;
use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use std::fmt;

/// Width along the border of a zone whose pixels are left out, px.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(deny_unknown_fields)]
pub enum CaseGuard {
    /// The same everywhere.
    All(f64),
    /// One for each side of a polygon, in order; side k leads from corner k to the next.
    Sides(Vec<f64>),
    /// One for each side of a rectangle; in the file those left out are 0.
    Rectangle {
        /// Left.
        #[schemars(default)]
        left: f64,
        /// Top.
        #[schemars(default)]
        top: f64,
        /// Right.
        #[schemars(default)]
        right: f64,
        /// Bottom.
        #[schemars(default)]
        bottom: f64,
    },
    /// Along a line alone.
    Along {
        /// Points of the line in order, px.
        along: Vec<[f64; 2]>,
        /// Distance from it, px.
        width: f64,
    },
}

impl<'de> Deserialize<'de> for CaseGuard {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Widths;
        impl<'de> Visitor<'de> for Widths {
            type Value = CaseGuard;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "a number of pixels, { left = 0, top = 0, right = 0, bottom = 3 }, or a list with one for each side",
                )
            }

            fn visit_f64<E: de::Error>(self, guard: f64) -> Result<CaseGuard, E> {
                Ok(CaseGuard::All(guard))
            }

            fn visit_i64<E: de::Error>(self, guard: i64) -> Result<CaseGuard, E> {
                Ok(CaseGuard::All(guard as f64))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<CaseGuard, A::Error> {
                all(list).map(CaseGuard::Sides)
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<CaseGuard, A::Error> {
                const SIDES: [&str; 4] = ["left", "top", "right", "bottom"];
                let mut widths = [0.0; 4];
                let (mut along, mut width, mut n_sides) = (None, None, 0);
                while let Some(key) = map.next_key::<String>()? {
                    match key.as_str() {
                        "along" => {
                            along = Some(map.next_value::<Vec<Corner>>()?);
                            continue;
                        }
                        "width" => {
                            width = Some(map.next_value()?);
                            continue;
                        }
                        _ => n_sides += 1,
                    }
                    let width = widths.iter_mut().zip(SIDES).find(|(_, side)| *side == key);
                    let (width, _) = width.ok_or_else(|| {
                        de::Error::custom(format!("unknown side `{key}`, expected left, top, right or bottom"))
                    })?;
                    *width = map.next_value()?;
                }
                match (along, width, n_sides) {
                    (None, None, _) => {}
                    (Some(along), Some(width), 0) if along.len() > 1 => {
                        return Ok(CaseGuard::Along { along: pairs(along), width });
                    }
                    _ => {
                        return Err(de::Error::custom(
                            "a guard along a line needs along = [[x, y], ...] with two points or more, width, and no sides",
                        ));
                    }
                }
                let [left, top, right, bottom] = widths;
                Ok(CaseGuard::Rectangle { left, top, right, bottom })
            }
        }
        deserializer.deserialize_any(Widths)
    }
}
