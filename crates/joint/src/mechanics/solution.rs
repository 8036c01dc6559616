//! What a run gives.

use super::cohesive::{Jump, Parameter};

/// How an instant ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Status {
    /// By Newton, in one or several increments.
    Converged,
    /// Node pairs snapped: viscous steps or the secant iteration carried the field over.
    Rescued,
    /// Not even the smallest increment converged; the field is that of the last increment that did.
    NotConverged,
    /// An earlier instant did not converge; there is no field.
    #[default]
    NotReached,
}

impl Status {
    /// Whether there is a solution.
    pub fn converged(self) -> bool {
        matches!(self, Self::Converged | Self::Rescued)
    }

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Rescued => "rescued",
            Self::NotConverged => "not_converged",
            Self::NotReached => "not_reached",
        }
    }
}

/// Where an instant failed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Failure {
    /// Share of the step from the instant before that was reached, 0 to 1.
    pub share: f64,
}

/// The result of one instant; by default one that was not reached.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Instant {
    /// How it ended.
    pub status: Status,
    /// Displacement of every node, mm; empty when the instant was not reached.
    pub displacement: Vec<[f64; 2]>,
    /// Newton iterations over all increments, failed ones included.
    pub iterations: u32,
    /// How often the increment was halved.
    pub halvings: u32,
    /// Viscous steps and secant iterations; 0 when no rescue was needed.
    pub rescue_iterations: u32,
    /// Largest residual force over the largest nodal force, before the last correction.
    pub residual: f64,
    /// The same at every iterate of the last increment.
    pub residuals: Vec<f64>,
    /// Node pairs (numbers in [`super::JointMesh::pairs`]) that snapped, or that moved most where the instant
    /// failed.
    pub snapped: Vec<usize>,
    /// Where it failed, when it did.
    pub failure: Option<Failure>,
    /// Derivative of every node's displacement by each parameter of [`Solution::parameters`], mm per unit of the
    /// parameter; zero at prescribed nodes. Empty when not asked for or not converged.
    pub sensitivities: Vec<Vec<[f64; 2]>>,
}

impl Instant {
    /// Notes the pairs that moved at least half as far as the one that moved most.
    pub(super) fn add_snapped(&mut self, before: &[Jump], after: &[Jump]) {
        let moved = |(a, b): (&Jump, &Jump)| (a.normal - b.normal).hypot(a.tangential - b.tangential);
        let moved: Vec<f64> = before.iter().zip(after).map(moved).collect();
        let most = moved.iter().copied().fold(0.0, f64::max);
        self.snapped.extend((0..moved.len()).filter(|&k| moved[k] > 0.0 && moved[k] >= 0.5 * most));
        self.snapped.sort_unstable();
        self.snapped.dedup();
    }
}

/// A parameter that displacements are derived by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sensitivity {
    /// The parameter.
    pub parameter: Parameter,
    /// Element group whose material it belongs to; `None` for the cohesive law.
    pub group: Option<usize>,
}

/// The result of a run: one entry per instant of the boundary history.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The instants, in order.
    pub instants: Vec<Instant>,
    /// What the sensitivities of each instant are by, in order.
    pub parameters: Vec<Sensitivity>,
}

impl Solution {
    /// Whether every instant has a solution.
    pub fn converged(&self) -> bool {
        self.instants.iter().all(|instant| instant.status.converged())
    }
}
