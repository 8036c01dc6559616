//! The sections of a case file that describe a joint, what was measured on it, and what is to be found.

use crate::case::{
    CaseAppliedLoad, CaseBoundary, CaseCohesive, CaseDocument, CaseError, CaseFit, CaseForce, CaseJointMesh,
    CaseJointOutput, CaseMeasurement, CaseNodeGroup, CasePath, CaseSubstrate, CaseSupport, CaseText, Reader,
    read_document,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What `quadrille simulate` and `quadrille identify` take of a case file; what it does not say is `None`.
#[derive(Debug, Clone, PartialEq)]
pub struct JointCase {
    /// Folder of the case file: relative names in it are relative to this.
    pub base: PathBuf,
    /// Its text: where its keys stand.
    pub text: CaseText,
    /// The section `[mesh]`.
    pub mesh: CaseJointMesh,
    /// The section `[groups]`.
    pub groups: BTreeMap<String, CaseNodeGroup>,
    /// The section `[boundary]`; says nothing where supports stand for it.
    pub boundary: CaseBoundary,
    /// The sections `[[support]]`.
    pub supports: Vec<CaseSupport>,
    /// The sections `[[applied_load]]`.
    pub applied_loads: Vec<CaseAppliedLoad>,
    /// The section `[path]`.
    pub path: CasePath,
    /// The section `[substrate]`, with `[substrate.NAME]` where groups of elements have their own material.
    pub substrate: CaseSubstrate,
    /// The section `[cohesive]`.
    pub cohesive: CaseCohesive,
    /// The section `[output]`.
    pub output: CaseJointOutput,
    /// The section `[measurement]`: displacements that the parameters are fitted to.
    pub measurement: Option<CaseMeasurement>,
    /// The section `[force]`.
    pub force: Option<CaseForce>,
    /// The section `[fit]`.
    pub fit: Option<CaseFit>,
}

impl CaseDocument {
    /// What the computation of a joint takes of it.
    ///
    /// # Errors
    /// A section for another command, one that is missing.
    pub fn joint(self) -> Result<JointCase, CaseError> {
        self.taken_by(Reader::Joint)?;
        let Self { case, text, .. } = self;
        let missing = |section, hint| CaseError::Missing(text.path().to_owned(), section, hint);
        Ok(JointCase {
            base: case.base,
            mesh: case
                .mesh
                .ok_or_else(|| missing("mesh", "give file = \"mesh.json\" or store = \"run/fields.zarr\""))?,
            groups: case.groups,
            boundary: match case.boundary {
                Some(boundary) => boundary,
                None if !case.supports.is_empty() => CaseBoundary::default(),
                None => {
                    let hint = "give file = \"displacements.csv\" or store = \"run/fields.zarr\", or [[support]]";
                    return Err(missing("boundary", hint));
                }
            },
            supports: case.supports,
            applied_loads: case.applied_loads,
            path: case.path.unwrap_or_default(),
            substrate: case.substrate.ok_or_else(|| missing("substrate", LAW))?,
            // One body: where it is more than that, the joint says so.
            cohesive: case
                .cohesive
                .unwrap_or_else(|| CaseCohesive { model: Some(NO_ADHESIVE.to_owned()), ..CaseCohesive::default() }),
            output: case.output.unwrap_or_default(),
            measurement: case.measurement,
            force: case.force,
            fit: case.fit,
            text,
        })
    }
}

/// The law of one body without an adhesive.
pub(crate) const NO_ADHESIVE: &str = "none";

/// What is said of a missing `[substrate]` or `[cohesive]`.
pub(crate) const LAW: &str = "see docs/mechanics.md for its keys";

/// Reads the case file `path`.
///
/// # Errors
/// A file that cannot be read, that is not TOML, or that has a key that such a file does not have.
pub fn read_joint_case(path: &Path) -> Result<JointCase, CaseError> {
    read_document(path)?.joint()
}
