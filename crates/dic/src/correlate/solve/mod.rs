//! The iteration of a frame, its steps, and the light that it follows.

pub(crate) mod iterate;
pub(crate) mod light;
pub(crate) mod mixing;
pub(crate) mod pace;
