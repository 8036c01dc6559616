//! What the pivots of a factor tell of its matrix.

use thiserror::Error;

/// The matrix has no inverse.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("the matrix is singular at unknown {unknown}")]
pub struct Singular {
    /// Unknown whose column has no pivot.
    pub unknown: usize,
}

/// Signs of the pivots of a factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PivotSigns {
    /// Pivots below zero.
    pub negative: usize,
    /// Rows that were exchanged.
    pub exchanged: usize,
}

impl PivotSigns {
    /// Whether the determinant is positive.
    pub fn positive_determinant(self) -> bool {
        (self.negative + self.exchanged).is_multiple_of(2)
    }

    /// Whether all leading minors are positive, as of any matrix with a positive definite symmetric part.
    pub fn all_positive(self) -> bool {
        self.negative == 0 && self.exchanged == 0
    }
}
