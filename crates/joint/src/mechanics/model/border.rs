//! What holds, moves and loads a joint, between fields of all nodes and the unknowns.

use super::{Model, Work};
use crate::mechanics::element::{ElementStiffness, ElementVector};
use crate::mechanics::{BlockMotion, NONE, RigidBlock, TiedBlock};

impl Model {
    /// `-K_fD du_D` for displacements `du` that are zero at the free nodes: the forces that moving the border
    /// puts on the unknowns, with the stiffness of the last assembly.
    pub(in crate::mechanics) fn pull_of_border(&self, du: &[[f64; 2]], work: &Work, pull: &mut [f64]) {
        self.pull(du, work, |stiffness, du| stiffness * du, pull);
    }

    /// `-K_Df^T du_D`: the same of the transposed stiffness.
    pub(in crate::mechanics) fn transposed_pull_of_border(&self, du: &[[f64; 2]], work: &Work, pull: &mut [f64]) {
        self.pull(du, work, |stiffness, du| stiffness.tr_mul(du), pull);
    }

    fn pull(
        &self,
        du: &[[f64; 2]],
        work: &Work,
        times: impl Fn(&ElementStiffness, &ElementVector) -> ElementVector,
        pull: &mut [f64],
    ) {
        pull.fill(0.0);
        for &element in &self.coupled {
            let force = times(&work.stiffness[element as usize], &self.gather(element as usize, du));
            for (k, &node) in self.corners[element as usize].iter().enumerate() {
                for c in 0..2 {
                    let unknown = self.unknowns[node as usize][c];
                    if unknown != NONE {
                        pull[unknown as usize] -= force[2 * k + c];
                    }
                }
            }
        }
        for tied in &self.tied {
            let element = tied.element as usize;
            let force = times(&work.stiffness[element], &self.gather(element, du));
            let on = self.transformation(tied, &work.levers).tr_mul(&force);
            for (&unknown, force) in tied.unknowns.iter().zip(on.iter()) {
                // Those of nodes have it already.
                if self.owners[unknown as usize].0 as usize >= self.mesh.nodes().len() {
                    pull[unknown as usize] -= force;
                }
            }
        }
    }

    /// What forces at the nodes, and `loads` at the points of the blocks less them, are on the unknown of `owner`.
    fn on_owner(&self, (id, c): (u32, u8), force: &[[f64; 2]], levers: &[Vec<[f64; 2]>]) -> f64 {
        let Some(k) = (id as usize).checked_sub(self.mesh.nodes().len()) else { return force[id as usize][c as usize] };
        let (block, rigid) = (&self.blocks[k], &self.supports.blocks[k]);
        let tied = |node: u32| [0, 1].map(|c| if rigid.tied[c] { force[node as usize][c] } else { 0.0 });
        match c {
            2 => {
                let turn = |(&node, lever): (&u32, &[f64; 2])| tied(node)[0] * lever[0] + tied(node)[1] * lever[1];
                rigid.nodes.iter().zip(&levers[k]).map(turn).sum::<f64>() / block.radius
            }
            c => rigid.nodes.iter().map(|&node| tied(node)[c as usize]).sum(),
        }
    }

    /// The components of nodal forces on the unknowns, with the levers of the last evaluation; without what acts at the
    /// points of blocks.
    pub(in crate::mechanics) fn of_unknowns(&self, field: &[[f64; 2]], work: &Work) -> Vec<f64> {
        self.owners.iter().map(|&owner| self.on_owner(owner, field, &work.levers)).collect()
    }

    /// Internal less external force on each unknown, after an evaluation.
    pub(in crate::mechanics) fn residual(&self, work: &Work) -> Vec<f64> {
        let mut residual = self.of_unknowns(&work.force, work);
        for (block, load) in self.blocks.iter().zip(&work.loads[work.loaded.len()..]) {
            for c in (0..2).filter(|&c| block.unknowns[c] != NONE) {
                residual[block.unknowns[c] as usize] -= load[c];
            }
        }
        residual
    }

    /// Of each block, the forces at its point and its moment over its radius that are not in balance; zero in
    /// components that are held.
    pub(in crate::mechanics) fn residual_of_blocks(&self, work: &Work) -> Vec<[f64; 3]> {
        let n = self.mesh.nodes().len() as u32;
        let of = |(k, (block, load)): (u32, (&TiedBlock, &[f64; 2]))| {
            [0, 1, 2].map(|c: usize| match block.unknowns[c] {
                NONE => 0.0,
                _ => self.on_owner((n + k, c as u8), &work.force, &work.levers) - load.get(c).copied().unwrap_or(0.0),
            })
        };
        (0u32..).zip(self.blocks.iter().zip(&work.loads[work.loaded.len()..])).map(of).collect()
    }

    /// Adds what forces on the loaded nodes and at the blocks' points are on the unknowns, to `sum`.
    pub(in crate::mechanics) fn add_loads(&self, loaded: &[u32], loads: &[[f64; 2]], sum: &mut [f64]) {
        for (&node, load) in loaded.iter().zip(loads) {
            for c in 0..2 {
                let unknown = self.unknowns[node as usize][c];
                if unknown != NONE {
                    sum[unknown as usize] += load[c];
                }
            }
        }
        for (block, load) in self.blocks.iter().zip(loads.iter().skip(loaded.len())) {
            for c in (0..2).filter(|&c| block.unknowns[c] != NONE) {
                sum[block.unknowns[c] as usize] += load[c];
            }
        }
    }

    /// Adds `factor` times values of the unknowns to the displacements `field`. Blocks turn by as much.
    pub(in crate::mechanics) fn add_to_field(&self, values: &[f64], factor: f64, field: &mut [[f64; 2]]) {
        let motions = self.motions(field);
        self.add_to_nodes(values, factor, field);
        let (nodes, small) = (self.mesh.nodes(), self.options.kinematics.is_small());
        for ((block, rigid), mut motion) in self.blocks.iter().zip(&self.supports.blocks).zip(motions) {
            let value = |c: usize| values.get(block.unknowns[c] as usize).copied().unwrap_or(0.0);
            (0..2).for_each(|c| motion.point[c] += factor * value(c));
            motion.rotation += factor * value(2) / block.radius;
            rigid.place(nodes, &motion, small, field);
        }
    }

    /// Adds values of the unknowns to a nodal field that is a derivative of the displacements, with the levers of the
    /// last evaluation.
    pub(in crate::mechanics) fn add_to_derivative(&self, values: &[f64], work: &Work, field: &mut [[f64; 2]]) {
        self.add_to_nodes(values, 1.0, field);
        for ((block, rigid), levers) in self.blocks.iter().zip(&self.supports.blocks).zip(&work.levers) {
            let value = |c: usize| values.get(block.unknowns[c] as usize).copied().unwrap_or(0.0);
            for (&node, lever) in rigid.nodes.iter().zip(levers) {
                for c in (0..2).filter(|&c| rigid.tied[c]) {
                    field[node as usize][c] += value(c) + value(2) * lever[c] / block.radius;
                }
            }
        }
    }

    fn add_to_nodes(&self, values: &[f64], factor: f64, field: &mut [[f64; 2]]) {
        let n_nodes = self.mesh.nodes().len();
        for (&(id, c), value) in self.owners.iter().zip(values) {
            if (id as usize) < n_nodes {
                field[id as usize][c as usize] += factor * value;
            }
        }
    }

    fn motions(&self, u: &[[f64; 2]]) -> Vec<BlockMotion> {
        let (nodes, small) = (self.mesh.nodes(), self.options.kinematics.is_small());
        self.supports.blocks.iter().map(|block| block.motion(nodes, u, small)).collect()
    }

    /// Displacement of the point of each rigid block under the displacements `u`, mm, in the order of
    /// [`Supports::blocks`](crate::mechanics::Supports).
    pub fn block_displacements(&self, u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        self.motions(u).into_iter().map(|motion| motion.point).collect()
    }

    /// Where the border is in the field `u`: displacements of the prescribed nodes, then of the blocks' points.
    pub(in crate::mechanics) fn border(&self, u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let nodes = self.supports.nodes.iter().map(|&node| u[node as usize]);
        nodes.chain(self.motions(u).into_iter().map(|motion| motion.point)).collect()
    }

    /// Puts the held components of the border in the field `u` where `border` says; the nodes of blocks move along.
    pub(in crate::mechanics) fn set_border(&self, border: &[[f64; 2]], u: &mut [[f64; 2]]) {
        for ((&node, held), to) in self.supports.nodes.iter().zip(&self.supports.held).zip(border) {
            (0..2).filter(|&c| held[c]).for_each(|c| u[node as usize][c] = to[c]);
        }
        let motions = self.motions(u);
        for ((rigid, motion), to) in self.supports.blocks.iter().zip(motions).zip(&border[self.supports.nodes.len()..])
        {
            for c in (0..2).filter(|&c| rigid.held[c] && rigid.tied[c]) {
                rigid.nodes.iter().for_each(|&node| u[node as usize][c] += to[c] - motion.point[c]);
            }
        }
    }

    /// Adds what moving the held components of the border by `places` does to its nodes, and to those of blocks, to the
    /// derivative `field`.
    pub(in crate::mechanics) fn add_border_change(&self, places: &[[f64; 2]], field: &mut [[f64; 2]]) {
        for ((&node, held), by) in self.supports.nodes.iter().zip(&self.supports.held).zip(places) {
            (0..2).filter(|&c| held[c]).for_each(|c| field[node as usize][c] += by[c]);
        }
        for (rigid, by) in self.supports.blocks.iter().zip(&places[self.supports.nodes.len()..]) {
            for c in (0..2).filter(|&c| rigid.held[c] && rigid.tied[c]) {
                rigid.nodes.iter().for_each(|&node| field[node as usize][c] += by[c]);
            }
        }
    }

    /// Displacements of `loaded` nodes, then of the blocks' points.
    pub(in crate::mechanics) fn loaded_places(&self, loaded: &[u32], u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let nodes = loaded.iter().map(|&node| u[node as usize]);
        nodes.chain(self.motions(u).into_iter().map(|motion| motion.point)).collect()
    }

    /// The rates of [`Model::loaded_places`] where the unknowns change at the rates `values`, the border at `places`
    /// and the nodes at `field`.
    pub(in crate::mechanics) fn loaded_rates(
        &self,
        loaded: &[u32],
        values: &[f64],
        places: &[[f64; 2]],
        field: &[[f64; 2]],
    ) -> Vec<[f64; 2]> {
        let of_block = |((block, rigid), place): ((&TiedBlock, &RigidBlock), &[f64; 2])| {
            [0, 1].map(|c| match values.get(block.unknowns[c] as usize) {
                Some(&value) => value,
                None if rigid.held[c] => place[c],
                None => 0.0,
            })
        };
        let blocks = self.blocks.iter().zip(&self.supports.blocks).zip(&places[self.supports.nodes.len()..]);
        loaded.iter().map(|&node| field[node as usize]).chain(blocks.map(of_block)).collect()
    }

    /// The forces that hold the border, N/mm, after an evaluation: at the prescribed nodes, then at the blocks' points;
    /// zero in components that are not held.
    pub(in crate::mechanics) fn holding(&self, work: &Work) -> Vec<[f64; 2]> {
        let at_node = |(&node, held): (&u32, &[bool; 2])| {
            [0, 1].map(|c| if held[c] { work.force[node as usize][c] } else { 0.0 })
        };
        let at_point = |(rigid, load): (&RigidBlock, &[f64; 2])| {
            [0, 1].map(|c| {
                let sum = || rigid.nodes.iter().map(|&node| work.force[node as usize][c]).sum::<f64>() - load[c];
                if rigid.held[c] && rigid.tied[c] { sum() } else { 0.0 }
            })
        };
        let nodes = self.supports.nodes.iter().zip(&self.supports.held).map(at_node);
        nodes.chain(self.supports.blocks.iter().zip(&work.loads[work.loaded.len()..]).map(at_point)).collect()
    }

    /// Node of an unknown; of a block's, its first.
    pub(in crate::mechanics) fn node_of(&self, unknown: usize) -> u32 {
        let id = self.owners[unknown].0;
        (id as usize).checked_sub(self.mesh.nodes().len()).map_or(id, |block| self.supports.blocks[block].nodes[0])
    }
}
