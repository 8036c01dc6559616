//! What is known of a fit.

pub(crate) mod derived;
pub(crate) mod fitted;
pub(crate) mod given;
