//! The path of a crack, in the forms that a case file may give it.

use super::lists::{Corner, all, pairs};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use serde::{Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// Where a crack is.
#[derive(Debug, Clone, PartialEq)]
pub enum CrackPath {
    /// Along these points in order, px of the reference image.
    Along(Vec<[f64; 2]>),
    /// Where it is found, in the residual of the images.
    Auto,
}

impl CrackPath {
    /// What stands for [`CrackPath::Auto`] in files and on the command line.
    pub const AUTO: &str = "auto";

    /// The points; none before they are found.
    pub fn points(&self) -> Option<&[[f64; 2]]> {
        match self {
            Self::Along(points) => Some(points),
            Self::Auto => None,
        }
    }
}

impl Default for CrackPath {
    fn default() -> Self {
        Self::Along(Vec::new())
    }
}

impl Serialize for CrackPath {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Along(points) => points.serialize(serializer),
            Self::Auto => Self::AUTO.serialize(serializer),
        }
    }
}

impl JsonSchema for CrackPath {
    fn schema_name() -> Cow<'static, str> {
        "CrackPath".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let points = generator.subschema_for::<Vec<[f64; 2]>>();
        json_schema!({ "anyOf": [points, { "type": "string", "const": Self::AUTO }] })
    }

    fn inline_schema() -> bool {
        true
    }
}

impl<'de> Deserialize<'de> for CrackPath {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Points;
        impl<'de> Visitor<'de> for Points {
            type Value = CrackPath;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a list of points [[x, y], [x, y]], or \"auto\"")
            }

            fn visit_str<E: de::Error>(self, word: &str) -> Result<CrackPath, E> {
                match word {
                    CrackPath::AUTO => Ok(CrackPath::Auto),
                    _ => Err(de::Error::invalid_value(de::Unexpected::Str(word), &self)),
                }
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<CrackPath, A::Error> {
                all::<Corner, A>(list).map(|points| CrackPath::Along(pairs(points)))
            }
        }
        deserializer.deserialize_any(Points)
    }
}
