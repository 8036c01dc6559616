//! LU factors of general sparse matrices: the plan is made once for a pattern, the factor for each set of values.

use super::banded_lu::BandedLu;
use super::nested_lu::{Fronts, NestedLu};
use super::pivots::{PivotSigns, Singular};
use super::sparse::{SparseMatrix, SparsePattern};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::LuError;
use faer::sparse::linalg::lu::{LuRef, LuSymbolicParams, NumericLu, SymbolicLu, factorize_symbolic_lu};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par};
use std::sync::Arc;

/// Which factor to make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LuChoice {
    /// By the work of the banded factor: see [`BANDED_UP_TO`].
    #[default]
    Auto,
    /// Banded, in the order of the unknowns.
    Banded,
    /// Sparse with column ordering and partial pivoting, by faer.
    Sparse,
    /// Sparse by nested dissection, with dense fronts.
    Nested,
}

/// Up to this many multiplications the banded factor is made (`cargo bench -p quadrille-testbed --bench mechanics --
/// solvers`).
pub const BANDED_UP_TO: f64 = 5e6;

/// The symbolic part of the factor, kept for all matrices on one pattern.
#[derive(Debug, Clone)]
pub struct LuPlan {
    pattern: Arc<SparsePattern>,
    kind: PlanKind,
}

#[derive(Debug, Clone)]
enum PlanKind {
    Banded { half: usize },
    Sparse(Arc<SymbolicLu<u32>>),
    Nested(Arc<Fronts>),
}

impl LuPlan {
    /// Analyses `pattern`, which must be symmetric; its unknowns lie at `points`.
    ///
    /// # Panics
    /// When there is not one point per unknown, or the memory for the analysis is not there.
    pub fn new(pattern: &Arc<SparsePattern>, points: &[[f64; 2]], choice: LuChoice) -> Self {
        assert_eq!(points.len(), pattern.n(), "one point per unknown");
        let half = pattern.half_bandwidth();
        let work = pattern.n() as f64 * (half * half) as f64;
        let kind = match choice {
            LuChoice::Auto if work <= BANDED_UP_TO => PlanKind::Banded { half },
            _ if pattern.n() == 0 => PlanKind::Banded { half },
            LuChoice::Banded => PlanKind::Banded { half },
            LuChoice::Auto | LuChoice::Nested => PlanKind::Nested(Arc::new(Fronts::new(pattern, points))),
            LuChoice::Sparse => {
                let (starts, rows) = pattern.parts();
                let faer_pattern = SymbolicSparseColMatRef::new_checked(pattern.n(), pattern.n(), starts, None, rows);
                let symbolic = factorize_symbolic_lu(faer_pattern, LuSymbolicParams::default());
                PlanKind::Sparse(Arc::new(symbolic.expect("memory for the analysis of the matrix")))
            }
        };
        Self { pattern: pattern.clone(), kind }
    }

    /// `banded`, `sparse` or `nested`.
    pub fn name(&self) -> &'static str {
        match self.kind {
            PlanKind::Banded { .. } => "banded",
            PlanKind::Sparse(_) => "sparse",
            PlanKind::Nested(_) => "nested",
        }
    }

    /// Number of values that a factor holds (8 bytes each); `None` where that depends on the pivots.
    pub fn n_values(&self) -> Option<usize> {
        match &self.kind {
            PlanKind::Banded { half } => Some(BandedLu::n_values(self.pattern.n(), *half)),
            PlanKind::Sparse(_) => None,
            PlanKind::Nested(fronts) => Some(fronts.n_values()),
        }
    }

    /// Room for a factor, used again for each matrix.
    pub fn factor(&self) -> LuFactor {
        match &self.kind {
            PlanKind::Banded { half } => LuFactor(FactorKind::Banded(BandedLu::new(self.pattern.n(), *half))),
            PlanKind::Sparse(symbolic) => {
                let numeric = Box::new(NumericLu::new());
                LuFactor(FactorKind::Sparse { symbolic: symbolic.clone(), numeric, ready: false })
            }
            PlanKind::Nested(fronts) => LuFactor(FactorKind::Nested(NestedLu::new(fronts))),
        }
    }
}

/// A factor, or the room for one.
#[derive(Debug)]
pub struct LuFactor(FactorKind);

#[derive(Debug)]
enum FactorKind {
    Banded(BandedLu),
    Sparse { symbolic: Arc<SymbolicLu<u32>>, numeric: Box<NumericLu<u32, f64>>, ready: bool },
    Nested(NestedLu),
}

impl LuFactor {
    /// Factorises `matrix`, which must be on the pattern of the plan, in place of what was there.
    ///
    /// # Errors
    /// [`Singular`] with the unknown whose column has no pivot. Nothing can be solved then.
    ///
    /// # Panics
    /// When the matrix has another pattern, or the memory is not there.
    pub fn refactor(&mut self, matrix: &SparseMatrix) -> Result<(), Singular> {
        match &mut self.0 {
            FactorKind::Banded(banded) => banded.factor(matrix),
            FactorKind::Nested(nested) => nested.factor(matrix),
            FactorKind::Sparse { symbolic, numeric, ready } => {
                *ready = false;
                let n = matrix.pattern().n();
                // faer takes whatever comes; a NaN would come out as one.
                if let Some(at) = matrix.values().iter().position(|value| !value.is_finite()) {
                    let unknown = (0..n).find(|&k| matrix.pattern().range(k).contains(&at)).unwrap_or(0);
                    return Err(Singular { unknown });
                }
                let (starts, rows) = matrix.pattern().parts();
                let pattern = SymbolicSparseColMatRef::new_checked(n, n, starts, None, rows);
                let matrix = SparseColMatRef::new(pattern, matrix.values());
                let scratch = symbolic.factorize_numeric_lu_scratch::<f64>(Par::Seq, Default::default());
                let mut memory = MemBuffer::new(scratch);
                let stack = MemStack::new(&mut memory);
                match symbolic.factorize_numeric_lu(numeric, matrix, Par::Seq, stack, Default::default()) {
                    Ok(_) => *ready = true,
                    Err(LuError::SymbolicSingular { index }) => return Err(Singular { unknown: index }),
                    Err(LuError::Generic(error)) => panic!("memory for the factor: {error:?}"),
                }
                Ok(())
            }
        }
    }

    /// Signs of the pivots, where the factor tells them.
    pub fn pivots(&self) -> Option<PivotSigns> {
        match &self.0 {
            FactorKind::Banded(banded) => Some(banded.pivots()),
            FactorKind::Nested(nested) => Some(nested.pivots()),
            FactorKind::Sparse { .. } => None,
        }
    }

    /// Solves in place for right-hand sides that follow one another in `rhs`, each of `n` numbers.
    ///
    /// # Panics
    /// When there is no factor, or the length of `rhs` is no multiple of `n`.
    pub fn solve(&self, rhs: &mut [f64]) {
        match &self.0 {
            FactorKind::Banded(banded) => banded.solve(rhs),
            FactorKind::Nested(nested) => nested.solve(rhs),
            FactorKind::Sparse { symbolic, numeric, ready } => {
                assert!(*ready, "a factor was made");
                let n = symbolic.nrows();
                assert_eq!(rhs.len() % n, 0, "the length of the right-hand sides");
                let columns = rhs.len() / n;
                let factor = LuRef::new_unchecked(symbolic, numeric);
                let mut memory = MemBuffer::new(symbolic.solve_in_place_scratch::<f64>(columns, Par::Seq));
                let rhs = MatMut::from_column_major_slice_mut(rhs, n, columns);
                factor.solve_in_place_with_conj(Conj::No, rhs, Par::Seq, MemStack::new(&mut memory));
            }
        }
    }
}
