//! Solver of the normal equations: conjugate gradients, or a factor where more than the images holds the solution.

use super::blocks::{BlockMatrix, ElementMatrix};
use super::cholesky::{Cholesky, NotPositiveDefinite};
use super::compact::Compact;
use super::conjugate_gradients::BlockJacobi;
use super::spread::Spread;
use super::subspace::Subspace;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Fall of the residual that conjugate gradients are asked for. The Gauss-Newton iteration contracts
/// about ninefold, so that a correction exact to 1 % would do; but what hardly any texture determines comes last, and
/// with 1 % two devices ended 0.002 of a standard uncertainty apart there.
const REDUCTION: f64 = 3e-3;
/// The same where border elements have lost pixels: their share of the residual is small, and they settle last.
pub const REDUCTION_CHANGED: f64 = 1e-3;
const MAX_ITERATIONS: usize = 60;

/// Which solver to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SolverChoice {
    /// Block-Jacobi conjugate gradients: on meshes of any size they are faster than to solve with a factor, and nothing
    /// has to be made first (`cargo bench -p quadrille-testbed --bench report -- solvers`).
    #[default]
    Iterative,
    /// Sparse Cholesky factor.
    Direct,
}

/// A symmetric positive definite matrix, ready to be solved with.
#[derive(Debug)]
pub struct Solver {
    system: System,
    factor: Option<Factor>,
    regularised: Option<Regularised>,
    within: Option<Within>,
    /// Fall of the residual that conjugate gradients are asked for.
    reduction: f64,
    /// See [`Solver::with_responses`].
    responses: Option<Arc<[Vec<[f64; 2]>; 2]>>,
    /// Of one that was made of another, the nodes whose rows differ, see [`Solver::change_rows`].
    changed: Option<Vec<u32>>,
    /// Systems of solvers that were made of this one and are no longer used, with the nodes whose rows differ: what
    /// the next one is made in, since to copy a whole matrix takes longer than the rows that change.
    spare: Mutex<Vec<(System, Vec<u32>)>>,
}

const SPARE: usize = 8;

/// A matrix, and what conjugate gradients need of it.
#[derive(Debug, Clone)]
struct System {
    matrix: BlockMatrix,
    jacobi: BlockJacobi,
    /// What conjugate gradients run in, once they do.
    compact: OnceLock<Compact>,
}

impl System {
    fn new(matrix: BlockMatrix) -> Self {
        let jacobi = BlockJacobi::new(&matrix);
        Self { matrix, jacobi, compact: OnceLock::new() }
    }

    /// Made once: whoever waits for parts of it may take up another frame, which must not wait for this one.
    fn compact(&self) -> &Compact {
        if let Some(compact) = self.compact.get() {
            return compact;
        }
        let compact = Compact::new(&self.matrix, &self.jacobi);
        self.compact.get_or_init(|| compact)
    }

    fn follow(&mut self, nodes: &[u32]) {
        self.jacobi.follow(&self.matrix, nodes);
        if let Some(compact) = self.compact.get_mut() {
            compact.follow(&self.matrix, &self.jacobi, nodes);
        }
    }
}

#[derive(Debug)]
enum Factor {
    /// Of a sum with a penalty on long waves, whose condition takes all digits.
    Double(Cholesky),
    /// Of data alone: exact to 1e-5 or so, a thousand times what an outer iteration needs.
    Single(Cholesky<f32>),
}

#[derive(Debug)]
struct Regularised {
    data: BlockMatrix,
    penalty: Arc<BlockMatrix>,
}

/// What confines the solution to a [`Subspace`].
#[derive(Debug)]
struct Within {
    subspace: Arc<Subspace>,
    /// Of the matrix of its functions.
    factor: Cholesky,
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
        (choice == SolverChoice::Direct).then(|| Cholesky::new(self.matrix(), &order())).transpose()
    }

    /// The same with a factor of its matrix, made by [`Solver::factor`].
    pub fn with_factor(self, factor: Option<Cholesky>) -> Self {
        Self { factor: factor.map(|factor| Factor::Single(factor.single())), ..self }
    }

    /// Prepares `matrix` for conjugate gradients, which need no factor and cannot fail.
    pub fn iterative(matrix: BlockMatrix) -> Self {
        Self::of(System::new(matrix))
    }

    fn of(system: System) -> Self {
        let (factor, regularised, within, responses) = (None, None, None, None);
        let (changed, spare) = (None, Mutex::default());
        Self { system, factor, regularised, within, reduction: REDUCTION, responses, changed, spare }
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
        let solver = Self::smoothed(data, penalty);
        let factor = Some(Factor::Double(Cholesky::new(solver.matrix(), order)?));
        Ok(Self { factor, ..solver })
    }

    /// The solver of `data` and a penalty that acts over a few elements only: conditioned well enough for conjugate
    /// gradients, which on a large mesh cost less than a factor.
    ///
    /// # Panics
    /// When the pattern of `data` does not lie within that of `penalty`.
    pub fn smoothed(data: BlockMatrix, penalty: Arc<BlockMatrix>) -> Self {
        let mut sum = BlockMatrix::clone(&penalty);
        sum.add(&data, 1.0);
        Self { regularised: Some(Regularised { data, penalty }), ..Self::iterative(sum) }
    }

    /// The solver of `data` for fields of a subspace, always with a factor, that of its functions.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] when the data does not determine the functions.
    pub fn within(data: BlockMatrix, subspace: Arc<Subspace>) -> Result<Self, NotPositiveDefinite> {
        let factor = subspace.factor(&subspace.matrix(&data))?;
        Ok(Self { within: Some(Within { subspace, factor }), ..Self::iterative(data) })
    }

    /// Conjugate gradients for the same matrix with the rows of `nodes` assembled anew, see [`BlockMatrix::assemble`]:
    /// for a solver without penalty of which some elements have changed, and `nodes` all of theirs.
    pub fn change_rows<'a>(
        &self,
        nodes: &[u32],
        elements: &[[u32; 4]],
        of_element: impl Fn(u32) -> &'a ElementMatrix + Sync,
    ) -> Self {
        let spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let (mut system, mut differ) = spare.unwrap_or_else(|| (self.system.clone(), Vec::new()));
        system.matrix.copy_rows(&self.system.matrix, &differ);
        system.matrix.assemble_rows(nodes, elements, of_element);
        differ.extend(nodes);
        differ.sort_unstable();
        differ.dedup();
        system.follow(&differ);
        let (responses, changed) = (self.responses.clone(), Some(nodes.to_vec()));
        Self { reduction: REDUCTION_CHANGED, responses, changed, ..Self::of(system) }
    }

    /// Takes back a solver that [`Solver::change_rows`] has made of this one, for the next one.
    pub fn take_back(&self, Self { system, changed, .. }: Self) {
        let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(changed) = changed.filter(|_| spare.len() < SPARE) {
            spare.push((system, changed));
        }
    }

    /// The same with the solutions for two right-hand sides, which are wanted in every step.
    pub fn with_responses(self, to: [Vec<[f64; 2]>; 2]) -> Self {
        let responses = Some(Arc::new(to.map(|rhs| self.solve(rhs))));
        Self { responses, ..self }
    }

    /// The same with those of `other`, whose matrix is nearly this one.
    pub fn with_responses_of(self, other: &Self) -> Self {
        Self { responses: other.responses.clone(), ..self }
    }

    /// The solutions of [`Solver::with_responses`], where there are any.
    pub fn responses(&self) -> Option<&[Vec<[f64; 2]>; 2]> {
        self.responses.as_deref()
    }

    /// The matrix of the data alone: the part of [`Solver::matrix`] that is not penalty.
    pub fn data(&self) -> &BlockMatrix {
        self.regularised.as_ref().map_or(&self.system.matrix, |parts| &parts.data)
    }

    /// The penalty, if the matrix is regularised.
    pub fn penalty(&self) -> Option<&Arc<BlockMatrix>> {
        self.regularised.as_ref().map(|parts| &parts.penalty)
    }

    /// The correction of `displacement` for the right-hand side `rhs` of the data. A penalty acts on the whole
    /// displacement and not on its correction: `(M + w R) da = b - w R a` (THEORY 2). So does a subspace, into which it
    /// leads.
    pub fn correction(&self, mut rhs: Vec<[f64; 2]>, displacement: &[[f64; 2]]) -> Vec<[f64; 2]> {
        if let Some(within) = &self.within {
            for (node, b) in rhs.iter_mut().enumerate() {
                let [x, y] = self.matrix().row_times(node, displacement);
                *b = [b[0] + x, b[1] + y];
            }
            // A node without any data stays where it is: what the functions would make of it is a guess.
            let has_data = |node: usize| self.matrix().diagonal(node) != [0.0; 3];
            let mut correction = within.solution(rhs, self.matrix().held());
            for (node, (c, u)) in correction.iter_mut().zip(displacement).enumerate() {
                *c = if has_data(node) { [c[0] - u[0], c[1] - u[1]] } else { [0.0; 2] };
            }
            self.matrix().held().iter().for_each(|&node| correction[node as usize] = [0.0; 2]);
            return correction;
        }
        if let Some(penalty) = self.penalty() {
            for (node, b) in rhs.iter_mut().enumerate() {
                let [px, py] = penalty.row_times(node, displacement);
                b[0] -= px;
                b[1] -= py;
            }
        }
        self.solve(rhs)
    }

    /// The matrix, of which something else is to be made.
    pub fn into_matrix(self) -> BlockMatrix {
        self.system.matrix
    }

    /// The matrix.
    pub fn matrix(&self) -> &BlockMatrix {
        &self.system.matrix
    }

    /// Fall of the residual that conjugate gradients are asked for: a graphics device has its own.
    #[cfg(feature = "gpu")]
    pub fn reduction(&self) -> f64 {
        self.reduction
    }

    /// The inverse nodal blocks.
    pub fn jacobi(&self) -> &BlockJacobi {
        &self.system.jacobi
    }

    /// Whether anything holds the solution beside the data.
    pub fn is_held(&self) -> bool {
        self.regularised.is_some() || self.within.is_some()
    }

    /// What the solution is confined to, if anything.
    pub fn subspace(&self) -> Option<&Arc<Subspace>> {
        self.within.as_ref().map(|within| &within.subspace)
    }

    /// Variances and degrees of freedom of a solution that is confined; `None` of another.
    pub fn spread_within(&self) -> Option<Spread> {
        self.within.as_ref().map(|within| within.subspace.spread(self.data(), &within.factor))
    }

    /// Memory of the factor, bytes; 0 without one.
    pub fn factor_bytes(&self) -> usize {
        if let Some(within) = &self.within {
            return within.factor.bytes();
        }
        match &self.factor {
            Some(Factor::Double(factor)) => factor.bytes(),
            Some(Factor::Single(factor)) => factor.bytes(),
            None => 0,
        }
    }

    /// `direct` or `iterative`.
    pub fn name(&self) -> &'static str {
        if self.factor.is_some() || self.within.is_some() { "direct" } else { "iterative" }
    }

    /// Conjugate gradient iterations that a right-hand side without any order needs until its residual has fallen
    /// by `reduction`, `most` at most: what a device that does a fixed number of them should do.
    pub fn trial_iterations(&self, reduction: f64, most: usize) -> usize {
        // Multiplicative hashing: as good as noise, and the same every time.
        let noise = |k: usize| f64::from((k as u32).wrapping_mul(2_654_435_769) >> 16) / 32768.0 - 1.0;
        let mut rhs: Vec<[f64; 2]> =
            (0..self.matrix().pattern().n_nodes()).map(|node| [noise(2 * node + 1), noise(2 * node + 2)]).collect();
        self.matrix().held().iter().for_each(|&node| rhs[node as usize] = [0.0; 2]);
        self.jacobi().solve(self.matrix(), &rhs, reduction, most).1.iterations
    }

    /// Solves for `rhs`: to the digits of its factor (double with a penalty, else single), without one to 0.3 % or
    /// less, in single precision; any of these is enough inside an outer iteration.
    pub fn solve(&self, mut rhs: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
        if let Some(within) = &self.within {
            return within.solution(rhs, self.matrix().held());
        }
        self.matrix().held().iter().for_each(|&node| rhs[node as usize] = [0.0; 2]);
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
            _ => single = self.system.compact().solve(&single, self.reduction, MAX_ITERATIONS),
        }
        single.into_iter().map(|x| x.map(|x| f64::from(x) * scale)).collect()
    }
}

impl Within {
    /// `B (B^T M B)^-1 B^T` times a right-hand side of the nodes; those that are `held` take part in neither.
    fn solution(&self, mut rhs: Vec<[f64; 2]>, held: &[u32]) -> Vec<[f64; 2]> {
        held.iter().for_each(|&node| rhs[node as usize] = [0.0; 2]);
        let mut coefficients = self.subspace.right_hand_side(&rhs);
        self.factor.solve(&mut coefficients);
        let mut solution = self.subspace.field(&coefficients);
        held.iter().for_each(|&node| solution[node as usize] = [0.0; 2]);
        solution
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::{Pattern, alike};

    const SIDE: u32 = 12;

    fn elements() -> Vec<[u32; 4]> {
        let node = |i: u32, j: u32| j * (SIDE + 1) + i;
        let of = |(i, j): (u32, u32)| [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
        (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| (i, j))).map(of).collect()
    }

    /// Means of products of shape functions over a square, and of their gradients.
    const MASS: [[f64; 4]; 4] =
        [[4.0, 2.0, 1.0, 2.0], [2.0, 4.0, 2.0, 1.0], [1.0, 2.0, 4.0, 2.0], [2.0, 1.0, 2.0, 4.0]];
    const STIFFNESS: [[f64; 4]; 4] =
        [[4.0, -1.0, -2.0, -1.0], [-1.0, 4.0, -1.0, -2.0], [-2.0, -1.0, 4.0, -1.0], [-1.0, -2.0, -1.0, 4.0]];

    fn noise(k: u32) -> f64 {
        f64::from(k.wrapping_mul(2_654_435_769) >> 16) / 65536.0
    }

    /// Mass matrices of elements that weigh differently, those of which `lost` is true hardly anything.
    fn matrices(lost: impl Fn(u32) -> bool) -> Vec<ElementMatrix> {
        (0..SIDE * SIDE).map(|e| alike(MASS, if lost(e) { 0.01 } else { 0.5 + noise(e) })).collect()
    }

    fn assembled(matrices: &[ElementMatrix]) -> BlockMatrix {
        let elements = elements();
        let pattern = Arc::new(Pattern::new(((SIDE + 1) * (SIDE + 1)) as usize, &elements));
        BlockMatrix::assemble(&pattern, &elements, matrices)
    }

    fn load() -> Vec<[f64; 2]> {
        (0..(SIDE + 1) * (SIDE + 1)).map(|node| [noise(2 * node + 1) - 0.5, noise(2 * node + 2) - 0.5]).collect()
    }

    #[test]
    fn a_solver_made_in_the_memory_of_another_is_bit_for_bit_that_made_anew() {
        let elements = elements();
        let changed = |level: &Solver, lost: fn(u32) -> bool| {
            let matrices = matrices(lost);
            let mut nodes: Vec<u32> =
                (0..SIDE * SIDE).filter(|&e| lost(e)).flat_map(|e| elements[e as usize]).collect();
            nodes.sort_unstable();
            nodes.dedup();
            level.change_rows(&nodes, &elements, |e| &matrices[e as usize])
        };
        let [first, second]: [fn(u32) -> bool; 2] = [|e| e < 2 * SIDE, |e| e % SIDE == 5 || e == 3];
        let level = || {
            let level = Solver::iterative(assembled(&matrices(|_| false)));
            level.solve(load());
            level
        };
        let (one, other) = (level(), level());
        let before = changed(&one, first);
        before.solve(load());
        one.take_back(before);
        let (got, want) = (changed(&one, second), changed(&other, second));
        assert!(one.spare.lock().unwrap().is_empty(), "it is made in what was taken back");
        assert_eq!(got.matrix().blocks(), want.matrix().blocks());
        assert_eq!(got.matrix().blocks(), assembled(&matrices(second)).blocks());
        assert_eq!(got.jacobi().inverse, want.jacobi().inverse);
        assert_eq!(got.solve(load()), want.solve(load()));
        // What was made of no other solver is nothing to be kept.
        one.take_back(other);
        assert!(one.spare.lock().unwrap().is_empty());
    }

    #[test]
    fn a_penalty_over_a_few_elements_is_solved_with_without_a_factor() {
        let data = assembled(&matrices(|e| (40..44).contains(&e)));
        let stiffness: Vec<ElementMatrix> = (0..SIDE * SIDE).map(|_| alike(STIFFNESS, 1.0)).collect();
        let penalty = Arc::new(assembled(&stiffness));
        let order: Vec<usize> = (0..data.pattern().n_nodes()).collect();
        let want = Solver::regularised(data.clone(), penalty.clone(), &order).unwrap();
        let got = Solver::smoothed(data, penalty);
        assert_eq!((want.name(), got.name()), ("direct", "iterative"));
        assert_eq!(got.data().blocks(), want.data().blocks());
        let displacement: Vec<[f64; 2]> = (0..order.len()).map(|node| [0.1 * node as f64, 1.0]).collect();
        let [want, got] = [&want, &got].map(|solver| solver.correction(load(), &displacement));
        let square = |all: &[[f64; 2]]| all.as_flattened().iter().map(|v| v * v).sum::<f64>();
        let apart: Vec<[f64; 2]> = want.iter().zip(&got).map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect();
        // The residual has fallen to 0.3 %; the error, in another norm, by less.
        let ratio = (square(&apart) / square(&want)).sqrt();
        assert!(ratio < 0.03, "{ratio}");
    }
}
