//! What is prescribed: the displacements of the outer border at every instant.

use super::{BoundaryFault, RigidBlock, Supports};
use crate::field::RigidMotion;
use std::collections::{HashMap, HashSet};

/// What drives a joint over the instants of a test: displacements of a fixed set of nodes, in both components or one,
/// and, where there are such, of rigid blocks, and forces.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryHistory {
    nodes: Vec<u32>,
    /// Which components of each node are prescribed.
    held: Vec<[bool; 2]>,
    /// Zero in components that are not.
    instants: Vec<Vec<[f64; 2]>>,
    blocks: Vec<RigidBlock>,
    /// Of each instant the displacements of the blocks' points.
    block_instants: Vec<Vec<[f64; 2]>>,
    /// Nodes with a force of their own, rising; the forces at each instant, then those at the blocks' points, N/mm.
    loaded: Vec<u32>,
    forces: Vec<Vec<[f64; 2]>>,
}

/// Supports and loads that come to a border, or stand for one: groups of nodes driven by component.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Drives {
    /// Supported nodes: the node, its component (0: x, 1: y), its displacement at each instant (mm), and the name of
    /// its group.
    pub supports: Vec<(u32, usize, Vec<f64>, String)>,
    /// Rigid blocks, and the displacements of their points at each instant; zero in components that are not held.
    pub blocks: Vec<(RigidBlock, Vec<[f64; 2]>)>,
    /// Loaded nodes and the forces on them at each instant, N per mm of width; a node may stand several times.
    pub loads: Vec<(u32, Vec<[f64; 2]>)>,
    /// Forces at the points of blocks: the number of the block, the forces at each instant.
    pub block_loads: Vec<(usize, Vec<[f64; 2]>)>,
}

/// Where the border is, and what pulls at it, at one time: displacements of the prescribed nodes, then of the blocks'
/// points; forces on the loaded nodes, then on the blocks' points.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Drive {
    pub places: Vec<[f64; 2]>,
    pub forces: Vec<[f64; 2]>,
}

impl Drive {
    /// Between two of them: this one at 0, `to` at 1.
    pub fn between(&self, to: &Self, share: f64) -> Self {
        let between = |from: &[[f64; 2]], to: &[[f64; 2]]| {
            from.iter().zip(to).map(|(a, b)| [0, 1].map(|c| a[c] + share * (b[c] - a[c]))).collect()
        };
        Self { places: between(&self.places, &to.places), forces: between(&self.forces, &to.forces) }
    }

    /// `self - other`.
    pub fn less(&self, other: &Self) -> Self {
        let less = |a: &[[f64; 2]], b: &[[f64; 2]]| a.iter().zip(b).map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect();
        Self { places: less(&self.places, &other.places), forces: less(&self.forces, &other.forces) }
    }
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
        let (held, none) = (vec![[true; 2]; nodes.len()], Self::empty(instants.len()));
        Ok(Self { nodes, held, instants, ..none })
    }

    /// A history of `n` instants in which nothing is prescribed.
    fn empty(n: usize) -> Self {
        let (nodes, held, blocks, loaded) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let [instants, block_instants, forces] = [(); 3].map(|()| vec![Vec::new(); n]);
        Self { nodes, held, instants, blocks, block_instants, loaded, forces }
    }

    /// A history of `n` instants in which `drives` alone act.
    ///
    /// # Errors
    /// As [`BoundaryHistory::with`]; no instant.
    pub fn of_drives(drives: &Drives, n: usize) -> Result<Self, BoundaryFault> {
        if n == 0 {
            return Err(BoundaryFault::NoInstant);
        }
        let made = Self::empty(n).with(drives)?;
        if made.nodes.is_empty() && made.blocks.is_empty() { Err(BoundaryFault::NoNode) } else { Ok(made) }
    }

    /// This history with `drives` beside it.
    ///
    /// # Errors
    /// A component of a node with two different values, a list that has not one value for each instant, a value that is
    /// not finite.
    pub fn with(mut self, drives: &Drives) -> Result<Self, BoundaryFault> {
        let n = self.instants.len();
        let counted = |given: usize| match given == n {
            true => Ok(()),
            false => Err(BoundaryFault::Instants { needed: n, given }),
        };
        let finite = |sums: &[f64], node: u32| match sums.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(at) => Err(BoundaryFault::NotFinite { instant: at + 1, node }),
        };
        let sums = |values: &[[f64; 2]]| values.iter().map(|v| v[0] + v[1]).collect::<Vec<f64>>();
        let mut place: HashMap<u32, usize> = self.nodes.iter().enumerate().map(|(k, &node)| (node, k)).collect();
        let mut by: HashMap<(u32, usize), &str> = HashMap::new();
        for (node, c, values, name) in &drives.supports {
            counted(values.len())?;
            finite(values, *node)?;
            let k = *place.entry(*node).or_insert_with(|| {
                self.nodes.push(*node);
                self.held.push([false; 2]);
                self.instants.iter_mut().for_each(|instant| instant.push([0.0; 2]));
                self.nodes.len() - 1
            });
            if self.held[k][*c] {
                let differs = |(instant, value): (&Vec<[f64; 2]>, &f64)| instant[k][*c] != *value;
                if let Some(at) = self.instants.iter().zip(values).position(differs) {
                    return Err(BoundaryFault::Contradiction {
                        node: *node,
                        component: ["x", "y"][*c],
                        first: by.get(&(*node, *c)).map_or("[boundary]".into(), |name| format!("\"{name}\"").into()),
                        second: name.as_str().into(),
                        instant: at + 1,
                        values: [self.instants[at][k][*c], values[at]],
                    });
                }
            }
            self.held[k][*c] = true;
            self.instants.iter_mut().zip(values).for_each(|(instant, &value)| instant[k][*c] = value);
            by.insert((*node, *c), name);
        }
        for (block, values) in &drives.blocks {
            counted(values.len())?;
            finite(&sums(values), block.nodes.first().copied().unwrap_or(0))?;
            self.blocks.push(block.clone());
            self.block_instants.iter_mut().zip(values).for_each(|(instant, &value)| instant.push(value));
        }
        let tied = |(node, _): &(u32, Vec<[f64; 2]>)| self.blocks.iter().any(|block| block.nodes.contains(node));
        if let Some((node, _)) = drives.loads.iter().find(|load| tied(load)) {
            return Err(BoundaryFault::LoadedBlock { node: *node });
        }
        let mut loaded: Vec<u32> = drives.loads.iter().map(|(node, _)| *node).collect();
        loaded.sort_unstable();
        loaded.dedup();
        let mut forces = vec![vec![[0.0; 2]; loaded.len() + self.blocks.len()]; n];
        let at_nodes = drives.loads.iter().map(|(node, values)| (loaded.partition_point(|other| other < node), values));
        let at_blocks = drives.block_loads.iter().map(|(block, values)| (loaded.len() + block, values));
        for (k, values) in at_nodes.chain(at_blocks) {
            counted(values.len())?;
            finite(&sums(values), loaded.get(k).copied().unwrap_or(0))?;
            for (forces, value) in forces.iter_mut().zip(values) {
                forces[k] = [forces[k][0] + value[0], forces[k][1] + value[1]];
            }
        }
        (self.loaded, self.forces) = (loaded, forces);
        Ok(self)
    }

    /// Which nodes are held in which components, and the rigid blocks.
    pub fn supports(&self) -> Supports {
        Supports { nodes: self.nodes.clone(), held: self.held.clone(), blocks: self.blocks.clone() }
    }

    /// Whether it is a border alone: nodes held in both components, no blocks, no forces.
    pub fn is_border(&self) -> bool {
        self.blocks.is_empty() && self.loaded.is_empty() && self.held.iter().all(|held| *held == [true; 2])
    }

    /// The nodes with forces of their own.
    pub fn loaded(&self) -> &[u32] {
        &self.loaded
    }

    /// The forces on [`BoundaryHistory::loaded`] at instant `k` (from 0), then those at the points of the blocks, N per
    /// mm of width.
    ///
    /// # Panics
    /// When there is no such instant.
    pub fn forces(&self, k: usize) -> &[[f64; 2]] {
        &self.forces[k]
    }

    /// Border and forces at instant `k` (from 0).
    pub(super) fn drive(&self, k: usize) -> Drive {
        Drive {
            places: self.instants[k].iter().chain(&self.block_instants[k]).copied().collect(),
            forces: self.forces[k].clone(),
        }
    }

    /// This history on a refined mesh: `nodes` are prescribed there as `held` says, with the values of `carry` of those
    /// here; the nodes of blocks are what `between` says.
    pub(super) fn carried(
        &self,
        nodes: Vec<u32>,
        held: Vec<[bool; 2]>,
        carry: impl Fn(&[[f64; 2]]) -> Vec<[f64; 2]>,
        between: impl Fn(&[u32]) -> Vec<u32>,
    ) -> Self {
        let blocks = self.blocks.iter().map(|block| RigidBlock { nodes: between(&block.nodes), ..block.clone() });
        let instants = self.instants.iter().map(|field| carry(field)).collect();
        Self { nodes, held, instants, blocks: blocks.collect(), ..self.clone() }
    }

    /// Border and forces at rest.
    pub(super) fn rest(&self) -> Drive {
        let n_blocks = self.blocks.len();
        Drive {
            places: vec![[0.0; 2]; self.nodes.len() + n_blocks],
            forces: vec![[0.0; 2]; self.loaded.len() + n_blocks],
        }
    }

    /// The instant (from 0) that `time` (0: rest, k: instant k from 1) leads to, and what is before it.
    pub(super) fn drive_before(&self, time: f64) -> (usize, Drive) {
        let k = (time.floor().max(0.0) as usize).min(self.instants.len() - 1);
        (k, if k == 0 { self.rest() } else { self.drive(k - 1) })
    }

    /// Border and forces at `time`, between the instants.
    pub(super) fn drive_at(&self, time: f64) -> Drive {
        let (k, from) = self.drive_before(time);
        from.between(&self.drive(k), time - k as f64)
    }

    /// The same supports and loads at other times: at each of `times` (0: rest, k: instant k) what is between the
    /// instants.
    #[must_use]
    pub fn at_times(&self, times: &[f64]) -> Self {
        let n = self.nodes.len();
        let drives: Vec<Drive> = times.iter().map(|&time| self.drive_at(time)).collect();
        Self {
            instants: drives.iter().map(|drive| drive.places[..n].to_vec()).collect(),
            block_instants: drives.iter().map(|drive| drive.places[n..].to_vec()).collect(),
            forces: drives.into_iter().map(|drive| drive.forces).collect(),
            ..self.clone()
        }
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
        let mut first = self.clone();
        first.instants.truncate(n);
        first.block_instants.truncate(n);
        first.forces.truncate(n);
        first
    }

    /// Takes off, at each instant, the rigid motion (exact rotation, least squares) of all prescribed nodes
    /// together, and gives it. `positions` are those of the mesh's nodes, mm. It is for nodes prescribed in both
    /// components.
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
        (Self { instants, ..self.clone() }, motions)
    }
}
