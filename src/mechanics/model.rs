//! The discrete joint: which displacements are unknown, and the forces and stiffness at a field of them.

use super::boundary::BoundaryHistory;
use super::cohesive::{CohesiveLaw, Jump, Touching, Traction};
use super::element::{ElementStiffness, ElementVector, Interface, InterfacePoint, Kinematics, Q4, Q4Point, Quadrature};
use super::error::ModelError;
use super::held::check;
use super::joint::JointMesh;
use super::substrate::{EngineeringStrain, Stress, SubstrateLaw, SubstrateState};
use super::supports::{BlockMotion, RigidBlock, Supports};
use super::tied::{NONE, Tied, TiedBlock};
use crate::linalg::{LuChoice, LuFactor, LuPlan, SparseMatrix, SparsePattern};
use nalgebra::Vector2;
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

/// Elements that a thread takes at a time.
const GRAIN: usize = 128;

/// How the joint is modelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ModelOptions {
    /// What counts as jump, and whether rotations are small.
    pub kinematics: Kinematics,
    /// Where tractions are evaluated.
    pub quadrature: Quadrature,
    /// Which factor of the tangent is made.
    pub solver: LuChoice,
}

/// A joint with its materials and its prescribed nodes: everything that stays when the adhesive's law and the
/// prescribed values change. Strips have unit thickness, so that forces are in N/mm.
#[derive(Debug)]
pub struct Model {
    mesh: JointMesh,
    materials: Vec<Arc<dyn SubstrateLaw>>,
    options: ModelOptions,
    supports: Supports,
    /// Per component of each node, its place among the unknowns.
    unknowns: Vec<[u32; 2]>,
    /// Of each unknown, its node and component; of a block, the number of the block from the number of nodes on, and 0 or 1 for its
    /// point, 2 for its rotation.
    owners: Vec<(u32, u8)>,
    /// Rigid blocks, and the elements with nodes of theirs.
    blocks: Vec<TiedBlock>,
    tied: Vec<Tied>,
    quads: Vec<Q4>,
    interfaces: Vec<Interface>,
    /// Length of the longest interface element, and of the mesh, mm.
    longest_interface: f64,
    extent: f64,
    /// Numbers of the two pairs of each interface element.
    end_pairs: Vec<[u32; 2]>,
    /// Nodes of all elements: the quadrilaterals, then the interfaces.
    corners: Vec<[u32; 4]>,
    /// Per element, where each entry of its stiffness, column by column, goes among the values of the matrix.
    places: Vec<[u32; 64]>,
    /// Elements that couple free and prescribed nodes.
    coupled: Vec<u32>,
    plan: LuPlan,
    pattern: Arc<SparsePattern>,
}

/// What is kept between evaluations of one run: no memory is asked for in an iteration.
#[derive(Debug)]
pub(super) struct Work {
    pub matrix: SparseMatrix,
    pub factor: LuFactor,
    stiffness: Vec<ElementStiffness>,
    forces: Vec<ElementVector>,
    /// Internal less external force at every node, N/mm.
    pub force: Vec<[f64; 2]>,
    /// Nodes with external forces, and these, then those at the points of the blocks.
    pub loaded: Vec<u32>,
    pub loads: Vec<[f64; 2]>,
    /// Of each block, how its nodes move with its rotation at the field of the last evaluation.
    pub levers: Vec<Vec<[f64; 2]>>,
}

/// Which stiffness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Stiffness {
    /// The derivative of the forces.
    Tangent,
    /// The matrix that gives the forces when multiplied with the displacements.
    Secant,
    /// The tangent with this share of the law's initial stiffness added at the interface: that of a viscous
    /// adhesive over a step of time.
    Viscous(f64),
}

impl Model {
    /// A model of `mesh` with one of `materials` for each of its groups, and the nodes whose displacements will be
    /// prescribed.
    ///
    /// # Errors
    /// A node that does not exist, a strip with fewer than two prescribed nodes, another number of materials than
    /// of groups.
    pub fn new(
        mesh: JointMesh,
        materials: Vec<Arc<dyn SubstrateLaw>>,
        prescribed: &[u32],
        options: ModelOptions,
    ) -> Result<Self, ModelError> {
        let n_nodes = mesh.nodes().len();
        if materials.len() != mesh.groups().len() {
            return Err(ModelError::Materials { needed: mesh.groups().len(), given: materials.len() });
        }
        if let Some(&node) = prescribed.iter().find(|&&node| node as usize >= n_nodes) {
            return Err(ModelError::PrescribedNode { node, n_nodes });
        }
        let mut is_prescribed = vec![false; n_nodes];
        prescribed.iter().for_each(|&node| is_prescribed[node as usize] = true);
        for strip in 0..mesh.n_strips() {
            let of_strip = || (0..n_nodes).filter(|&node| mesh.strip()[node] as usize == strip);
            let prescribed = of_strip().filter(|&node| is_prescribed[node]).count();
            if let Some(node) = of_strip().next().filter(|_| prescribed < 2) {
                let [x, y] = mesh.nodes()[node];
                return Err(ModelError::StripNotHeld { node, x, y, prescribed });
            }
        }
        Self::made(mesh, materials, Supports::of_nodes(prescribed), options)
    }

    /// A model whose nodes are held by component, or tied to rigid blocks.
    ///
    /// # Errors
    /// A node that does not exist, one that is held or tied twice, a body that can move freely, another number of materials than of
    /// groups.
    pub fn supported(
        mesh: JointMesh,
        materials: Vec<Arc<dyn SubstrateLaw>>,
        supports: Supports,
        options: ModelOptions,
    ) -> Result<Self, ModelError> {
        check(&supports, &mesh, options.kinematics.is_small())?;
        Self::made(mesh, materials, supports, options)
    }

    /// A model of `mesh` that is held as `boundary` says.
    ///
    /// # Errors
    /// As [`Model::new`] where all nodes are held in both components and nothing else holds or loads the joint, else as
    /// [`Model::supported`].
    pub fn for_boundary(
        mesh: JointMesh,
        materials: Vec<Arc<dyn SubstrateLaw>>,
        boundary: &BoundaryHistory,
        options: ModelOptions,
    ) -> Result<Self, ModelError> {
        match boundary.is_border() {
            true => Self::new(mesh, materials, boundary.nodes(), options),
            false => Self::supported(mesh, materials, boundary.supports(), options),
        }
    }

    /// A model that is held as this one is, of another mesh with the same nodes or with other options.
    ///
    /// # Errors
    /// As [`Model::supported`].
    pub fn held_alike(&self, mesh: JointMesh, options: ModelOptions) -> Result<Self, ModelError> {
        Self::made(mesh, self.materials.clone(), self.supports.clone(), options)
    }

    fn made(
        mesh: JointMesh,
        materials: Vec<Arc<dyn SubstrateLaw>>,
        supports: Supports,
        options: ModelOptions,
    ) -> Result<Self, ModelError> {
        let n_nodes = mesh.nodes().len();
        if materials.len() != mesh.groups().len() {
            return Err(ModelError::Materials { needed: mesh.groups().len(), given: materials.len() });
        }
        let at = |corners: &[u32; 4]| corners.map(|node| mesh.nodes()[node as usize]);
        let quad = |corners| Q4::new(at(corners), options.kinematics).expect("a checked element");
        let quads = mesh.elements().iter().map(quad).collect();
        let interface = |corners| {
            Interface::new(at(corners), options.quadrature, options.kinematics).expect("a checked interface element")
        };
        let interfaces: Vec<Interface> = mesh.interfaces().iter().map(interface).collect();
        let longest_interface = interfaces.iter().fold(0.0_f64, |most, interface| most.max(interface.length()));
        let extent = mesh.extent();
        let number: HashMap<[u32; 2], u32> = (0u32..).zip(mesh.pairs()).map(|(k, &pair)| (pair, k)).collect();
        let ends = |&[l1, l2, u1, u2]: &[u32; 4]| [[l1, u1], [l2, u2]].map(|pair| number[&pair]);
        let end_pairs = mesh.interfaces().iter().map(ends).collect();
        let corners: Vec<[u32; 4]> = mesh.elements().iter().chain(mesh.interfaces()).copied().collect();
        let mut blocks: Vec<TiedBlock> =
            supports.blocks.iter().map(|block| TiedBlock::new(block, mesh.nodes())).collect();
        // Components that are no unknowns: held, or moved by a block.
        let mut gone = vec![[false; 2]; n_nodes];
        supports.nodes.iter().zip(&supports.held).for_each(|(&node, held)| gone[node as usize] = *held);
        let mut master = vec![NONE; n_nodes];
        for (k, RigidBlock { nodes, tied, .. }) in (0u32..).zip(&supports.blocks) {
            for &node in nodes {
                master[node as usize] = k;
                (0..2).for_each(|c| gone[node as usize][c] |= tied[c]);
            }
        }
        // Blocks take part in the order of the unknowns as nodes at their centres do.
        let mut places = mesh.nodes().to_vec();
        places.extend(blocks.iter().map(|block| block.centre));
        let mut is_gone: Vec<bool> = gone.iter().map(|gone| *gone == [true; 2]).collect();
        is_gone.extend(blocks.iter().map(|_| false));
        let coupling = |corners: &[u32; 4]| {
            let mut of: Vec<u32> = corners.to_vec();
            of.extend(
                corners.iter().map(|&node| master[node as usize]).filter(|&k| k != NONE).map(|k| n_nodes as u32 + k),
            );
            of
        };
        let couplings: Vec<Vec<u32>> = corners.iter().map(coupling).collect();
        let order = banded_order(&places, &couplings, &is_gone);
        let mut unknowns = vec![[NONE; 2]; n_nodes];
        let mut owners: Vec<(u32, u8)> = Vec::new();
        for &id in &order {
            if let Some(block) = (id as usize).checked_sub(n_nodes) {
                blocks[block].number(id, &mut owners);
                continue;
            }
            for c in (0..2).filter(|&c| !gone[id as usize][c]) {
                unknowns[id as usize][c] = owners.len() as u32;
                owners.push((id, c as u8));
            }
        }
        let groups: Vec<Vec<u32>> = couplings
            .iter()
            .map(|couplings| {
                let of = |&id: &u32| match (id as usize).checked_sub(n_nodes) {
                    Some(block) => blocks[block].unknowns.to_vec(),
                    None => unknowns[id as usize].to_vec(),
                };
                let mut group: Vec<u32> = couplings.iter().flat_map(of).collect();
                group.retain(|&unknown| unknown != NONE);
                group.sort_unstable();
                group.dedup();
                group
            })
            .collect();
        let pattern = SparsePattern::from_groups(owners.len(), groups.iter().map(Vec::as_slice));
        let pattern = Arc::new(pattern);
        let is_tied = |corners: &[u32; 4]| corners.iter().any(|&node| master[node as usize] != NONE);
        let places = corners
            .par_iter()
            .map(|corners| {
                let mut places = [NONE; 64];
                if is_tied(corners) {
                    return places;
                }
                let unknown = |k: usize| unknowns[corners[k / 2] as usize][k % 2];
                for row in 0..8 {
                    for column in 0..8 {
                        if unknown(row) != NONE && unknown(column) != NONE {
                            let place = pattern.place(unknown(row) as usize, unknown(column) as usize);
                            places[8 * column + row] = place.expect("an entry of the pattern") as u32;
                        }
                    }
                }
                places
            })
            .collect();
        let tied: Vec<Tied> = (0u32..)
            .zip(corners.iter().zip(&groups))
            .filter(|(_, (corners, _))| is_tied(corners))
            .map(|(element, (_, group))| Tied::new(element, group.clone(), &pattern))
            .collect();
        let coupled = (0..corners.len() as u32)
            .filter(|&element| {
                let of = corners[element as usize].map(|node| unknowns[node as usize]);
                let (held, free) = (of.iter().flatten().any(|&u| u == NONE), !groups[element as usize].is_empty());
                held && free
            })
            .collect();
        let owner_at = |&(id, _): &(u32, u8)| match (id as usize).checked_sub(n_nodes) {
            Some(block) => blocks[block].centre,
            None => mesh.nodes()[id as usize],
        };
        let plan = LuPlan::new(&pattern, &owners.iter().map(owner_at).collect::<Vec<_>>(), options.solver);
        Ok(Self {
            mesh,
            materials,
            options,
            supports,
            unknowns,
            owners,
            blocks,
            tied,
            quads,
            interfaces,
            longest_interface,
            extent,
            end_pairs,
            corners,
            places,
            coupled,
            plan,
            pattern,
        })
    }

    /// The mesh.
    pub fn mesh(&self) -> &JointMesh {
        &self.mesh
    }

    /// The material of each group.
    pub fn materials(&self) -> &[Arc<dyn SubstrateLaw>] {
        &self.materials
    }

    /// How it is modelled.
    pub fn options(&self) -> &ModelOptions {
        &self.options
    }

    /// The prescribed nodes, in the order of every boundary history.
    pub fn prescribed(&self) -> &[u32] {
        &self.supports.nodes
    }

    /// Which nodes are held in which components, and the rigid blocks.
    pub fn supports(&self) -> &Supports {
        &self.supports
    }

    /// Number of unknown components.
    pub fn n_unknowns(&self) -> usize {
        self.owners.len()
    }

    /// Place of a component (0: x, 1: y) of a node among the unknowns; `None` when it is prescribed, or moved by a rigid block.
    pub fn unknown(&self, node: usize, component: usize) -> Option<usize> {
        let place = self.unknowns[node][component];
        (place != NONE).then_some(place as usize)
    }

    /// Where each unknown lies, mm.
    pub fn unknown_positions(&self) -> Vec<[f64; 2]> {
        let at = |&(id, _): &(u32, u8)| match (id as usize).checked_sub(self.mesh.nodes().len()) {
            Some(block) => self.blocks[block].centre,
            None => self.mesh.nodes()[id as usize],
        };
        self.owners.iter().map(at).collect()
    }

    /// Which factor of the tangent is made: `banded`, `sparse`, ....
    pub fn solver(&self) -> &'static str {
        self.plan.name()
    }

    /// Largest distance from the diagonal of an entry of the tangent.
    pub fn half_bandwidth(&self) -> usize {
        self.pattern.half_bandwidth()
    }

    pub(super) fn work(&self) -> Work {
        Work {
            matrix: SparseMatrix::zero(&self.pattern),
            factor: self.plan.factor(),
            stiffness: vec![ElementStiffness::zeros(); self.corners.len()],
            forces: vec![ElementVector::zeros(); self.corners.len()],
            force: vec![[0.0; 2]; self.mesh.nodes().len()],
            loaded: Vec::new(),
            loads: vec![[0.0; 2]; self.blocks.len()],
            levers: Vec::new(),
        }
    }

    fn material(&self, element: usize) -> &dyn SubstrateLaw {
        &*self.materials[self.mesh.element_group()[element] as usize]
    }

    /// Displacements of an element's nodes.
    fn gather(&self, element: usize, u: &[[f64; 2]]) -> ElementVector {
        let corners = &self.corners[element];
        ElementVector::from_fn(|k, _| u[corners[k / 2] as usize][k % 2])
    }

    /// Adds up the nodal forces of all elements, in their order.
    fn add_up(&self, forces: &[ElementVector], sum: &mut [[f64; 2]]) {
        sum.fill([0.0; 2]);
        for (corners, force) in self.corners.iter().zip(forces) {
            for (k, &node) in corners.iter().enumerate() {
                sum[node as usize][0] += force[2 * k];
                sum[node as usize][1] += force[2 * k + 1];
            }
        }
    }

    /// Takes the external forces off `work.force`.
    fn take_loads_off(work: &mut Work) {
        for (&node, load) in work.loaded.iter().zip(&work.loads) {
            let force = &mut work.force[node as usize];
            *force = [force[0] - load[0], force[1] - load[1]];
        }
    }

    /// Brings the levers of the blocks up to the field `u`.
    fn turn_levers(&self, u: &[[f64; 2]], work: &mut Work) {
        let (nodes, small) = (self.mesh.nodes(), self.options.kinematics.is_small());
        if !self.blocks.is_empty() {
            work.levers = self.supports.blocks.iter().map(|block| block.levers(nodes, u, small)).collect();
        }
    }

    /// The law at an interface element.
    fn bond<'a>(&self, element: usize, law: &'a dyn CohesiveLaw, touching: &'a Touching<'a>) -> &'a dyn CohesiveLaw {
        if self.mesh.cracked()[element] { touching } else { law }
    }

    /// Internal less external force and stiffness at the field `u`, into `work`.
    pub(super) fn assemble(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]], kind: Stiffness, work: &mut Work) {
        let n_quads = self.quads.len();
        let touching = Touching(law);
        let bond = |element: usize| self.bond(element - n_quads, law, &touching);
        let viscous = match kind {
            Stiffness::Viscous(share) => law.response(Jump::default()).tangent.diagonal() * share,
            Stiffness::Tangent | Stiffness::Secant => Vector2::zeros(),
        };
        let evaluate = |(element, (stiffness, force)): (usize, (&mut ElementStiffness, &mut ElementVector))| {
            let u = self.gather(element, u);
            match kind {
                Stiffness::Tangent | Stiffness::Viscous(_) if element < n_quads => {
                    (*force, *stiffness) = self.quads[element].tangent(self.material(element), &u);
                }
                Stiffness::Tangent | Stiffness::Viscous(_) => {
                    (*force, *stiffness) = self.interfaces[element - n_quads].tangent(bond(element), viscous, &u);
                }
                Stiffness::Secant => {
                    *stiffness = match element < n_quads {
                        true => self.quads[element].secant(self.material(element), &u),
                        false => self.interfaces[element - n_quads].secant(bond(element), &u),
                    };
                    *force = *stiffness * u;
                }
            }
        };
        let Work { matrix, stiffness, forces, force, .. } = work;
        stiffness.par_iter_mut().zip(forces.par_iter_mut()).with_min_len(GRAIN).enumerate().for_each(evaluate);
        self.add_up(forces, force);
        // In the order of the elements: the same bits for any number of threads.
        let values = matrix.values_mut();
        values.fill(0.0);
        for (places, stiffness) in self.places.iter().zip(stiffness.iter()) {
            for (&place, &entry) in places.iter().zip(stiffness.as_slice()) {
                if place != NONE {
                    values[place as usize] += entry;
                }
            }
        }
        Self::take_loads_off(work);
        self.turn_levers(u, work);
        self.assemble_tied(work);
    }

    /// The stiffness of the elements with nodes of blocks, and what the turning of the blocks adds.
    fn assemble_tied(&self, work: &mut Work) {
        for tied in &self.tied {
            let t = self.transformation(tied, &work.levers);
            let stiffness = t.tr_mul(&(work.stiffness[tied.element as usize] * &t));
            let values = work.matrix.values_mut();
            tied.places.iter().zip(stiffness.as_slice()).for_each(|(&place, entry)| values[place as usize] += entry);
        }
        if self.options.kinematics.is_small() {
            return;
        }
        for (block, (rigid, levers)) in self.blocks.iter().zip(self.supports.blocks.iter().zip(&work.levers)) {
            // The second derivative of a place by the rotation is minus its arm; the lever is the arm turned by 90 degrees.
            let along = |(&node, lever): (&u32, &[f64; 2])| {
                let force = work.force[node as usize];
                force[1] * lever[0] - force[0] * lever[1]
            };
            let second: f64 = rigid.nodes.iter().zip(levers).map(along).sum();
            let place = self.pattern.place(block.unknowns[2] as usize, block.unknowns[2] as usize);
            let place = place.expect("an entry of the pattern");
            work.matrix.values_mut()[place] += second / block.radius.powi(2);
        }
    }

    /// How the displacements of an element's nodes follow its unknowns.
    fn transformation(
        &self,
        tied: &Tied,
        levers: &[Vec<[f64; 2]>],
    ) -> nalgebra::OMatrix<f64, nalgebra::U8, nalgebra::Dyn> {
        let mut t = nalgebra::OMatrix::<f64, nalgebra::U8, nalgebra::Dyn>::zeros(tied.unknowns.len());
        let column = |unknown: u32| tied.unknowns.binary_search(&unknown).ok();
        for (k, &node) in self.corners[tied.element as usize].iter().enumerate() {
            for c in 0..2 {
                if let Some(column) = column(self.unknowns[node as usize][c]) {
                    t[(2 * k + c, column)] = 1.0;
                }
            }
            for ((block, rigid), levers) in self.blocks.iter().zip(&self.supports.blocks).zip(levers) {
                let Some(at) = rigid.nodes.iter().position(|&other| other == node) else { continue };
                for c in (0..2).filter(|&c| rigid.tied[c]) {
                    if let Some(column) = column(block.unknowns[c]) {
                        t[(2 * k + c, column)] = 1.0;
                    }
                    if let Some(column) = column(block.unknowns[2]) {
                        t[(2 * k + c, column)] = levers[at][c] / block.radius;
                    }
                }
            }
        }
        t
    }

    /// Internal less external force at the field `u`, into `work`.
    pub(super) fn evaluate_force(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]], work: &mut Work) {
        let n_quads = self.quads.len();
        let touching = Touching(law);
        let evaluate = |(element, force): (usize, &mut ElementVector)| {
            let u = self.gather(element, u);
            *force = match element < n_quads {
                true => self.quads[element].force(self.material(element), &u),
                false => {
                    let bond = self.bond(element - n_quads, law, &touching);
                    self.interfaces[element - n_quads].force(bond, &u)
                }
            };
        };
        work.forces.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(evaluate);
        self.add_up(&work.forces, &mut work.force);
        Self::take_loads_off(work);
        self.turn_levers(u, work);
    }

    /// `-K_fD du_D` for displacements `du` that are zero at the free nodes: the forces that moving the border
    /// puts on the unknowns, with the stiffness of the last assembly.
    pub(super) fn pull_of_border(&self, du: &[[f64; 2]], work: &Work, pull: &mut [f64]) {
        pull.fill(0.0);
        for &element in &self.coupled {
            let force = work.stiffness[element as usize] * self.gather(element as usize, du);
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
            let force = work.stiffness[element] * self.gather(element, du);
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

    /// The components of nodal forces on the unknowns, with the levers of the last evaluation; without what acts at the points of
    /// blocks.
    pub(super) fn of_unknowns(&self, field: &[[f64; 2]], work: &Work) -> Vec<f64> {
        self.owners.iter().map(|&owner| self.on_owner(owner, field, &work.levers)).collect()
    }

    /// Internal less external force on each unknown, after an evaluation.
    pub(super) fn residual(&self, work: &Work) -> Vec<f64> {
        let mut residual = self.of_unknowns(&work.force, work);
        for (block, load) in self.blocks.iter().zip(&work.loads[work.loaded.len()..]) {
            for c in (0..2).filter(|&c| block.unknowns[c] != NONE) {
                residual[block.unknowns[c] as usize] -= load[c];
            }
        }
        residual
    }

    /// Of each block, the forces at its point and its moment over its radius that are not in balance; zero in components that are held.
    pub(super) fn residual_of_blocks(&self, work: &Work) -> Vec<[f64; 3]> {
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
    pub(super) fn add_loads(&self, loaded: &[u32], loads: &[[f64; 2]], sum: &mut [f64]) {
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
    pub(super) fn add_to_field(&self, values: &[f64], factor: f64, field: &mut [[f64; 2]]) {
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

    /// Adds values of the unknowns to a nodal field that is a derivative of the displacements, with the levers of the last
    /// evaluation.
    pub(super) fn add_to_derivative(&self, values: &[f64], work: &Work, field: &mut [[f64; 2]]) {
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

    /// Displacement of the point of each rigid block under the displacements `u`, mm, in the order of [`Supports::blocks`].
    ///
    /// # Panics
    /// When `u` has not one displacement per node.
    pub fn block_displacements(&self, u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        self.motions(u).into_iter().map(|motion| motion.point).collect()
    }

    /// Where the border is in the field `u`: displacements of the prescribed nodes, then of the blocks' points.
    pub(super) fn border(&self, u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let nodes = self.supports.nodes.iter().map(|&node| u[node as usize]);
        nodes.chain(self.motions(u).into_iter().map(|motion| motion.point)).collect()
    }

    /// Puts the held components of the border in the field `u` where `border` says; the nodes of blocks move along.
    pub(super) fn set_border(&self, border: &[[f64; 2]], u: &mut [[f64; 2]]) {
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

    /// Adds what moving the held components of the border by `places` does to its nodes, and to those of blocks, to the derivative
    /// `field`.
    pub(super) fn add_border_change(&self, places: &[[f64; 2]], field: &mut [[f64; 2]]) {
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
    pub(super) fn loaded_places(&self, loaded: &[u32], u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let nodes = loaded.iter().map(|&node| u[node as usize]);
        nodes.chain(self.motions(u).into_iter().map(|motion| motion.point)).collect()
    }

    /// The forces that hold the border, N/mm, after an evaluation: at the prescribed nodes, then at the blocks' points; zero in
    /// components that are not held.
    pub(super) fn holding(&self, work: &Work) -> Vec<[f64; 2]> {
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
    pub(super) fn node_of(&self, unknown: usize) -> u32 {
        let id = self.owners[unknown].0;
        (id as usize).checked_sub(self.mesh.nodes().len()).map_or(id, |block| self.supports.blocks[block].nodes[0])
    }

    /// A round-off of the residual that no iteration can undercut: stiffness times displacement times epsilon.
    /// With finite rotations jumps are differences of places, not of displacements.
    pub(super) fn round_off(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> f64 {
        let young = self.materials.iter().fold(0.0_f64, |most, material| most.max(material.young()));
        let largest = u.iter().flatten().fold(0.0_f64, |most, u| most.max(u.abs()));
        let of_places = match self.options.kinematics.is_small() {
            true => 0.0,
            false => law.response(Jump::default()).tangent.amax() * self.longest_interface * self.extent,
        };
        4.0 * f64::EPSILON * (young * largest + of_places)
    }

    pub(super) fn check_boundary(&self, boundary: &BoundaryHistory) -> Result<(), ModelError> {
        if boundary.supports() == self.supports { Ok(()) } else { Err(ModelError::OtherNodes) }
    }

    pub(super) fn check_field(&self, u: &[[f64; 2]]) -> Result<(), ModelError> {
        let (needed, given) = (self.mesh.nodes().len(), u.len());
        if needed == given { Ok(()) } else { Err(ModelError::FieldSize { needed, given }) }
    }

    /// Derivatives of the internal force by each parameter of the law, at fixed displacements, at every node.
    pub(super) fn force_by_law(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> Vec<Vec<[f64; 2]>> {
        let mut sums = vec![vec![[0.0; 2]; self.mesh.nodes().len()]; law.parameters().len()];
        let touching = Touching(law);
        for (k, interface) in self.interfaces.iter().enumerate() {
            let element = self.quads.len() + k;
            let bond = self.bond(k, law, &touching);
            let forces = interface.force_by_parameters(bond, &self.gather(element, u));
            self.add_each(element, &forces, &mut sums);
        }
        sums
    }

    /// Derivatives of the internal force by each parameter of the material of `group`.
    pub(super) fn force_by_material(&self, group: usize, u: &[[f64; 2]]) -> Vec<Vec<[f64; 2]>> {
        let material = &*self.materials[group];
        let mut sums = vec![vec![[0.0; 2]; self.mesh.nodes().len()]; material.parameters().len()];
        for (element, quad) in self.quads.iter().enumerate() {
            if self.mesh.element_group()[element] as usize == group {
                let forces = quad.force_by_parameters(material, &self.gather(element, u));
                self.add_each(element, &forces, &mut sums);
            }
        }
        sums
    }

    fn add_each(&self, element: usize, forces: &[ElementVector], sums: &mut [Vec<[f64; 2]>]) {
        for (force, sum) in forces.iter().zip(sums) {
            for (k, &node) in self.corners[element].iter().enumerate() {
                sum[node as usize][0] += force[2 * k];
                sum[node as usize][1] += force[2 * k + 1];
            }
        }
    }

    /// Nodes of every element, those of the interface last.
    pub(super) fn corners(&self) -> &[[u32; 4]] {
        &self.corners
    }

    /// Nodal forces of an element under the displacements `u` of all nodes, and their derivative by those of its own.
    pub(super) fn tangent_of(
        &self,
        element: usize,
        law: &dyn CohesiveLaw,
        u: &[[f64; 2]],
    ) -> (ElementVector, ElementStiffness) {
        let u = self.gather(element, u);
        match element.checked_sub(self.quads.len()) {
            None => self.quads[element].tangent(self.material(element), &u),
            Some(k) => self.interfaces[k].tangent(law, Vector2::zeros(), &u),
        }
    }

    /// Derivatives of the nodal forces of an element by each parameter of the law; none for an element of a strip.
    pub(super) fn force_of_by_law(
        &self,
        element: usize,
        law: &dyn CohesiveLaw,
        u: &[[f64; 2]],
    ) -> Option<Vec<ElementVector>> {
        let k = element.checked_sub(self.quads.len())?;
        Some(self.interfaces[k].force_by_parameters(law, &self.gather(element, u)))
    }

    /// Derivatives of the nodal forces of an element by each parameter of the material of `group`; none for other elements.
    pub(super) fn force_of_by_material(
        &self,
        element: usize,
        group: usize,
        u: &[[f64; 2]],
    ) -> Option<Vec<ElementVector>> {
        let quad = self.quads.get(element).filter(|_| self.mesh.element_group()[element] as usize == group)?;
        Some(quad.force_by_parameters(&*self.materials[group], &self.gather(element, u)))
    }

    /// The jump at each node pair ([`JointMesh::pairs`]), mm: where two elements meet, the mean of theirs by
    /// length.
    ///
    /// # Panics
    /// When `u` has not one displacement per node.
    pub fn jumps(&self, u: &[[f64; 2]]) -> Vec<Jump> {
        self.means_of_ends(|element, interface, end| interface.jump(end, &self.gather(element, u)))
    }

    /// The change of the jump at each node pair, to first order, where the displacements `u` change by `by`; where rotations
    /// are small that is the jump of `by`.
    ///
    /// # Panics
    /// When `u` or `by` has not one displacement per node.
    pub fn jump_changes(&self, u: &[[f64; 2]], by: &[[f64; 2]]) -> Vec<Jump> {
        self.means_of_ends(|element, interface, end| {
            interface.jump_change(end, &self.gather(element, u), &self.gather(element, by))
        })
    }

    fn means_of_ends(&self, of_end: impl Fn(usize, &Interface, &InterfacePoint) -> Jump) -> Vec<Jump> {
        let mut sums = vec![[0.0; 3]; self.mesh.pairs().len()];
        self.for_each_end(|pair, element, interface, end| {
            let jump = of_end(element, interface, end);
            let sum = &mut sums[pair];
            *sum = [sum[0] + end.weight * jump.normal, sum[1] + end.weight * jump.tangential, sum[2] + end.weight];
        });
        sums.into_iter()
            .map(|[normal, tangential, w]| Jump { normal: normal / w, tangential: tangential / w })
            .collect()
    }

    /// The traction at each node pair, MPa.
    ///
    /// # Panics
    /// When `u` has not one displacement per node.
    pub fn tractions(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> Vec<Traction> {
        let touching = Touching(law);
        let of = |(jump, cracked)| if cracked { touching.response(jump) } else { law.response(jump) }.traction;
        self.jumps(u).into_iter().zip(self.mesh.cracked_pairs()).map(of).collect()
    }

    /// Place of each node pair on the mid-line, mm, and its distance along the joint from the first pair.
    pub fn pair_positions(&self) -> Vec<([f64; 2], f64)> {
        let nodes = self.mesh.nodes();
        let middle: Vec<[f64; 2]> = (self.mesh.pairs().iter())
            .map(|pair| [0, 1].map(|c| 0.5 * (nodes[pair[0] as usize][c] + nodes[pair[1] as usize][c])))
            .collect();
        let mut along = 0.0;
        let mut before = middle.first().copied().unwrap_or_default();
        middle
            .into_iter()
            .map(|at| {
                along += (at[0] - before[0]).hypot(at[1] - before[1]);
                before = at;
                (at, along)
            })
            .collect()
    }

    /// Unit normal of the joint at rest at each node pair, from the lower to the upper strip; its tangent is `(n_y, -n_x)`.
    pub fn pair_normals(&self) -> Vec<[f64; 2]> {
        let mut sums = vec![[0.0; 2]; self.mesh.pairs().len()];
        self.for_each_end(|pair, _, _, end| {
            (0..2).for_each(|c| sums[pair][c] += end.weight * end.normal[c]);
        });
        sums.into_iter().map(|n| n.map(|v| v / n[0].hypot(n[1]))).collect()
    }

    /// Calls `each` with the number of the pair, the element's number, the element, and the point, for both ends of each
    /// interface element.
    fn for_each_end(&self, mut each: impl FnMut(usize, usize, &Interface, &InterfacePoint)) {
        for (k, (interface, pairs)) in self.interfaces.iter().zip(&self.end_pairs).enumerate() {
            for (end, &pair) in interface.ends().iter().zip(pairs) {
                each(pair as usize, self.quads.len() + k, interface, end);
            }
        }
    }

    /// The jump at every quadrature point of the interface, with the length (mm) that it stands for; two for each element.
    pub(super) fn weighted_jumps(&self, u: &[[f64; 2]]) -> Vec<(f64, Jump)> {
        let mut jumps = Vec::with_capacity(2 * self.interfaces.len());
        for (k, interface) in self.interfaces.iter().enumerate() {
            let u = self.gather(self.quads.len() + k, u);
            jumps.extend(interface.points().iter().map(|point| (point.weight, interface.jump(point, &u))));
        }
        jumps
    }

    /// Material, area (mm^2) and strain of every Gauss point of the strips.
    pub(super) fn each_strain(
        &self,
        u: &[[f64; 2]],
    ) -> impl Iterator<Item = (&dyn SubstrateLaw, f64, EngineeringStrain)> {
        self.quads.iter().enumerate().flat_map(move |(element, quad)| {
            let u = self.gather(element, u);
            quad.points().map(|point| (self.material(element), point.weight, quad.strain(&point, &u)))
        })
    }

    /// Calls `each` with the corners of the element, its material, the point and the strain there, for every Gauss point of the strips.
    pub(super) fn for_each_point(
        &self,
        u: &[[f64; 2]],
        mut each: impl FnMut(&[u32; 4], &dyn SubstrateLaw, &Q4Point, EngineeringStrain),
    ) {
        for (element, quad) in self.quads.iter().enumerate() {
            let of_element = self.gather(element, u);
            for point in quad.points() {
                each(&self.corners[element], self.material(element), point, quad.strain(point, &of_element));
            }
        }
    }

    /// The stress at the four Gauss points of each element, MPa, in the order (-,-), (+,-), (+,+), (-,+); with finite rotations
    /// the second Piola-Kirchhoff stress, in the axes of the body at rest.
    ///
    /// # Panics
    /// When `u` has not one displacement per node.
    pub fn stresses(&self, u: &[[f64; 2]]) -> Vec<[Stress; 4]> {
        let stresses = |(element, quad): (usize, &Q4)| {
            let u = self.gather(element, u);
            quad.points().map(|point| self.material(element).stress(quad.strain(&point, &u)))
        };
        self.quads.iter().enumerate().map(stresses).collect()
    }

    /// Equivalent stress (MPa) and plastic strain at the four Gauss points of each element.
    ///
    /// # Panics
    /// When `u` has not one displacement per node.
    pub fn states(&self, u: &[[f64; 2]]) -> Vec<[SubstrateState; 4]> {
        let states = |(element, quad): (usize, &Q4)| {
            let u = self.gather(element, u);
            quad.points().map(|point| self.material(element).state(quad.strain(&point, &u)))
        };
        self.quads.iter().enumerate().map(states).collect()
    }

    /// The internal force at every node, N/mm: at prescribed nodes the reaction, at the others the residual.
    ///
    /// # Panics
    /// When `u` has not one displacement per node.
    pub fn forces(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let mut work = self.work();
        self.evaluate_force(law, u, &mut work);
        work.force
    }

    /// Where, along the joint from the first pair (mm), the normal jump passes the law's front opening: the
    /// crack front (THEORY 9), interpolated. Of several the first; `None` where none is.
    ///
    /// # Panics
    /// When `u` has not one displacement per node.
    pub fn crack_front(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> Option<f64> {
        let (jumps, positions, opening) = (self.jumps(u), self.pair_positions(), law.front_opening());
        let rest = |k: usize| jumps[k].normal - opening;
        let cracked = self.mesh.cracked_pairs();
        let passes = |&k: &usize| !cracked[k - 1] && !cracked[k] && (rest(k - 1) < 0.0) != (rest(k) < 0.0);
        (1..jumps.len()).find(passes).map(|k| {
            let share = rest(k - 1) / (rest(k - 1) - rest(k));
            positions[k - 1].1 + share * (positions[k].1 - positions[k - 1].1)
        })
    }

    /// Memory of the element arrays, the matrix and, where it is known beforehand, the factor, bytes.
    pub fn bytes(&self) -> usize {
        let per_element = size_of::<Q4>() + size_of::<[u32; 64]>() + size_of::<ElementStiffness>();
        self.corners.len() * per_element + 12 * self.pattern.n_values() + 8 * self.plan.n_values().unwrap_or(0)
    }
}

/// The free nodes in an order in which coupled ones are close: along x, along y, or by neighbourhood (reverse
/// Cuthill-McKee), whichever gives the narrowest band.
fn banded_order(nodes: &[[f64; 2]], corners: &[Vec<u32>], prescribed: &[bool]) -> Vec<u32> {
    let free: Vec<u32> = (0..nodes.len() as u32).filter(|&node| !prescribed[node as usize]).collect();
    // Nodes in line count as equal although their coordinates differ in the last bits.
    let size = corners.first().map_or(1.0, |c| {
        let [a, b] = [nodes[c[0] as usize], nodes[c[1] as usize]];
        (a[0] - b[0]).hypot(a[1] - b[1])
    });
    let along = |axis: usize| {
        let key = |node: u32| (nodes[node as usize][axis] / (1e-6 * size)).round() as i64;
        let mut order = free.clone();
        order.sort_by(|&a, &b| {
            let across = nodes[a as usize][1 - axis].total_cmp(&nodes[b as usize][1 - axis]);
            key(a).cmp(&key(b)).then(across).then(a.cmp(&b))
        });
        order
    };
    let mut neighbours: Vec<BTreeSet<u32>> = vec![BTreeSet::new(); nodes.len()];
    for corners in corners {
        for &a in corners {
            for &b in corners {
                if a != b && !prescribed[a as usize] && !prescribed[b as usize] {
                    neighbours[a as usize].insert(b);
                }
            }
        }
    }
    let band = |order: &[u32]| {
        let mut place = vec![0usize; nodes.len()];
        order.iter().enumerate().for_each(|(k, &node)| place[node as usize] = k);
        let reach = |&node: &u32| {
            let at = place[node as usize];
            neighbours[node as usize].iter().map(|&other| at.abs_diff(place[other as usize])).max().unwrap_or(0)
        };
        order.iter().map(reach).max().unwrap_or(0)
    };
    let orders = [along(0), along(1), by_neighbourhood(&free, &neighbours)];
    orders.into_iter().min_by_key(|order| band(order)).unwrap_or_default()
}

/// Reverse Cuthill-McKee: breadth first from the node of least degree, neighbours by degree, backwards.
fn by_neighbourhood(free: &[u32], neighbours: &[BTreeSet<u32>]) -> Vec<u32> {
    let degree = |node: u32| (neighbours[node as usize].len(), node);
    let mut starts = free.to_vec();
    starts.sort_by_key(|&node| degree(node));
    let (mut order, mut seen) = (Vec::with_capacity(free.len()), vec![false; neighbours.len()]);
    for start in starts {
        if std::mem::replace(&mut seen[start as usize], true) {
            continue;
        }
        let mut next = order.len();
        order.push(start);
        while next < order.len() {
            let mut ring: Vec<u32> = neighbours[order[next] as usize].iter().copied().collect();
            ring.retain(|&node| !std::mem::replace(&mut seen[node as usize], true));
            ring.sort_by_key(|&node| degree(node));
            order.extend(ring);
            next += 1;
        }
    }
    order.reverse();
    order
}
