//! The camera from images of the specimen that was moved, from a target, from points, from lengths: what
//! `quadrille calibrate` does.

mod asked;
mod found;
mod images;
mod target;

pub use asked::{Calibrated, Calibrating};
pub use images::calibrate;
