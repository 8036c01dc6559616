//! What a correlation gives: displacement fields with their uncertainty, and rigid motions; and the
//! choices it is run with.

mod measurement;
mod options;
mod rigid;

pub use measurement::{Measurement, Status};
pub use options::{Brightness, RegularisationKind, StartFrom, UnknownChoice};
pub use rigid::RigidMotion;
