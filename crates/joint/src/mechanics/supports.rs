//! What holds and what loads a joint, by component: supported nodes, rigid blocks, forces.
//!
//! A component of a node is free, held (its displacement is prescribed), or tied to a rigid block. A block moves as one
//! body: its point is held, loaded or free by component, and its rotation is free. The nodes of a block are no
//! unknowns; its own are the free components of its point and the rotation times a length, so that all are mm and all
//! forces N/mm.

/// Supported nodes and rigid blocks of a model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Supports {
    /// Supported nodes.
    pub nodes: Vec<u32>,
    /// Of each, which components (x, y) are held.
    pub held: Vec<[bool; 2]>,
    /// Rigid blocks.
    pub blocks: Vec<RigidBlock>,
}

/// Nodes that move as one body.
#[derive(Debug, Clone, PartialEq)]
pub struct RigidBlock {
    /// Its name in messages and results.
    pub name: String,
    /// The nodes.
    pub nodes: Vec<u32>,
    /// Which components of its nodes it moves: both of a block that is glued on, one where they can slide along the
    /// other (the lever of a test in mixed mode rests on rollers).
    pub tied: [bool; 2],
    /// The point whose displacement is prescribed, or that is loaded, mm at rest.
    pub point: [f64; 2],
    /// Which components of the point are held.
    pub held: [bool; 2],
}

/// Displacement of the point of a block, mm, and its rotation, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct BlockMotion {
    pub point: [f64; 2],
    pub rotation: f64,
}

impl RigidBlock {
    /// Mean position of its nodes at rest, mm.
    pub(super) fn centre(&self, positions: &[[f64; 2]]) -> [f64; 2] {
        let sum = self.nodes.iter().fold([0.0; 2], |sum, &node| {
            let [x, y] = positions[node as usize];
            [sum[0] + x, sum[1] + y]
        });
        sum.map(|sum| sum / self.nodes.len() as f64)
    }

    /// Root of the mean square distance of its nodes from their centre, mm; of one that moves one component, along the
    /// other axis. Zero where a rotation would not move its nodes against each other.
    pub(super) fn radius(&self, positions: &[[f64; 2]]) -> f64 {
        let centre = self.centre(positions);
        let square = |&node: &u32| {
            let [x, y] = [0, 1].map(|c| positions[node as usize][c] - centre[c]);
            let along = if self.tied[1] { x * x } else { 0.0 };
            along + if self.tied[0] { y * y } else { 0.0 }
        };
        (self.nodes.iter().map(square).sum::<f64>() / self.nodes.len() as f64).sqrt()
    }

    /// How the block moves under the displacements `u`, which must be such that its nodes move as one body.
    pub(super) fn motion(&self, positions: &[[f64; 2]], u: &[[f64; 2]], small: bool) -> BlockMotion {
        let centre = self.centre(positions);
        let moved = self.centre(u);
        let (mut cross, mut dot) = (0.0, 0.0);
        for &node in &self.nodes {
            let (at, u) = (positions[node as usize], u[node as usize]);
            let r = [0, 1].map(|c| at[c] - centre[c]);
            let by = [0, 1].map(|c| if self.tied[c] { u[c] - moved[c] } else { 0.0 });
            cross += r[0] * by[1] - r[1] * by[0];
            let squares = [1, 0].map(|c: usize| if self.tied[c] { r[1 - c] * r[1 - c] } else { 0.0 });
            dot += if small { squares[0] + squares[1] } else { r[0] * (r[0] + by[0]) + r[1] * (r[1] + by[1]) };
        }
        let rotation = if small { cross / dot } else { cross.atan2(dot) };
        let arm = [0, 1].map(|c| self.point[c] - centre[c]);
        let turned = turned(arm, rotation, small);
        BlockMotion { point: [0, 1].map(|c| moved[c] + turned[c]), rotation }
    }

    /// Moves its nodes in `u` as `motion` says.
    pub(super) fn place(&self, positions: &[[f64; 2]], motion: &BlockMotion, small: bool, u: &mut [[f64; 2]]) {
        for &node in &self.nodes {
            let at = positions[node as usize];
            let turned = turned([0, 1].map(|c| at[c] - self.point[c]), motion.rotation, small);
            for c in (0..2).filter(|&c| self.tied[c]) {
                u[node as usize][c] = motion.point[c] + turned[c];
            }
        }
    }

    /// Of each of its nodes, how it moves with the rotation: the derivative of its displacement, mm per rad.
    pub(super) fn levers(&self, positions: &[[f64; 2]], u: &[[f64; 2]], small: bool) -> Vec<[f64; 2]> {
        let rotation = if small { 0.0 } else { self.motion(positions, u, small).rotation };
        let (sin, cos) = rotation.sin_cos();
        let lever = |&node: &u32| {
            let r = [0, 1].map(|c| positions[node as usize][c] - self.point[c]);
            let now = [cos * r[0] - sin * r[1], sin * r[0] + cos * r[1]];
            [if self.tied[0] { -now[1] } else { 0.0 }, if self.tied[1] { now[0] } else { 0.0 }]
        };
        self.nodes.iter().map(lever).collect()
    }
}

/// What a rotation adds to the displacement at the end of `arm`.
fn turned([x, y]: [f64; 2], rotation: f64, small: bool) -> [f64; 2] {
    if small {
        return [-rotation * y, rotation * x];
    }
    // 1 - cos without cancellation.
    let (sin, less) = (rotation.sin(), 2.0 * (0.5 * rotation).sin().powi(2));
    [-less * x - sin * y, sin * x - less * y]
}

impl Supports {
    /// Nodes that are held in both components.
    pub fn of_nodes(nodes: &[u32]) -> Self {
        Self { nodes: nodes.to_vec(), held: vec![[true; 2]; nodes.len()], blocks: Vec::new() }
    }
}
