//! What a residual is asked for beyond the sums of an iteration: does it follow a displacement that bends within an
//! element (THEORY 19)?

/// Powers (a, b) of `z = 2 xi - 1` and `w = 2 eta - 1` by which a displacement varies within an element: those of the
/// bilinear field first, then those that bend.
pub const POWERS: [[usize; 2]; 10] = [[0, 0], [1, 0], [0, 1], [1, 1], [2, 0], [0, 2], [3, 0], [0, 3], [2, 1], [1, 2]];
/// How many of [`POWERS`] the field has.
pub const FLAT: usize = 4;
/// Columns that a residual is fitted by: the gradient's components times the powers, f and 1.
pub const COLUMNS: usize = OF_GREY + 2;
/// Where those of f and 1 are.
pub const OF_GREY: usize = 2 * POWERS.len();
/// The powers (a, b), a + b <= 6, that products of two of [`POWERS`] have.
pub const N_PRODUCTS: usize = 28;

/// The place of `z^a w^b` among the products.
pub const fn product(a: usize, b: usize) -> usize {
    // Rows of a of 7 - a each.
    a * (15 - a) / 2 + b
}

/// Sums over the pixels of an element of the residual r.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BentSums {
    /// Of `r fx` times the powers, then of `r fy`; of `r f` and of r.
    pub along: [f64; COLUMNS],
    /// Of `r^2`.
    pub rr: f64,
    /// Pixels.
    pub n: f64,
}

/// Sums over the pixels of an element of a reference: products of the columns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BentMoments {
    /// `fx fx`, `fx fy` and `fy fy` times the products of powers.
    pub gradient: [[f64; N_PRODUCTS]; 3],
    /// `f fx`, `f fy`, `fx` and `fy` times the powers.
    pub grey: [[f64; POWERS.len()]; 4],
    /// Of `f^2`, f and 1.
    pub of_grey: [f64; 3],
}

impl Default for BentMoments {
    fn default() -> Self {
        Self { gradient: [[0.0; N_PRODUCTS]; 3], grey: [[0.0; POWERS.len()]; 4], of_grey: [0.0; 3] }
    }
}
