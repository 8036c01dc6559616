//! From a case file to a problem.

pub(crate) mod case;
pub(crate) mod error;
pub(crate) mod options;
pub(crate) mod uncertainties;
