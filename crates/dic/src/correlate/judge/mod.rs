//! Which elements and frames count.

pub(crate) mod apart;
pub(crate) mod finish;
pub(crate) mod marks;
pub(crate) mod screen;
