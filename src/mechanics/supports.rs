//! What holds and what loads a joint, by component: supported nodes, rigid blocks, forces.
//!
//! A component of a node is free, held (its displacement is prescribed), or tied to a rigid block. A block moves as one body:
//! its point is held, loaded or free by component, and its rotation is free. The nodes of a block are no unknowns; its
//! own are the free components of its point and the rotation times a length, so that all are mm and all forces N/mm.

use super::error::ModelError;
use super::joint::JointMesh;
use nalgebra::{DMatrix, DVector};

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
    /// Which components of its nodes it moves: both of a block that is glued on, one where they can slide along the other (the lever
    /// of a test in mixed mode rests on rollers).
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
    fn centre(&self, positions: &[[f64; 2]]) -> [f64; 2] {
        let sum = self.nodes.iter().fold([0.0; 2], |sum, &node| {
            let [x, y] = positions[node as usize];
            [sum[0] + x, sum[1] + y]
        });
        sum.map(|sum| sum / self.nodes.len() as f64)
    }

    /// Root of the mean square distance of its nodes from their centre, mm; of one that moves one component, along the other
    /// axis. Zero where a rotation would not move its nodes against each other.
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

    /// Refuses nodes that are not there, nodes that are held or tied twice, blocks that are no bodies, and bodies that could move freely.
    pub(super) fn check(&self, mesh: &JointMesh, small: bool) -> Result<(), ModelError> {
        let n_nodes = mesh.nodes().len();
        let all = self.nodes.iter().chain(self.blocks.iter().flat_map(|block| &block.nodes));
        if let Some(&node) = all.clone().find(|&&node| node as usize >= n_nodes) {
            return Err(ModelError::PrescribedNode { node, n_nodes });
        }
        let mut taken = vec![[false; 2]; n_nodes];
        self.nodes.iter().zip(&self.held).for_each(|(&node, held)| taken[node as usize] = *held);
        for block in &self.blocks {
            if !block.tied.contains(&true) || block.nodes.is_empty() || block.radius(mesh.nodes()) == 0.0 {
                return Err(ModelError::NoBody { block: block.name.clone() });
            }
            if !small && block.tied != [true; 2] {
                return Err(ModelError::LeverTurns { block: block.name.clone() });
            }
            for &node in &block.nodes {
                for c in (0..2).filter(|&c| block.tied[c]) {
                    if std::mem::replace(&mut taken[node as usize][c], true) {
                        let component = ["x", "y"][c];
                        return Err(ModelError::TiedTwice { block: block.name.clone(), node, component });
                    }
                }
            }
        }
        match self.free_motion(mesh) {
            None => Ok(()),
            Some((what, motion)) => Err(ModelError::Mechanism { what, motion }),
        }
    }

    /// A rigid motion that nothing opposes: of which body, and which. Bodies are the strips, those that adhesive joins being one, and
    /// the blocks; what holds them are supports and ties.
    fn free_motion(&self, mesh: &JointMesh) -> Option<(String, String)> {
        let body_of = bodies(mesh);
        let n_bodies = body_of.iter().max().map_or(0, |&last| last + 1);
        let size = mesh.extent();
        // Unknowns: displacement along x, y, and rotation times the size, of each body about the origin of the mesh, then of each
        // block about its point.
        let n = 3 * (n_bodies + self.blocks.len());
        let mut rows: Vec<DVector<f64>> = Vec::new();
        let centre = mesh.nodes()[0];
        let moved = |first: usize, about: [f64; 2], at: [f64; 2], c: usize, sign: f64, row: &mut DVector<f64>| {
            row[first + c] += sign;
            let lever = if c == 0 { about[1] - at[1] } else { at[0] - about[0] };
            row[first + 2] += sign * lever / size;
        };
        for (&node, held) in self.nodes.iter().zip(&self.held) {
            for c in (0..2).filter(|&c| held[c]) {
                let mut row = DVector::zeros(n);
                moved(3 * body_of[node as usize], centre, mesh.nodes()[node as usize], c, 1.0, &mut row);
                rows.push(row);
            }
        }
        for (k, block) in self.blocks.iter().enumerate() {
            let first = 3 * (n_bodies + k);
            for c in 0..2 {
                // A component that the block does not move is none of its unknowns.
                if block.held[c] || !block.tied[c] {
                    let mut row = DVector::zeros(n);
                    row[first + c] = 1.0;
                    rows.push(row);
                }
            }
            for &node in &block.nodes {
                for c in (0..2).filter(|&c| block.tied[c]) {
                    let (mut row, at) = (DVector::zeros(n), mesh.nodes()[node as usize]);
                    moved(3 * body_of[node as usize], centre, at, c, 1.0, &mut row);
                    moved(first, block.point, at, c, -1.0, &mut row);
                    rows.push(row);
                }
            }
        }
        let mut gram = DMatrix::zeros(n, n);
        rows.iter().for_each(|row| gram += row * row.transpose());
        let eigen = gram.symmetric_eigen();
        let (least, value) = eigen.eigenvalues.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1))?;
        let largest = eigen.eigenvalues.max();
        if *value > 1e-12 * largest {
            return None;
        }
        let motion = eigen.eigenvectors.column(least);
        let size_of = |k: usize| (0..3).map(|c| motion[3 * k + c].abs()).fold(0.0, f64::max);
        let body = (0..n / 3).max_by(|&a, &b| size_of(a).total_cmp(&size_of(b)))?;
        let part = |c: usize| motion[3 * body + c].abs() > 1e-6 * size_of(body);
        let motion = match (part(0), part(1), part(2)) {
            (_, _, true) => "turn",
            (true, false, false) => "move along x",
            (false, true, false) => "move along y",
            _ => "move",
        };
        let what = match body.checked_sub(n_bodies) {
            Some(block) => format!("the rigid block \"{}\"", self.blocks[block].name),
            None => {
                let node = body_of.iter().position(|&of| of == body)?;
                let [x, y] = mesh.nodes()[node];
                format!("the body with node {node} at ({x}, {y}) mm")
            }
        };
        Some((what, motion.to_owned()))
    }
}

/// Number of the body of each node: strips that adhesive joins are one. Faces that only touch join nothing.
fn bodies(mesh: &JointMesh) -> Vec<usize> {
    let mut body: Vec<usize> = (0..mesh.n_strips()).collect();
    for (corners, &cracked) in mesh.interfaces().iter().zip(mesh.cracked()) {
        let [a, b] = [corners[0], corners[2]].map(|node| body[mesh.strip()[node as usize] as usize]);
        if !cracked && a != b {
            body.iter_mut().filter(|of| **of == a.max(b)).for_each(|of| *of = a.min(b));
        }
    }
    let mut names: Vec<usize> = body.clone();
    names.sort_unstable();
    names.dedup();
    let number = |strip: u32| names.iter().position(|&name| name == body[strip as usize]).unwrap_or(0);
    mesh.strip().iter().map(|&strip| number(strip)).collect()
}
