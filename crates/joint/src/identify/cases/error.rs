//! Why parameters cannot be fitted.

use crate::io::case::{CasePlace, CaseText, heading};
use crate::mechanics::cohesive::LawError;
use crate::mechanics::substrate::SubstrateError;
use crate::mechanics::{BoundaryFault, JointError, ModelError};
use std::path::PathBuf;
use thiserror::Error;

/// Why parameters cannot be fitted. Not converging is no error: the best point is kept.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FitError {
    /// A key that is missing or cannot be used.
    #[error("{} {what}", heading(section))]
    Key {
        /// The section.
        section: &'static str,
        /// The key.
        key: String,
        /// What is wrong, and what to do.
        what: String,
    },
    /// Something about a key or a section of the case file, with its place.
    #[error("{place}: {error}")]
    InCase {
        /// Where.
        place: CasePlace,
        /// What.
        error: Box<FitError>,
    },
    /// Data that cannot be fitted to: none, too few, or not those of the joint.
    #[error("{0}")]
    Data(String),
    /// A start outside the bounds.
    #[error("[fit] the start {name} = {start} lies outside its bounds {lower} to {upper}; move one of them")]
    StartOutside {
        /// The parameter.
        name: &'static str,
        /// Its start.
        start: f64,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
    /// No start has a solution.
    #[error("the fit cannot start at {start}: {reason}")]
    NoStart {
        /// The start.
        start: String,
        /// Why.
        reason: String,
    },
    /// A covariance without inverse.
    #[error("the covariance of the measurement has no inverse (row {row}); give weights = \"uniform\"")]
    Covariance {
        /// The row or node.
        row: usize,
    },
    /// Derivatives that are not finite.
    #[error("the derivatives of the objective are not finite; start elsewhere")]
    NotFinite,
    /// The forward model failed where it had not before.
    #[error("the forward model has no solution where the fit ended; give narrower bounds")]
    Lost,
    /// Something about one of several tests.
    #[error("test \"{name}\": {error}")]
    InTest {
        /// The test.
        name: String,
        /// What.
        error: Box<FitError>,
    },
    /// Tests of different laws.
    #[error("tests \"{first}\" and \"{second}\" do not have the same law: {what}; one law is fitted to all tests: give it in [cohesive] of {}, or the same in both", path.display())]
    LawsDiffer {
        /// The case that names the tests.
        path: PathBuf,
        /// A test.
        first: String,
        /// One with another law.
        second: String,
        /// In what they differ.
        what: String,
    },
    /// A law that refuses its values.
    #[error(transparent)]
    Law(#[from] LawError),
    /// A material that refuses its values.
    #[error(transparent)]
    Substrate(#[from] SubstrateError),
    /// A joint that cannot be made.
    #[error(transparent)]
    Joint(#[from] JointError),
    /// A forward run that cannot be made.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Prescribed displacements that cannot be used.
    #[error("estimated boundary: {0}")]
    Boundary(BoundaryFault),
}

impl FitError {
    /// The same with its place in the case file, where it is about a key or a section of that.
    pub(crate) fn in_case(self, text: &CaseText) -> Self {
        let place = match &self {
            Self::Key { section, key, .. } => Some((*section, Some(key.as_str()))),
            Self::StartOutside { name, .. } => Some(("fit.start", Some(*name))),
            Self::Joint(error) => error.place(),
            _ => None,
        };
        match place.map(|(section, key)| text.place(section, key)) {
            Some(place) => Self::InCase { place, error: Box::new(self) },
            None => self,
        }
    }
}

pub(crate) fn check_amount(n_data: usize, n_parameters: usize) -> Result<(), FitError> {
    match n_data < n_parameters {
        false => Ok(()),
        true => Err(FitError::Data(format!(
            "{n_data} measured numbers cannot determine {n_parameters} parameters; measure more nodes or instants, or fit fewer"
        ))),
    }
}

/// `key` of `section` cannot be used; `what` begins with the key.
pub(crate) fn wrong(section: &'static str, key: &str, what: impl Into<String>) -> FitError {
    FitError::Key { section, key: key.to_owned(), what: what.into() }
}

/// The same where `is_wrong`.
pub(crate) fn refuse_if(
    is_wrong: bool,
    section: &'static str,
    key: &str,
    what: impl Into<String>,
) -> Result<(), FitError> {
    if is_wrong { Err(wrong(section, key, what)) } else { Ok(()) }
}

/// Positive and finite, or a clear line.
pub(crate) fn positive(section: &'static str, key: &str, value: f64) -> Result<f64, FitError> {
    let what = || format!("{key} = {value}: it must be a finite number above zero");
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(wrong(section, key, what())) }
}
