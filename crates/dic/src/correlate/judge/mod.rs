//! Which elements and frames count.

pub(crate) mod finish;
pub(crate) mod ground;
pub(crate) mod marks;
pub(crate) mod screen;
