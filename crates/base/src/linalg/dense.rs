//! Small dense matrices and their Cholesky factor, by faer; one thread, so that the bits do not depend on their number.

use super::cholesky::NotPositiveDefinite;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{BlockStructure, matmul as matmul_triangular};
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Accum, Mat, Par, Side};
use std::ops::{Index, IndexMut};

/// A dense matrix, column by column.
#[derive(Debug, Clone, PartialEq)]
pub struct Dense(Mat<f64>);

impl Dense {
    /// Zeros.
    pub fn zeros(n_rows: usize, n_columns: usize) -> Self {
        Self(Mat::zeros(n_rows, n_columns))
    }

    /// The matrix of `entry(row, column)`.
    pub fn from_fn(n_rows: usize, n_columns: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        Self(Mat::from_fn(n_rows, n_columns, entry))
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.0.nrows()
    }

    /// Number of columns.
    pub fn n_columns(&self) -> usize {
        self.0.ncols()
    }

    /// Column `k`.
    pub fn column(&self, k: usize) -> &[f64] {
        self.0.col_as_slice(k)
    }

    /// Column `k`, to be written.
    pub fn column_mut(&mut self, k: usize) -> &mut [f64] {
        self.0.col_as_slice_mut(k)
    }

    /// `self * other`.
    ///
    /// # Panics
    /// When the sizes do not fit.
    pub fn times(&self, other: &Self) -> Self {
        let mut product = Mat::zeros(self.n_rows(), other.n_columns());
        matmul(product.as_mut(), Accum::Replace, self.0.as_ref(), other.0.as_ref(), 1.0, Par::Seq);
        Self(product)
    }

    /// `self^T * other`.
    ///
    /// # Panics
    /// When the sizes do not fit.
    pub fn transposed_times(&self, other: &Self) -> Self {
        let mut product = Mat::zeros(self.n_columns(), other.n_columns());
        matmul(product.as_mut(), Accum::Replace, self.0.transpose(), other.0.as_ref(), 1.0, Par::Seq);
        Self(product)
    }

    /// Adds `factor * other`.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn add(&mut self, factor: f64, other: &Self) {
        assert_eq!((self.n_rows(), self.n_columns()), (other.n_rows(), other.n_columns()), "matrices of one size");
        for k in 0..self.n_columns() {
            self.column_mut(k).iter_mut().zip(other.column(k)).for_each(|(a, b)| *a += factor * b);
        }
    }

    /// Adds `factor * other * other^T` to the lower triangle; what is above is left as it is.
    ///
    /// # Panics
    /// When the sizes do not fit.
    pub fn add_square_below(&mut self, factor: f64, other: &Self) {
        matmul_triangular(
            self.0.as_mut(),
            BlockStructure::TriangularLower,
            Accum::Add,
            other.0.as_ref(),
            BlockStructure::Rectangular,
            other.0.transpose(),
            BlockStructure::Rectangular,
            factor,
            Par::Seq,
        );
    }

    /// The Cholesky factor of a symmetric matrix; its lower triangle is read.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] with the row of the pivot that fails.
    pub fn cholesky(&self) -> Result<DenseCholesky, NotPositiveDefinite> {
        let mut factor = self.0.clone();
        let n = self.n_rows();
        let mut memory = MemBuffer::new(cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default()));
        cholesky_in_place(
            factor.as_mut(),
            Default::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        )
        .map_err(|LltError::NonPositivePivot { index }| NotPositiveDefinite { node: index })?;
        Ok(DenseCholesky(factor))
    }

    /// Ascending eigenvalues of a symmetric matrix, eigenvectors as columns; `None` when a number is not finite.
    pub fn symmetric_eigen(&self) -> Option<(Vec<f64>, Self)> {
        let eigen = self.0.self_adjoint_eigen(Side::Lower).ok()?;
        let values = eigen.S().column_vector().iter().copied().collect();
        Some((values, Self(eigen.U().to_owned())))
    }
}

impl Index<(usize, usize)> for Dense {
    type Output = f64;

    fn index(&self, at: (usize, usize)) -> &f64 {
        &self.0[at]
    }
}

impl IndexMut<(usize, usize)> for Dense {
    fn index_mut(&mut self, at: (usize, usize)) -> &mut f64 {
        &mut self.0[at]
    }
}

/// The factor `L` of `A = L L^T`; above its diagonal stands nothing of use.
#[derive(Debug, Clone)]
pub struct DenseCholesky(Mat<f64>);

impl DenseCholesky {
    /// `A^-1 X`.
    ///
    /// # Panics
    /// When the sizes do not fit.
    pub fn solve(&self, x: &Dense) -> Dense {
        let mut x = self.half_solve(x);
        solve_upper_triangular_in_place(self.0.transpose(), x.0.as_mut(), Par::Seq);
        x
    }

    /// `L^-1 X`, so that `X^T A^-1 X` is its square.
    ///
    /// # Panics
    /// When the sizes do not fit.
    pub fn half_solve(&self, x: &Dense) -> Dense {
        let mut x = x.clone();
        solve_lower_triangular_in_place(self.0.as_ref(), x.0.as_mut(), Par::Seq);
        x
    }

    /// `X L^-T`, whose square `X A^-1 X^T` is.
    ///
    /// # Panics
    /// When the sizes do not fit.
    pub fn half_solve_right(&self, x: &Dense) -> Dense {
        let mut transposed = x.0.transpose().to_owned();
        solve_lower_triangular_in_place(self.0.as_ref(), transposed.as_mut(), Par::Seq);
        Dense(transposed.transpose().to_owned())
    }

    /// `L X`: columns of independent numbers of variance 1 become columns of covariance `A`.
    ///
    /// # Panics
    /// When the sizes do not fit.
    pub fn half_times(&self, x: &Dense) -> Dense {
        let mut product = Mat::zeros(self.0.nrows(), x.n_columns());
        matmul_triangular(
            product.as_mut(),
            BlockStructure::Rectangular,
            Accum::Replace,
            self.0.as_ref(),
            BlockStructure::TriangularLower,
            x.0.as_ref(),
            BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
        Dense(product)
    }

    /// `A^-1`.
    pub fn inverse(&self) -> Dense {
        self.solve(&Dense(Mat::identity(self.0.nrows(), self.0.nrows())))
    }
}
