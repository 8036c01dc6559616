//! What a frame comes to.

pub(crate) mod correlation;
pub(crate) mod overlap;
pub(crate) mod point_values;
pub(crate) mod settled;
