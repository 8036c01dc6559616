//! Grey-level images in their native depth, the bits they use, and the sub-pixel interpolations.

mod blank;
mod depth;
mod image;
mod interpolation;
mod mean;
mod odd;
mod specimen;
mod strips;

pub use blank::{Blank, FlatBlocks};
pub use depth::{GreyDepth, Saturation};
pub use image::{Image, ImageError, Levels, Pixels, SharedPixels};
pub use interpolation::Interpolation;
pub use mean::{Mean, small_shift};
pub use odd::OddLevels;
pub use specimen::{LeftOut, Specimen, SpecimenPart};
pub use strips::{Strips, StripsError};
