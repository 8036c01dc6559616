//! Symmetric systems of 2x2 nodal blocks: assembly, sparse Cholesky, block-Jacobi conjugate gradients. General
//! systems: banded and sparse LU.

mod banded_lu;
mod blocks;
mod cholesky;
mod compact;
mod conjugate_gradients;
mod dense;
mod dissection;
mod envelope;
mod inverse_diagonal;
mod lu;
mod nested_lu;
mod pivots;
mod selected_inverse;
mod solver;
mod sparse;
mod spread;
mod subspace;
mod without_penalty;

pub use banded_lu::BandedLu;
pub(crate) use blocks::by_key;
pub use blocks::{BlockMatrix, ElementMatrix, Pattern, alike, upper};
pub use cholesky::{Cholesky, NotPositiveDefinite};
pub use conjugate_gradients::{BlockJacobi, CgOutcome};
pub use dense::{Dense, DenseCholesky};
pub use dissection::{dissection, nested_dissection};
pub use envelope::Envelope;
pub use inverse_diagonal::{inverse_diagonal, inverse_diagonal_of_part, inverse_diagonal_with};
pub use lu::{BANDED_UP_TO, LuChoice, LuFactor, LuPlan};
pub use pivots::{PivotSigns, Singular};
pub use selected_inverse::selected_inverse;
#[cfg(feature = "gpu")]
pub use solver::REDUCTION_CHANGED;
pub use solver::{Solver, SolverChoice};
pub use sparse::{SparseMatrix, SparsePattern};
pub use spread::{Spread, spread};
pub use subspace::Subspace;
pub use without_penalty::WithoutPenalty;
