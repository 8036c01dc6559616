//! Files: images, series of images, case files.

pub mod case;
pub mod images;
pub mod series;
mod tiff;
