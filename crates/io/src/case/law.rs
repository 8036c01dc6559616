//! The sections `[substrate]` and `[cohesive]`: words that every law takes, and numbers whose keys the law says.

use super::lists::all;
use schemars::JsonSchema;
use serde::de::{self, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// Keys of `[substrate]` and `[cohesive]` that state the standard uncertainty of a value are that of the value and
/// this.
pub const STD: &str = "_std";
/// Key of `[substrate]`, `[cohesive]` and `[fit]` that names constants without uncertainty.
pub const EXACT: &str = "exact";

/// The material of the strips, and those of groups of elements.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct CaseSubstrate {
    /// Of every group without a section of its own.
    #[serde(flatten)]
    pub common: CaseMaterial,
    /// `[substrate.NAME]`: of the group `NAME` of the mesh.
    #[serde(flatten)]
    pub groups: BTreeMap<String, CaseMaterial>,
}

impl CaseSubstrate {
    /// Places of those of `groups` that have no section of their own.
    pub fn without_own(&self, groups: &[String]) -> Vec<usize> {
        groups.iter().enumerate().filter(|(_, name)| !self.groups.contains_key(*name)).map(|(place, _)| place).collect()
    }
}

/// One material.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
pub struct CaseMaterial {
    /// The law of the material.
    #[schemars(extend("default" = "ramberg-osgood"))]
    pub model: Option<String>,
    /// What happens out of the plane. Default of `[substrate.NAME]`: that of `[substrate]`.
    #[schemars(extend("default" = "stress"))]
    pub plane: Option<PlaneState>,
    /// Constants without uncertainty: `true` for all of the section, or a list of symbols.
    #[schemars(extend("default" = false))]
    pub exact: Option<CaseExact>,
    /// Of `tabulated`: file of the uniaxial curve, columns `strain` (mm/mm) and `stress_MPa`.
    pub file: Option<String>,
    /// The same as rows of strain and stress, MPa, both rising.
    pub curve: Option<Vec<[f64; 2]>>,
    /// The parameters of the law, and their standard uncertainties, by key: the symbol with its unit, as in `E_MPa`.
    #[serde(flatten)]
    pub values: BTreeMap<String, f64>,
}

/// The law of the adhesive.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
pub struct CaseCohesive {
    /// The law.
    #[schemars(extend("default" = "extended-xu-needleman"))]
    pub model: Option<String>,
    /// What counts as jump between faces that are a distance apart, and whether rotations are small.
    #[schemars(extend("default" = "paper"))]
    pub kinematics: Option<Kinematics>,
    /// Where the tractions of an interface element are summed.
    #[schemars(extend("default" = "newton-cotes"))]
    pub quadrature: Option<Quadrature>,
    /// Constants without uncertainty: `true` for all of the section, or a list of symbols.
    #[schemars(extend("default" = false))]
    pub exact: Option<CaseExact>,
    /// The parameters of the law, and their standard uncertainties, by key: the symbol with its unit, as in
    /// `delta_n_mm`.
    #[serde(flatten)]
    pub values: BTreeMap<String, f64>,
}

/// What happens out of the plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub enum PlaneState {
    /// No stress out of the plane: thin strips, free surfaces.
    #[default]
    #[serde(rename = "stress")]
    PlaneStress,
    /// No strain out of the plane: the middle of thick strips.
    #[serde(rename = "strain")]
    PlaneStrain,
}

impl PlaneState {
    /// Its name in case files.
    pub fn name(self) -> &'static str {
        match self {
            Self::PlaneStress => "stress",
            Self::PlaneStrain => "strain",
        }
    }
}

/// What counts as jump between faces that are a distance apart, and whether rotations are small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Kinematics {
    /// Upper minus lower displacement: a rotation `w` of the joint gives `-w t` of sliding, t the distance of the
    /// faces.
    #[default]
    Paper,
    /// Less what the rotation of the mid-line contributes.
    Objective,
    /// Strips and joint may turn by any angle; a rotation gives neither stress nor traction.
    Finite,
}

impl Kinematics {
    /// Its name in case files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Objective => "objective",
            Self::Finite => "finite",
        }
    }

    /// Whether rotations are taken as infinitesimal.
    pub fn is_small(self) -> bool {
        self != Self::Finite
    }
}

/// Where the tractions of an interface element are summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Quadrature {
    /// At its two ends: every node pair for itself.
    #[default]
    NewtonCotes,
    /// At the two Gauss points.
    Gauss,
}

impl Quadrature {
    /// Its name in case files.
    pub fn name(self) -> &'static str {
        match self {
            Self::NewtonCotes => "newton-cotes",
            Self::Gauss => "gauss",
        }
    }
}

/// Which constants of a section have no uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum CaseExact {
    /// All of the section, or none.
    All(bool),
    /// Those of these names.
    Names(Vec<String>),
}

impl<'de> Deserialize<'de> for CaseExact {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Exact;
        impl<'de> Visitor<'de> for Exact {
            type Value = CaseExact;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("true for all of the section, or a list of names in quotes")
            }

            fn visit_bool<E: de::Error>(self, all: bool) -> Result<CaseExact, E> {
                Ok(CaseExact::All(all))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<CaseExact, A::Error> {
                all(list).map(CaseExact::Names)
            }
        }
        deserializer.deserialize_any(Exact)
    }
}

impl<'de> Deserialize<'de> for CaseCohesive {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Cohesive;
        impl<'de> Visitor<'de> for Cohesive {
            type Value = CaseCohesive;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a section")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<CaseCohesive, A::Error> {
                let mut found = CaseCohesive::default();
                while let Some(key) = map.next_key::<String>()? {
                    match key.as_str() {
                        "model" => found.model = Some(map.next_value()?),
                        "kinematics" => found.kinematics = Some(map.next_value()?),
                        "quadrature" => found.quadrature = Some(map.next_value()?),
                        EXACT => found.exact = Some(map.next_value()?),
                        _ => drop(found.values.insert(key, map.next_value()?)),
                    }
                }
                Ok(found)
            }
        }
        deserializer.deserialize_any(Cohesive)
    }
}

impl<'de> Deserialize<'de> for CaseSubstrate {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Materials { groups: true })
    }
}

impl<'de> Deserialize<'de> for CaseMaterial {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Materials { groups: false }).map(|CaseSubstrate { common, .. }| common)
    }
}

/// A material, with sections of groups where there may be some.
struct Materials {
    groups: bool,
}

impl<'de> Visitor<'de> for Materials {
    type Value = CaseSubstrate;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a section")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<CaseSubstrate, A::Error> {
        let mut found = CaseSubstrate::default();
        let CaseSubstrate { common, groups } = &mut found;
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "model" => common.model = Some(map.next_value()?),
                "plane" => common.plane = Some(map.next_value()?),
                EXACT => common.exact = Some(map.next_value()?),
                "file" => common.file = Some(map.next_value()?),
                "curve" => common.curve = Some(map.next_value()?),
                _ if !self.groups => drop(common.values.insert(key, map.next_value()?)),
                _ => match map.next_value()? {
                    NumberOrGroup::Number(value) => drop(common.values.insert(key, value)),
                    NumberOrGroup::Group(material) => drop(groups.insert(key, material)),
                },
            }
        }
        Ok(found)
    }
}

enum NumberOrGroup {
    Number(f64),
    Group(CaseMaterial),
}

impl<'de> Deserialize<'de> for NumberOrGroup {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = NumberOrGroup;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number")
            }

            fn visit_f64<E: de::Error>(self, value: f64) -> Result<NumberOrGroup, E> {
                Ok(NumberOrGroup::Number(value))
            }

            fn visit_i64<E: de::Error>(self, value: i64) -> Result<NumberOrGroup, E> {
                Ok(NumberOrGroup::Number(value as f64))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<NumberOrGroup, A::Error> {
                CaseMaterial::deserialize(de::value::MapAccessDeserializer::new(map)).map(NumberOrGroup::Group)
            }
        }
        deserializer.deserialize_any(Either)
    }
}
