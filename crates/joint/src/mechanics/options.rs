//! How a forward problem is solved, and what is computed with it.

/// How far the iteration goes before it gives up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewtonOptions {
    /// Largest residual force over the largest nodal force (reactions included) at which an increment has
    /// converged. One more correction follows, so that the error left is its square.
    pub tolerance: f64,
    /// Iterations per increment.
    pub max_iterations: u32,
    /// How often an increment is halved: the smallest is `2^-max_halvings` of the step between two instants.
    pub max_halvings: u32,
    /// Viscous steps, and secant iterations, of a rescue.
    pub max_rescue: u32,
}

impl Default for NewtonOptions {
    fn default() -> Self {
        Self { tolerance: 1e-11, max_iterations: 25, max_halvings: 6, max_rescue: 400 }
    }
}

/// What to compute beside the displacements.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ForwardOptions {
    /// The iteration.
    pub newton: NewtonOptions,
    /// Derivatives of the displacements by the parameters of the cohesive law.
    pub law_sensitivities: bool,
    /// Derivatives by the parameters of the materials, group by group.
    pub substrate_sensitivities: bool,
}
