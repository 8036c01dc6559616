//! What the uncertainty of a camera does to a field.

use crate::plane::Point;

/// What a field is off when the camera is off by one standard uncertainty in one direction of its parameters: common to
/// all nodes. Terms are independent of each other.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraTerm {
    /// Its name in budgets: `lens` for k1, `lens_k2`, `tilt_x`, `distance`.
    pub name: &'static str,
    /// Change of the displacement of each node, px of the plane.
    pub change: Vec<Point>,
}
