//! The solver of the normal equations: direct or iterative, by size.

use super::blocks::{BlockMatrix, ElementMatrix};
use super::cholesky::{Cholesky, NotPositiveDefinite};
use super::conjugate_gradients::{BlockJacobi, Single};
use std::sync::{Arc, OnceLock};

/// Up to this many nodes a factor is made and kept; beyond, conjugate gradients are faster
/// (`benches/RESULTS.md`, table of solvers).
pub const DIRECT_UP_TO: usize = 5_000;

/// Fall of the residual that conjugate gradients are asked for. The Gauss-Newton iteration contracts
/// about ninefold, so a correction exact to 1 % loses nothing.
const REDUCTION: f64 = 1e-2;
/// The same where elements at the border have lost pixels: their share of the residual is small, and they are the last to
/// settle.
pub(crate) const REDUCTION_CHANGED: f64 = 1e-3;
const MAX_ITERATIONS: usize = 60;

/// Which solver to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SolverChoice {
    /// By size: see [`DIRECT_UP_TO`].
    #[default]
    Auto,
    /// Sparse Cholesky factor.
    Direct,
    /// Block-Jacobi conjugate gradients.
    Iterative,
}

/// A symmetric positive definite matrix, ready to be solved with.
#[derive(Debug)]
pub struct Solver {
    matrix: BlockMatrix,
    jacobi: BlockJacobi,
    /// What conjugate gradients run in, once they do.
    single: OnceLock<Single>,
    factor: Option<Factor>,
    regularised: Option<Regularised>,
    /// Fall of the residual that conjugate gradients are asked for.
    reduction: f64,
    /// See [`Solver::with_responses`].
    responses: Option<Arc<[Vec<[f64; 2]>; 2]>>,
}

/// A factor of the matrix.
#[derive(Debug)]
enum Factor {
    /// Of a sum with a penalty on long waves, whose condition takes all digits.
    Double(Cholesky),
    /// Of data alone: exact to 1e-5 or so, a thousand times what an outer iteration needs.
    Single(Cholesky<f32>),
}

/// The two parts of a regularised matrix.
#[derive(Debug)]
struct Regularised {
    data: BlockMatrix,
    penalty: Arc<BlockMatrix>,
}

impl Solver {
    /// Prepares `matrix`; `order` is the elimination order, asked for only when a factor is made.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] when a factor is asked for and does not exist.
    pub fn new(
        matrix: BlockMatrix,
        choice: SolverChoice,
        order: impl FnOnce() -> Vec<usize>,
    ) -> Result<Self, NotPositiveDefinite> {
        let solver = Self::iterative(matrix);
        let factor = solver.factor(choice, order)?;
        Ok(solver.with_factor(factor))
    }

    /// Makes the factor of the matrix, if `choice` asks for one.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] when it does not exist.
    pub fn factor(
        &self,
        choice: SolverChoice,
        order: impl FnOnce() -> Vec<usize>,
    ) -> Result<Option<Cholesky>, NotPositiveDefinite> {
        let direct = match choice {
            SolverChoice::Auto => self.matrix.pattern().n_nodes() <= DIRECT_UP_TO,
            SolverChoice::Direct => true,
            SolverChoice::Iterative => false,
        };
        direct.then(|| Cholesky::new(&self.matrix, &order())).transpose()
    }

    /// The same with a factor of its matrix, made by [`Solver::factor`].
    pub fn with_factor(self, factor: Option<Cholesky>) -> Self {
        Self { factor: factor.map(|factor| Factor::Single(factor.single())), ..self }
    }

    /// Prepares `matrix` for conjugate gradients, which need no factor and cannot fail.
    pub fn iterative(matrix: BlockMatrix) -> Self {
        let jacobi = BlockJacobi::new(&matrix);
        let single = OnceLock::new();
        Self { matrix, jacobi, single, factor: None, regularised: None, reduction: REDUCTION, responses: None }
    }

    /// The solver of `data + penalty`, always with a factor, which is made in the elimination `order`: a
    /// penalty on long waves leaves the sum too badly conditioned for conjugate gradients.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] when neither the data nor the penalty determines some unknown.
    ///
    /// # Panics
    /// When the pattern of `data` does not lie within that of `penalty`.
    pub fn regularised(
        data: BlockMatrix,
        penalty: Arc<BlockMatrix>,
        order: &[usize],
    ) -> Result<Self, NotPositiveDefinite> {
        let mut sum = BlockMatrix::clone(&penalty);
        sum.add(&data, 1.0);
        let factor = Some(Factor::Double(Cholesky::new(&sum, order)?));
        Ok(Self { factor, regularised: Some(Regularised { data, penalty }), ..Self::iterative(sum) })
    }

    /// Conjugate gradients for the same matrix with the rows of `nodes` assembled anew, see [`BlockMatrix::assemble`]: for a
    /// solver without penalty of which some elements have changed, and `nodes` all of theirs.
    pub(crate) fn changed<'a>(
        &self,
        nodes: &[u32],
        elements: &[[u32; 4]],
        of_element: impl Fn(u32) -> &'a ElementMatrix,
    ) -> Self {
        let mut matrix = self.matrix.clone();
        matrix.assemble_rows(nodes, elements, of_element);
        let jacobi = self.jacobi.changed(&matrix, nodes);
        let single = self.single.get().map(|single| single.changed(&matrix, &jacobi, nodes).into()).unwrap_or_default();
        let responses = self.responses.clone();
        Self { matrix, jacobi, single, factor: None, regularised: None, reduction: REDUCTION_CHANGED, responses }
    }

    /// The same with the solutions for two right-hand sides, which are wanted in every step.
    pub fn with_responses(self, to: [Vec<[f64; 2]>; 2]) -> Self {
        let responses = Some(Arc::new(to.map(|rhs| self.solve(rhs))));
        Self { responses, ..self }
    }

    /// The same with those of `other`, whose matrix is nearly this one.
    pub(crate) fn with_responses_of(self, other: &Self) -> Self {
        Self { responses: other.responses.clone(), ..self }
    }

    /// The solutions of [`Solver::with_responses`], where there are any.
    pub fn responses(&self) -> Option<&[Vec<[f64; 2]>; 2]> {
        self.responses.as_deref()
    }

    /// The matrix of the data alone: the part of [`Solver::matrix`] that is not penalty.
    pub fn data(&self) -> &BlockMatrix {
        self.regularised.as_ref().map_or(&self.matrix, |parts| &parts.data)
    }

    /// The penalty, if the matrix is regularised.
    pub fn penalty(&self) -> Option<&BlockMatrix> {
        self.regularised.as_ref().map(|parts| &*parts.penalty)
    }

    /// The correction of `displacement` for the right-hand side `rhs` of the data. A penalty acts on the whole
    /// displacement and not on its correction: `(M + w R) da = b - w R a` (THEORY 2).
    pub fn correction(&self, mut rhs: Vec<[f64; 2]>, displacement: &[[f64; 2]]) -> Vec<[f64; 2]> {
        if let Some(penalty) = self.penalty() {
            for (node, b) in rhs.iter_mut().enumerate() {
                let [px, py] = penalty.row_times(node, displacement);
                b[0] -= px;
                b[1] -= py;
            }
        }
        self.solve(rhs)
    }

    /// The matrix.
    pub fn matrix(&self) -> &BlockMatrix {
        &self.matrix
    }

    /// Fall of the residual that conjugate gradients are asked for: a graphics device has its own.
    #[cfg(feature = "gpu")]
    pub(crate) fn reduction(&self) -> f64 {
        self.reduction
    }

    /// The inverse nodal blocks.
    pub fn jacobi(&self) -> &BlockJacobi {
        &self.jacobi
    }

    /// Memory of the factor, bytes; 0 without one.
    pub fn factor_bytes(&self) -> usize {
        match &self.factor {
            Some(Factor::Double(factor)) => factor.bytes(),
            Some(Factor::Single(factor)) => factor.bytes(),
            None => 0,
        }
    }

    /// `direct` or `iterative`.
    pub fn name(&self) -> &'static str {
        if self.factor.is_some() { "direct" } else { "iterative" }
    }

    /// Conjugate gradient iterations that a right-hand side without any order needs until its residual has fallen
    /// by `reduction`, `most` at most: what a device that does a fixed number of them should do.
    pub fn trial_iterations(&self, reduction: f64, most: usize) -> usize {
        // Multiplicative hashing: as good as noise, and the same every time.
        let noise = |k: usize| f64::from((k as u32).wrapping_mul(2_654_435_769) >> 16) / 32768.0 - 1.0;
        let mut rhs: Vec<[f64; 2]> =
            (0..self.matrix.pattern().n_nodes()).map(|node| [noise(2 * node + 1), noise(2 * node + 2)]).collect();
        self.matrix.held().iter().for_each(|&node| rhs[node as usize] = [0.0; 2]);
        self.jacobi.solve(&self.matrix, &rhs, reduction, most).1.iterations
    }

    /// Solves for `rhs`: to the digits of its factor (double with a penalty, else single), without one to 1 % or less, in single
    /// precision; any of these is enough inside an outer iteration.
    pub fn solve(&self, mut rhs: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
        self.matrix.held().iter().for_each(|&node| rhs[node as usize] = [0.0; 2]);
        if let Some(Factor::Double(factor)) = &self.factor {
            factor.solve(&mut rhs);
            return rhs;
        }
        // Scaled, so that neither a tiny nor a huge right-hand side leaves the range of single precision.
        let largest = rhs.as_flattened().iter().fold(0.0f64, |largest, b| largest.max(b.abs()));
        let scale = if largest > 0.0 && largest.is_finite() { largest } else { 1.0 };
        let mut single: Vec<[f32; 2]> = rhs.iter().map(|b| b.map(|b| (b / scale) as f32)).collect();
        match &self.factor {
            Some(Factor::Single(factor)) => factor.solve(&mut single),
            _ => {
                let of_matrix = self.single.get_or_init(|| Single::new(&self.matrix, &self.jacobi));
                single = of_matrix.solve(self.matrix.pattern(), &single, self.reduction, MAX_ITERATIONS);
            }
        }
        single.into_iter().map(|x| x.map(|x| f64::from(x) * scale)).collect()
    }
}
