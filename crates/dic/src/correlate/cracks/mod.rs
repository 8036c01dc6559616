//! Cracks: found in the residual, their faces located.

pub(crate) mod crack_search;
pub(crate) mod faces;
