//! What a correlation gives: displacement fields with their uncertainty, and rigid motions.

mod measurement;
mod options;
mod rigid;

pub use measurement::{Measurement, Status};
pub use options::{Brightness, StartFrom};
pub use rigid::RigidMotion;
