//! What is prescribed: the displacements of the outer border at every instant.

use super::error::BoundaryFault;
use crate::field::RigidMotion;
use std::collections::HashSet;

/// Displacements of a fixed set of nodes over the instants of a test; both components are prescribed.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryHistory {
    nodes: Vec<u32>,
    instants: Vec<Vec<[f64; 2]>>,
}

impl BoundaryHistory {
    /// `instants[i][k]` is the displacement (mm) of `nodes[k]` at instant `i`.
    ///
    /// # Errors
    /// No node or no instant, a node twice, a number of values that is not that of the nodes, a value that is not
    /// finite.
    pub fn new(nodes: Vec<u32>, instants: Vec<Vec<[f64; 2]>>) -> Result<Self, BoundaryFault> {
        if nodes.is_empty() {
            return Err(BoundaryFault::NoNode);
        }
        if instants.is_empty() {
            return Err(BoundaryFault::NoInstant);
        }
        let mut seen = HashSet::new();
        if let Some(&node) = nodes.iter().find(|&&node| !seen.insert(node)) {
            return Err(BoundaryFault::Twice { node });
        }
        for (k, values) in instants.iter().enumerate() {
            if values.len() != nodes.len() {
                return Err(BoundaryFault::Count { instant: k + 1, needed: nodes.len(), given: values.len() });
            }
            if let Some(at) = values.iter().position(|u| !(u[0].is_finite() && u[1].is_finite())) {
                return Err(BoundaryFault::NotFinite { instant: k + 1, node: nodes[at] });
            }
        }
        Ok(Self { nodes, instants })
    }

    /// The prescribed nodes.
    pub fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Displacements of the nodes at each instant, mm.
    pub fn instants(&self) -> &[Vec<[f64; 2]>] {
        &self.instants
    }

    /// The first `n` instants, or all when there are fewer.
    ///
    /// # Panics
    /// When `n` is zero.
    pub fn up_to(&self, n: usize) -> Self {
        assert!(n > 0, "at least one instant");
        Self { nodes: self.nodes.clone(), instants: self.instants[..n.min(self.instants.len())].to_vec() }
    }

    /// Takes off, at each instant, the rigid motion (exact rotation, least squares) of all prescribed nodes
    /// together, and gives it. `positions` are those of the mesh's nodes, mm.
    ///
    /// With the jump of the paper this choice changes the tractions (THEORY 9).
    pub fn without_rigid_motion(&self, positions: &[[f64; 2]]) -> (Self, Vec<RigidMotion>) {
        let mut motions = Vec::with_capacity(self.instants.len());
        let mut instants = Vec::with_capacity(self.instants.len());
        for values in &self.instants {
            let at = |k: usize| positions[self.nodes[k] as usize];
            let fit = RigidMotion::fit((0..self.nodes.len()).map(|k| (at(k), values[k])));
            let motion = fit.expect("at least one node");
            // x + u = R (x + v) + shift: what is left is turned back, so that no stretch of 1 - cos w remains.
            let (sin, cos) = motion.rotation_rad.sin_cos();
            let left = |k: usize| {
                let (u, rigid) = (values[k], motion.displacement(at(k)));
                let rest = [u[0] - rigid[0], u[1] - rigid[1]];
                [cos * rest[0] + sin * rest[1], -sin * rest[0] + cos * rest[1]]
            };
            instants.push((0..self.nodes.len()).map(left).collect());
            motions.push(motion);
        }
        (Self { nodes: self.nodes.clone(), instants }, motions)
    }
}
