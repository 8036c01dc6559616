//! Sparse Cholesky factor of a [`BlockMatrix`], by faer.

use super::blocks::BlockMatrix;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::traits::RealField;
use faer::{Conj, MatMut, Par, Side};
use thiserror::Error;

/// The matrix has no Cholesky factor.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("the matrix is not positive definite at node {node}")]
pub struct NotPositiveDefinite {
    /// Node whose pivot is not positive.
    pub node: usize,
}

/// The factor `L L^T` of a symmetric positive definite matrix; solves any number of right-hand sides.
pub struct Cholesky<T = f64> {
    symbolic: SymbolicCholesky<u32>,
    values: Vec<T>,
}

impl<T> std::fmt::Debug for Cholesky<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Cholesky {{ {} unknowns, {} values }}", self.symbolic.nrows(), self.values.len())
    }
}

impl Cholesky {
    /// Factorises `matrix`, eliminating the nodes in the given `order` (each node once).
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] with the node at which a pivot fails.
    ///
    /// # Panics
    /// When `order` is not a permutation of the nodes.
    pub fn new(matrix: &BlockMatrix, order: &[usize]) -> Result<Self, NotPositiveDefinite> {
        Self::with(matrix, order, CholeskySymbolicParams::default())
    }

    /// The same, always in dense pieces (supernodes), which [`super::selected_inverse`] works on.
    pub(super) fn in_pieces(matrix: &BlockMatrix, order: &[usize]) -> Result<Self, NotPositiveDefinite> {
        let supernodal_flop_ratio_threshold = SupernodalThreshold::FORCE_SUPERNODAL;
        Self::with(matrix, order, CholeskySymbolicParams { supernodal_flop_ratio_threshold, ..Default::default() })
    }

    pub(super) fn parts(&self) -> (&SymbolicCholesky<u32>, &[f64]) {
        (&self.symbolic, &self.values)
    }

    fn with(
        matrix: &BlockMatrix,
        order: &[usize],
        parameters: CholeskySymbolicParams<'_>,
    ) -> Result<Self, NotPositiveDefinite> {
        let n = 2 * matrix.pattern().n_nodes();
        let (column_starts, rows, values) = lower_triangle(matrix);
        let forward: Vec<u32> = order.iter().flat_map(|&node| [2 * node as u32, 2 * node as u32 + 1]).collect();
        let mut inverse = vec![0u32; n];
        for (place, &unknown) in forward.iter().enumerate() {
            inverse[unknown as usize] = place as u32;
        }
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &column_starts, None, &rows);
        let symbolic = factorize_symbolic_cholesky(
            pattern,
            Side::Lower,
            SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, n)),
            parameters,
        )
        // The analysis fails only when an index or the memory overflows.
        .map_err(|_| NotPositiveDefinite { node: 0 })?;
        let mut factor = vec![0.0; symbolic.len_val()];
        let mut memory = MemBuffer::new(symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default()));
        symbolic
            .factorize_numeric_llt(
                &mut factor,
                SparseColMatRef::new(pattern, &values),
                Side::Lower,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .map_err(|LltError::NonPositivePivot { index }| NotPositiveDefinite {
                node: forward.get(index).map_or(0, |&unknown| unknown as usize / 2),
            })?;
        Ok(Self { symbolic, values: factor })
    }

    /// The same factor in single precision: half the memory to read, which is what a solution takes its time for.
    pub fn single(self) -> Cholesky<f32> {
        Cholesky { symbolic: self.symbolic, values: self.values.iter().map(|&value| value as f32).collect() }
    }
}

impl<T: RealField> Cholesky<T> {
    /// Memory of the values, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }

    /// Solves for one right-hand side, in place.
    pub fn solve(&self, rhs: &mut [[T; 2]]) {
        let n = 2 * rhs.len();
        let factor = LltRef::new(&self.symbolic, &self.values);
        let mut memory = MemBuffer::new(factor.solve_in_place_scratch::<T>(1, Par::Seq));
        let rhs = MatMut::from_column_major_slice_mut(rhs.as_flattened_mut(), n, 1);
        factor.solve_in_place_with_conj(Conj::No, rhs, Par::Seq, MemStack::new(&mut memory));
    }
}

/// Lower triangle in compressed columns: column starts, row indices, values.
fn lower_triangle(matrix: &BlockMatrix) -> (Vec<u32>, Vec<u32>, Vec<f64>) {
    let pattern = matrix.pattern();
    let n_values = 2 * pattern.n_blocks() + pattern.n_nodes();
    let mut column_starts = Vec::with_capacity(2 * pattern.n_nodes() + 1);
    let (mut rows, mut values) = (Vec::with_capacity(n_values), Vec::with_capacity(n_values));
    column_starts.push(0);
    for node in 0..pattern.n_nodes() {
        for component in 0..2 {
            // By symmetry the column of blocks is the row of blocks, transposed.
            for at in pattern.row(node) {
                let other = pattern.columns()[at] as usize;
                let block = &matrix.blocks()[at];
                for row in 0..2 {
                    if other > node || (other == node && row >= component) {
                        rows.push((2 * other + row) as u32);
                        values.push(block[2 * component + row]);
                    }
                }
            }
            column_starts.push(rows.len() as u32);
        }
    }
    (column_starts, rows, values)
}
