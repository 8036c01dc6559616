//! Grey-level images in their native depth, and the sub-pixel interpolations.

mod image;
mod interpolation;

pub use image::{Image, ImageError, Pixels};
pub use interpolation::Interpolation;
