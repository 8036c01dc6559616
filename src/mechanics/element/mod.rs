//! The elements: four-node quadrilaterals for the strips, four-node interfaces for the adhesive.

mod interface;
mod q4;

pub use interface::{Interface, InterfacePoint, Kinematics, Quadrature};
pub use q4::{Q4, Q4Point};

/// Forces at the four nodes of an element, N/mm: `[f_x, f_y]` of each node in turn.
pub type ElementVector = [f64; 8];

/// Stiffness of an element by rows, N/mm per mm; unknown `2 k + c` is component `c` of its node `k`.
pub type ElementStiffness = [[f64; 8]; 8];
