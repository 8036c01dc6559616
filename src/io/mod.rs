//! Files: images, series of images.

pub mod images;
pub mod series;
mod tiff;
