//! What is made of a reference once: levels, matrices, the check of its texture.

pub(crate) mod finest;
pub(crate) mod gradient_noise;
pub(crate) mod hot_pixels;
pub(crate) mod level;
pub(crate) mod options;
pub(crate) mod own;
pub(crate) mod reference;
pub(crate) mod smoothing;
pub(crate) mod texture;
