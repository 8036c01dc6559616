//! The elements: four-node quadrilaterals for the strips, four-node interfaces for the adhesive.

mod interface;
mod q4;

pub use crate::io::case::{Kinematics, Quadrature};
pub use interface::{Interface, InterfacePoint};
pub use q4::{Q4, Q4Point};

use nalgebra::{SMatrix, SVector};

/// Forces (N/mm) or displacements (mm) at the four nodes of an element: both components of each node in turn.
pub type ElementVector = SVector<f64, 8>;

/// Stiffness of an element, N/mm per mm; unknown `2 k + c` is component `c` of its node `k`.
pub type ElementStiffness = SMatrix<f64, 8, 8>;
