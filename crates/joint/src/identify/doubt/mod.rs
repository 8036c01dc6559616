//! When the model may be wrong.

pub(crate) mod discretisation;
pub(crate) mod left_out;
pub(crate) mod misfit;
pub(crate) mod missing_mode;
pub(crate) mod one_more;
pub(crate) mod plausibility;
pub(crate) mod released;
pub(crate) mod released_width;
pub(crate) mod remarks;
pub(crate) mod rotations;
pub(crate) mod significance;
pub(crate) mod thickness_along;
pub(crate) mod verdict;
