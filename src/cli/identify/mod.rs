//! Commands about the joint: its law from images or displacements, and the model itself.

pub(crate) mod case;
pub(crate) mod fit;
pub(crate) mod reduce;
pub(crate) mod simulate;
mod tournament;
