//! Case files: what to correlate, what joint it is, what to find, as TOML. One kind of file for every command.
//!
//! [`CaseDocument`] is a file as it was read: the typed tree [`CaseFile`] with every section, and its text. A command
//! takes its view of it, which refuses sections of others: [`CaseDocument::correlation`], [`CaseDocument::joint`],
//! [`CaseDocument::run`].

mod camera;
mod crack_path;
mod document;
mod drives;
mod explain;
mod fields;
pub mod flags;
mod force;
mod guard;
mod joint;
mod law;
mod lists;
mod quantities;
mod reader;
mod reduction;
mod schema;
mod section;
mod setup;

pub use camera::{CaseCamera, CaseCameraError, parse_camera, read_camera, write_camera};
pub use crack_path::CrackPath;
pub use document::{CaseDocument, parse_case, read_case, read_document, write_case};
pub use drives::{CaseAppliedLoad, CaseHistory, CasePath, CasePathControl, CaseSupport, CaseTied};
pub use explain::{CaseError, CasePlace, CaseText, heading};
pub use fields::{CaseCorrelation, CaseElements, CaseImages, CaseInMm, CaseZone, Pages, Polygon, ZoneFlags};
pub use force::{CaseAxis, CaseDirection, CaseForce};
pub use guard::CaseGuard;
pub use joint::{
    BorderKind, BoundaryNoise, CaseBootstrap, CaseBoundary, CaseFit, CaseInterface, CaseJointMesh, CaseJointOutput,
    CaseMeasurement, CaseNodeGroup, CaseNodes, CaseRigidMotion, CaseTest, Discretisation, Intervals, WeightKind,
};
pub use law::{CaseCohesive, CaseExact, CaseMaterial, CaseSubstrate, EXACT, Kinematics, PlaneState, Quadrature, STD};
pub use quantities::{
    CaseCrack, CaseExtensometer, CaseLine, CaseLoad, CaseOpening, CaseProbe, CaseQuantities, CaseQuantityOptions,
    CaseRegion, CaseTension, CrackFlags, Decimal, ImageAxis,
};
pub use reader::Reader;
pub use reduction::{CaseLayout, CaseReduction};
pub use schema::{CaseLaws, LawKey, LawKeys, case_reference, case_schema, schema_of};
pub use section::{complete, over};
pub use setup::CaseReport;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Every section that a case file may have; what it does not say is `None` or empty, and left to the command line and
/// the defaults.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::case::parse_case;
/// let case = parse_case("images.deformed = 'shots/*.tif'\n[[zone]]\nroi = [10, 10, 90, 90]", "a/case.toml".as_ref())?;
/// assert_eq!(case.images.deformed, Some(vec!["shots/*.tif".to_owned()]));
/// assert_eq!(case.base, std::path::Path::new("a"));
/// # Ok::<(), quadrille::io::case::CaseError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[schemars(description = "Every section that a case file may have.")]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Folder of the case file: relative names in it are relative to this. Not written.
    #[serde(skip)]
    pub base: PathBuf,
    /// Which images.
    #[serde(default, skip_serializing_if = "is_default")]
    pub images: CaseImages,
    /// How the camera sees the plane of the specimen (docs/theory/22-camera.md). Without it no distortion is taken off,
    /// and the uncertainty of a usual lens is reckoned with.
    pub camera: Option<CaseCamera>,
    /// How to correlate.
    #[serde(default, skip_serializing_if = "is_default")]
    pub correlation: CaseCorrelation,
    /// Zones of the reference image, in order: what lies in all of rectangle, polygon and mask, and in no excluded
    /// polygon. One of `roi`, `polygon`, `exclude`, `mask`, `mesh` at least; without a zone the specimen is found
    /// in the reference.
    #[serde(rename = "zone", default, skip_serializing_if = "Vec::is_empty")]
    pub zones: Vec<CaseZone>,
    /// How quantities are drawn from the fields (docs/quantities.md).
    #[serde(default, skip_serializing_if = "is_default")]
    pub quantities: CaseQuantityOptions,
    /// What other instruments recorded.
    pub load: Option<CaseLoad>,
    /// Points whose displacement and strain are drawn.
    #[serde(rename = "probe", default, skip_serializing_if = "Vec::is_empty")]
    pub probes: Vec<CaseProbe>,
    /// Lines along which they are drawn.
    #[serde(rename = "line", default, skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<CaseLine>,
    /// Virtual extensometers: elongation and strain between two points, or two gauge lines across them.
    #[serde(rename = "extensometer", default, skip_serializing_if = "Vec::is_empty")]
    pub extensometers: Vec<CaseExtensometer>,
    /// Regions: mean displacement and strain, and how they vary.
    #[serde(rename = "region", default, skip_serializing_if = "Vec::is_empty")]
    pub regions: Vec<CaseRegion>,
    /// Opening and sliding between two zones.
    #[serde(rename = "opening", default, skip_serializing_if = "Vec::is_empty")]
    pub openings: Vec<CaseOpening>,
    /// A bar under tension or compression: constants of its material from `[load]` and its gauges
    /// (docs/quantities.md).
    pub tension: Option<CaseTension>,
    /// A test of the standards, reduced to J, energy release rates and a traction by `quadrille reduce`
    /// (docs/reduction.md).
    pub reduction: Option<CaseReduction>,
    /// What the program cannot know of the test, for the reporting table of `report.html`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub report: CaseReport,
    /// Cracks and joints: paths along which the mesh is cut, given or found, with opening, sliding, tip and stress
    /// intensity along them.
    #[serde(rename = "crack", default, skip_serializing_if = "Vec::is_empty")]
    pub cracks: Vec<CaseCrack>,
    /// Where the adhesive is in the images: between two zones.
    pub interface: Option<CaseInterface>,
    /// The mesh of the joint: a file, a correlation run, or a rectangle (`element_size_mm`, `columns`, `rows`,
    /// `gap_mm`). In `quadrille run` only `refine` can be given.
    pub mesh: Option<CaseJointMesh>,
    /// Groups of nodes whose reaction is given, by name: a condition on the position in mm, such as `grip = "y = max
    /// and x < 2.5"` (`=`, `<`, `<=`, `>`, `>=`; `min` and `max` of the mesh), or a list of node numbers. Default:
    /// those of the mesh file, or the prescribed nodes of each strip.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(with = "BTreeMap<String, joint::NodeGroupKey>")]
    pub groups: BTreeMap<String, CaseNodeGroup>,
    /// The prescribed displacements of the border: `file` or `store`; in `quadrille run` neither.
    pub boundary: Option<CaseBoundary>,
    /// Prescribed displacements of groups of nodes, by component; with `[boundary]` or instead of it.
    #[serde(rename = "support", default, skip_serializing_if = "Vec::is_empty")]
    pub supports: Vec<CaseSupport>,
    /// Forces on groups of nodes; they keep their direction.
    #[serde(rename = "applied_load", default, skip_serializing_if = "Vec::is_empty")]
    pub applied_loads: Vec<CaseAppliedLoad>,
    /// How the history of border, supports and loads is followed; for `quadrille simulate` only.
    pub path: Option<CasePath>,
    /// The material of the strips (docs/mechanics.md). `[substrate.NAME]`: that of the group `NAME` of elements.
    #[schemars(with = "Option<CaseMaterial>")]
    pub substrate: Option<CaseSubstrate>,
    /// The law of the adhesive (docs/mechanics.md). Parameters that are not fitted keep these values.
    pub cohesive: Option<CaseCohesive>,
    /// Tests of one adhesive that are fitted together (docs/identification.md). The file also has `[fit]` and, over
    /// those of the tests, `[cohesive]`.
    #[serde(rename = "test", default, skip_serializing_if = "Vec::is_empty")]
    pub tests: Vec<CaseTest>,
    /// What is written of a computed joint.
    pub output: Option<CaseJointOutput>,
    /// The displacements to fit: `file` or `store`; in `quadrille run` neither.
    pub measurement: Option<CaseMeasurement>,
    /// The load cell (docs/identification.md): fitted with the displacements or alone; with `use = false`, or without
    /// a fit, compared with the prediction.
    pub force: Option<CaseForce>,
    /// What is fitted, from where, and the uncertainties of constants (docs/identification.md).
    pub fit: Option<CaseFit>,
    /// Record of a finished run; read over.
    #[schemars(with = "Option<serde_json::Map<String, serde_json::Value>>")]
    pub run: Option<toml::Table>,
}

impl CaseFile {
    /// `name` of this case file as a path: relative names start at the folder of the case file.
    pub fn resolve(&self, name: &str) -> PathBuf {
        self.base.join(name)
    }

    /// What this case draws from the fields, with the load files as paths that start at the current folder.
    pub fn drawn(&self) -> CaseQuantities {
        let path = |name: &String| self.resolve(name).display().to_string();
        let load = |load: &CaseLoad| CaseLoad {
            file: if load.file.is_empty() { String::new() } else { path(&load.file) },
            frame_times: load.frame_times.as_ref().map(path),
            ..load.clone()
        };
        CaseQuantities {
            options: self.quantities.clone(),
            load: self.load.as_ref().map(load),
            probes: self.probes.clone(),
            lines: self.lines.clone(),
            extensometers: self.extensometers.clone(),
            regions: self.regions.clone(),
            openings: self.openings.clone(),
            cracks: self.cracks.clone(),
            tension: self.tension.clone(),
        }
    }

    /// This case with other quantities.
    pub fn with_drawn(self, drawn: &CaseQuantities) -> Self {
        let CaseQuantities { options, load, probes, lines, extensometers, regions, openings, cracks, tension } =
            drawn.clone();
        Self { quantities: options, load, probes, lines, extensometers, regions, openings, cracks, tension, ..self }
    }
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}
