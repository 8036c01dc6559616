//! The sections of a joint: its interface, mesh, border, output, measurement and fit.

use super::is_default;
use super::law::CaseExact;
use super::lists::{lower_upper, name};
use schemars::JsonSchema;
use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::fmt;

/// Where the adhesive is in the images: between two zones.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseInterface {
    /// The two zones at the adhesive; the normal points from the first to the second. Of two zones one below the other
    /// the first is the lower one. A case without `[[zone]]` has both found in the reference image: two strips with a
    /// band without texture between them; of upright ones the first is at the left.
    #[serde(default = "lower_and_upper", deserialize_with = "lower_upper")]
    pub zones: [String; 2],
    /// Pixels this close to the facing edges are left out, px, unless the zone has a `guard_px`.
    #[schemars(extend("default" = 3))]
    pub guard_px: Option<f64>,
    /// Thickness of the adhesive, mm. Default: the gap between the facing edges; a value that differs by more than 2 %
    /// is refused.
    pub thickness_mm: Option<f64>,
}

fn lower_and_upper() -> [String; 2] {
    ["lower", "upper"].map(str::to_owned)
}

/// Nodes with a name, whose reaction is given.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum CaseNodeGroup {
    /// Conditions on the position, as `y = max and x < 2.5`.
    Where(String),
    /// Numbers of nodes of the mesh file, from 0.
    List(Vec<u32>),
}

/// What a case file holds for [`CaseNodeGroup`].
#[derive(JsonSchema)]
#[serde(untagged)]
#[expect(dead_code, reason = "it is there for its schema")]
pub(super) enum NodeGroupKey {
    Where(String),
    List(Vec<u32>),
}

impl<'de> Deserialize<'de> for CaseNodeGroup {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Group;
        impl<'de> Visitor<'de> for Group {
            type Value = CaseNodeGroup;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a condition such as \"y = max\" or a list of numbers")
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<CaseNodeGroup, E> {
                Ok(CaseNodeGroup::Where(text.to_owned()))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<CaseNodeGroup, A::Error> {
                Vec::deserialize(de::value::SeqAccessDeserializer::new(list)).map(CaseNodeGroup::List)
            }
        }
        deserializer.deserialize_any(Group)
    }
}

/// The mesh of the joint: a file, a correlation run, or a rectangle (`element_size_mm`, `columns`, `rows`, `gap_mm`).
/// In `quadrille run` only `refine` can be given.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseJointMesh {
    /// A mesh file: JSON, Gmsh `.msh`, or `.vtu`.
    pub file: Option<String>,
    /// Store `fields.zarr`, or folder, of a correlation run with two zones.
    pub store: Option<String>,
    /// The two groups of elements at the adhesive; the normal points from the first to the second. Default: up.
    pub zones: Option<[String; 2]>,
    /// Side of the square elements, mm.
    pub element_size_mm: Option<f64>,
    /// Elements along the joint.
    pub columns: Option<usize>,
    /// Rows of elements in each strip.
    pub rows: Option<usize>,
    /// Distance of the faces, mm.
    pub gap_mm: Option<f64>,
    /// Where the joint is cracked from the beginning: a condition as in `[groups]`, such as `"x < 30"`. Faces there
    /// only press on each other, without friction.
    pub crack: Option<String>,
    /// Cut every element into this many by as many.
    #[schemars(extend("default" = 1))]
    pub refine: Option<usize>,
}

/// The prescribed displacements of the border: `file` or `store`; in `quadrille run` neither.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseBoundary {
    /// Table of displacements, mm, y up: `instant,node,x_mm,y_mm,ux_mm,uy_mm`.
    pub file: Option<String>,
    /// The store of a correlation run: its outer nodes are prescribed.
    pub store: Option<String>,
    /// Names of `[groups]` whose part of the border is free of forces: sides, holes. All other outer nodes are
    /// prescribed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub free: Vec<String>,
    /// The rigid motion that is subtracted at every instant.
    #[schemars(extend("default" = "none"))]
    pub remove_rigid_motion: Option<CaseRigidMotion>,
}

/// Which rigid motion is taken off the border of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CaseRigidMotion {
    /// None.
    #[default]
    None,
    /// That of all prescribed nodes together.
    Overall,
}

/// What is written of a computed joint.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseJointOutput {
    /// Instants to draw, from 1. Default: first, middle, last.
    pub figures: Option<Vec<usize>>,
    /// Whether the energies are computed. Default: up to 20000 unknowns.
    pub energies: Option<bool>,
    /// Also derivatives of the displacements by the parameters of the strips.
    #[serde(default, skip_serializing_if = "is_default")]
    #[schemars(extend("default" = false))]
    pub substrate_sensitivities: bool,
}

/// The displacements to fit: `file` or `store`; in `quadrille run` neither.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseMeasurement {
    /// Table of displacements: `instant,node,ux_mm,uy_mm`, or `ux_px,uy_px` with y up.
    pub file: Option<String>,
    /// The store of the correlation run of the mesh.
    pub store: Option<String>,
    /// Which nodes are compared; numbers count from 0. Default: `selected` if the mesh file has that list, else
    /// `free`.
    #[schemars(with = "Option<NodesKey>")]
    pub nodes: Option<CaseNodes>,
    /// Weights of the residual. Default: `covariance` for a store, `paper` for a table.
    pub weights: Option<WeightKind>,
    /// What is known of the prescribed displacements. Default of one body that a run has measured: `estimated`.
    #[schemars(extend("default" = "measured"))]
    pub boundary: Option<BoundaryNoise>,
    /// Whether a noisy border is smoothed before it is prescribed.
    #[schemars(extend("default" = "auto"))]
    pub border: Option<BorderKind>,
    /// Standard deviation of a nodal displacement of one frame, mm. Default: that of the store; for a table, from the
    /// residual.
    pub noise_mm: Option<f64>,
    /// Relative standard uncertainty of the noise. Default: 0.1, or by the residual if the noise is estimated from it.
    pub noise_relative_std: Option<f64>,
    /// Whether all frames were compared with one noisy reference.
    #[schemars(extend("default" = true))]
    pub common_reference: Option<bool>,
    /// Scale of a table in pixels, mm per pixel.
    pub pixel_size_mm: Option<f64>,
    /// Factor on the weight of each instant, from the first; 0 leaves an instant out.
    pub instant_weights: Option<Vec<f64>>,
}

/// Which nodes are compared.
#[derive(Debug, Clone, PartialEq)]
pub enum CaseNodes {
    /// The list of the mesh file.
    Selected,
    /// All that are not prescribed.
    Free,
    /// Numbers of nodes, from 0.
    List(Vec<u32>),
}

/// What a case file holds for [`CaseNodes`].
#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
pub(super) enum NodesKey {
    Word(NodesWord),
    List(Vec<u32>),
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum NodesWord {
    /// Those of the list `selected_nodes` of the mesh file.
    Selected,
    /// All that are not prescribed.
    Free,
}

impl Serialize for CaseNodes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Selected => NodesKey::Word(NodesWord::Selected),
            Self::Free => NodesKey::Word(NodesWord::Free),
            Self::List(list) => NodesKey::List(list.clone()),
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for CaseNodes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Nodes;
        impl<'de> Visitor<'de> for Nodes {
            type Value = CaseNodes;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"selected\", \"free\" or a list of numbers")
            }

            fn visit_str<E: de::Error>(self, word: &str) -> Result<CaseNodes, E> {
                NodesWord::deserialize(de::value::StrDeserializer::new(word)).map(|word| match word {
                    NodesWord::Selected => CaseNodes::Selected,
                    NodesWord::Free => CaseNodes::Free,
                })
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<CaseNodes, A::Error> {
                Vec::deserialize(de::value::SeqAccessDeserializer::new(list)).map(CaseNodes::List)
            }
        }
        deserializer.deserialize_any(Nodes)
    }
}

/// Weights of the residual of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WeightKind {
    /// Of each instant and component, by the largest displacement without rigid motion.
    Paper,
    /// One for all.
    Uniform,
    /// The inverse covariance of the residual.
    Covariance,
}

impl WeightKind {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Uniform => "uniform",
            Self::Covariance => "covariance",
        }
    }
}

/// What is known of the prescribed displacements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BoundaryNoise {
    /// Noisy, and prescribed as they are.
    #[default]
    Measured,
    /// Noisy, and unknowns of the fit; needs `weights = "covariance"`.
    Estimated,
    /// Without noise.
    Exact,
}

impl fmt::Display for BoundaryNoise {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Measured => "measured",
            Self::Estimated => "estimated",
            Self::Exact => "exact",
        })
    }
}

/// Whether a noisy border is smoothed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BorderKind {
    /// Smooth where the data ask for it and what is left is noise.
    #[default]
    Auto,
    /// Smooth, whatever is left; needs a known noise.
    Smooth,
    /// Every node as it was measured.
    Free,
}

/// One of several tests that are fitted together.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseTest {
    /// Its name in results. Default: the folder of its case file by which it differs from the others.
    #[serde(default, deserialize_with = "name")]
    pub name: Option<String>,
    /// Its case file, as for `quadrille identify`, or the folder of a `quadrille run`. Of its `[fit]` only errors of
    /// the set-up count (`thickness_mm_std`, `exact`, ...).
    pub case: String,
}

/// What is fitted, from where, and what is stated of its error.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseFit {
    /// Symbols of the fitted parameters, of the law of `[cohesive]`.
    pub parameters: Vec<String>,
    /// Starting values, by symbol. Default: those of `[cohesive]`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub start: BTreeMap<String, f64>,
    /// Least values, by symbol. Default: a thousandth of the start.
    #[serde(default, skip_serializing_if = "is_default")]
    pub lower: BTreeMap<String, f64>,
    /// Largest values, by symbol. Default: a thousand times the start.
    #[serde(default, skip_serializing_if = "is_default")]
    pub upper: BTreeMap<String, f64>,
    /// Further starts: a value for each of `parameters`, in their order.
    #[serde(default, skip_serializing_if = "is_default")]
    pub starts: Vec<Vec<f64>>,
    /// Folder of `quadrille reduce`: the law that follows its traction is a further start, and the fitted law is compared
    /// with it.
    pub direct: Option<String>,
    /// Number of further starts, 1 to 1000, spread over the box of the bounds, which are then required.
    pub latin_hypercube: Option<usize>,
    /// Seed of these starts.
    #[schemars(extend("default" = 1))]
    pub seed: Option<u64>,
    /// Forward runs that one start may take.
    #[schemars(extend("default" = 100))]
    pub max_evaluations: Option<usize>,
    /// Time after which the fit ends at the best point so far, s; what that costs stands in its verdict. Without it
    /// there is no limit.
    pub max_seconds: Option<f64>,
    /// Also the profile likelihood of this parameter.
    pub profile: Option<String>,
    /// Experimental: also other laws on the same data, compared with each other: names as of `[cohesive] model`, two
    /// or more. Those that `[cohesive]` does not start begin with its strengths and works of separation.
    #[schemars(extend("x-flag" = "--tournament"))]
    #[serde(default, skip_serializing_if = "is_default")]
    pub laws: Vec<String>,
    /// Effect of the element size on the 95 % intervals. Default: `included` for a store, `stated` for a table.
    pub discretisation: Option<Discretisation>,
    /// What the 95 % intervals are made of.
    #[schemars(extend("default" = "auto"))]
    pub intervals: Option<Intervals>,
    /// Draws of the bootstrap that goes with profile intervals, up to 10000; 0 for none.
    #[schemars(with = "Option<BootstrapKey>", extend("default" = "auto"))]
    pub bootstrap: Option<CaseBootstrap>,
    /// Standard uncertainty of the adhesive's thickness, mm. Default: 1 px.
    pub thickness_mm_std: Option<f64>,
    /// Relative standard uncertainty of the pixel size. Default: 0.005.
    pub pixel_size_relative_std: Option<f64>,
    /// Standard uncertainty of the position of each face of the adhesive, px. Default: 0.5.
    pub face_position_px_std: Option<f64>,
    /// The same in mm; one of both.
    pub face_position_mm_std: Option<f64>,
    /// Constants without uncertainty: `true`, or a list of `"thickness"`, `"faces"`, `"pixel_size"`, `"noise_level"`,
    /// `"width"`, `"camera"`; `"rotations"` if the data were computed with small ones.
    #[schemars(extend("default" = false))]
    pub exact: Option<CaseExact>,
    /// Values of the case that are meant although hardly anything has them: `"E"`, `"nu"`, `"sigma_0"`, `"alpha"`,
    /// `"n"`, `"pixel_size"`, `"thickness"`. Else what is off by a thousand is refused.
    #[serde(default, skip_serializing_if = "is_default")]
    pub meant: Vec<String>,
    /// Of several tests: constants with one error in all tests, such as `"E"` or `"pixel_size"`. Default: those of the
    /// strips that agree in value and uncertainty.
    pub shared: Option<Vec<String>>,
    /// Of `quadrille identify --sweep`: a parameter that is not fitted, and its values.
    #[serde(default, skip_serializing_if = "is_default")]
    pub sweep: BTreeMap<String, Vec<f64>>,
}

/// The effect of the element size on the 95 % intervals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Discretisation {
    /// In the intervals.
    Included,
    /// Beside them.
    Stated,
    /// Not computed.
    Off,
}

impl Discretisation {
    /// Its name in case files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Included => "included",
            Self::Stated => "stated",
            Self::Off => "off",
        }
    }
}

/// What the 95 % intervals are made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Intervals {
    /// The profile likelihood where linear theory is in doubt.
    #[default]
    Auto,
    /// Linear theory.
    Linear,
    /// The profile likelihood.
    Profile,
}

/// Draws of the bootstrap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CaseBootstrap {
    /// The usual number.
    #[default]
    Auto,
    /// This many; 0 for none.
    Draws(u64),
}

/// What a case file holds for [`CaseBootstrap`].
#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
pub(super) enum BootstrapKey {
    Word(BootstrapWord),
    Draws(u64),
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum BootstrapWord {
    /// The usual number, 24.
    Auto,
}

impl Serialize for CaseBootstrap {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => BootstrapKey::Word(BootstrapWord::Auto),
            Self::Draws(draws) => BootstrapKey::Draws(*draws),
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for CaseBootstrap {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Draws;
        impl Visitor<'_> for Draws {
            type Value = CaseBootstrap;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"auto\" or a number of draws from 0 to 10000")
            }

            fn visit_str<E: de::Error>(self, word: &str) -> Result<CaseBootstrap, E> {
                BootstrapWord::deserialize(de::value::StrDeserializer::new(word))
                    .map(|BootstrapWord::Auto| CaseBootstrap::Auto)
            }

            fn visit_i64<E: de::Error>(self, draws: i64) -> Result<CaseBootstrap, E> {
                let wrong = |_| E::invalid_value(de::Unexpected::Signed(draws), &self);
                u64::try_from(draws).map(CaseBootstrap::Draws).map_err(wrong)
            }
        }
        deserializer.deserialize_any(Draws)
    }
}
