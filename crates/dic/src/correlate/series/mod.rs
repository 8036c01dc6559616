//! One frame after the other: predictions, renewed references, a device chosen when the program runs.

pub(crate) mod chain;
pub(crate) mod chosen;
pub(crate) mod tracker;
