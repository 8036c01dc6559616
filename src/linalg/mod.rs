//! Symmetric systems of 2x2 nodal blocks: assembly, sparse Cholesky, block-Jacobi conjugate gradients.

mod blocks;
mod cholesky;
mod conjugate_gradients;
mod dissection;
mod inverse_diagonal;
mod selected_inverse;
mod solver;
mod spread;

pub use blocks::{BlockMatrix, ElementMatrix, Pattern};
pub use cholesky::{Cholesky, NotPositiveDefinite};
pub use conjugate_gradients::{BlockJacobi, CgOutcome};
pub use dissection::{dissection, nested_dissection};
pub use inverse_diagonal::inverse_diagonal;
pub use selected_inverse::selected_inverse;
pub use solver::{DIRECT_UP_TO, Solver, SolverChoice};
pub use spread::{Spread, spread};
