//! What a correlation gives: displacement fields with their uncertainty, and rigid motions.

mod measurement;
mod rigid;

pub use measurement::{Measurement, Status};
pub use rigid::RigidMotion;
