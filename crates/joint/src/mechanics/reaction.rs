//! One component of the reaction of a group of nodes, with all its derivatives: what a load cell sees (THEORY 15).

use super::cohesive::CohesiveLaw;
use super::{Model, NodeGroup};

/// Where a reaction is summed: the prescribed components of the nodes of a group along a direction.
#[derive(Debug, Clone, PartialEq)]
pub struct ReactionGauge {
    /// Nodes and what each component of the force on them counts.
    weights: Vec<(u32, [f64; 2])>,
    /// The elements at these nodes.
    elements: Vec<u32>,
}

/// A reaction under one field, N per mm of width, and its derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct ReactionAt {
    /// The reaction.
    pub value: f64,
    /// Its derivative by each parameter of the law at fixed displacements, and by what else is asked for.
    pub by_law: Vec<f64>,
    /// Its derivative by the displacements of the nodes nearby, N/mm per mm.
    by_displacement: Vec<(u32, [f64; 2])>,
}

impl ReactionAt {
    /// Its change, to first order, when all nodes move by `field` (one vector per node).
    pub fn change(&self, field: &[[f64; 2]]) -> f64 {
        self.by_displacement
            .iter()
            .map(|&(node, [x, y])| {
                let [ux, uy] = field[node as usize];
                x * ux + y * uy
            })
            .sum()
    }
}

impl Model {
    /// The reaction of `group` along the unit vector `direction`: the force that holds its prescribed components.
    pub fn reaction_gauge(&self, group: &NodeGroup, direction: [f64; 2]) -> ReactionGauge {
        let held = |node: u32| {
            let weight = |c: usize| if self.unknown(node as usize, c).is_none() { direction[c] } else { 0.0 };
            (node, [weight(0), weight(1)])
        };
        let weights: Vec<(u32, [f64; 2])> =
            group.nodes.iter().map(|&node| held(node)).filter(|(_, weight)| *weight != [0.0; 2]).collect();
        let mut here = vec![false; self.mesh().nodes().len()];
        weights.iter().for_each(|&(node, _)| here[node as usize] = true);
        let touches = |corners: &[u32; 4]| corners.iter().any(|&node| here[node as usize]);
        let elements = (0u32..).zip(self.corners()).filter(|(_, corners)| touches(corners)).map(|(k, _)| k).collect();
        ReactionGauge { weights, elements }
    }

    /// The reaction that `gauge` sums under the displacements `u`, with its derivatives.
    pub fn reaction_at(&self, gauge: &ReactionGauge, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> ReactionAt {
        let mut weight = vec![[0.0; 2]; u.len()];
        gauge.weights.iter().for_each(|&(node, of_node)| weight[node as usize] = of_node);
        let mut value = 0.0;
        let mut by_law = vec![0.0; law.parameters().len()];
        // By node, in the order in which the elements have them.
        let mut place = vec![usize::MAX; u.len()];
        let mut by_displacement: Vec<(u32, [f64; 2])> = Vec::new();
        for &element in &gauge.elements {
            let corners = self.corners()[element as usize];
            let weights: [f64; 8] = std::array::from_fn(|k| weight[corners[k / 2] as usize][k % 2]);
            let (force, stiffness) = self.tangent_of(element as usize, law, u);
            value += (0..8).map(|k| weights[k] * force[k]).sum::<f64>();
            if let Some(forces) = self.force_of_by_law(element as usize, law, u) {
                for (sum, force) in by_law.iter_mut().zip(&forces) {
                    *sum += (0..8).map(|k| weights[k] * force[k]).sum::<f64>();
                }
            }
            for column in 0..8 {
                let node = corners[column / 2];
                let at = &mut place[node as usize];
                if *at == usize::MAX {
                    *at = by_displacement.len();
                    by_displacement.push((node, [0.0; 2]));
                }
                let sum = (0..8).map(|row| weights[row] * stiffness[(row, column)]).sum::<f64>();
                by_displacement[*at].1[column % 2] += sum;
            }
        }
        ReactionAt { value, by_law, by_displacement }
    }

    /// Derivatives of the reaction by each parameter of the material of `group`, at fixed displacements.
    ///
    /// # Panics
    /// When there is no such group.
    pub fn reaction_by_material(&self, gauge: &ReactionGauge, group: usize, u: &[[f64; 2]]) -> Vec<f64> {
        let mut weight = vec![[0.0; 2]; u.len()];
        gauge.weights.iter().for_each(|&(node, of_node)| weight[node as usize] = of_node);
        let mut sums = vec![0.0; self.materials()[group].parameters().len()];
        for &element in &gauge.elements {
            let Some(forces) = self.force_of_by_material(element as usize, group, u) else { continue };
            let corners = self.corners()[element as usize];
            for (sum, force) in sums.iter_mut().zip(&forces) {
                *sum += (0..8).map(|k| weight[corners[k / 2] as usize][k % 2] * force[k]).sum::<f64>();
            }
        }
        sums
    }
}
