//! The discrete joint: which displacements are unknown, and the forces and stiffness at a field of them.

mod border;
mod fields;
mod order;

use super::cohesive::{CohesiveLaw, Jump, Touching};
use super::element::{ElementStiffness, ElementVector, Interface, Q4};
use super::held::check;
use super::substrate::SubstrateLaw;
use super::tied::Tied;
use super::{BoundaryHistory, JointMesh, Kinematics, ModelError, NONE, Quadrature, RigidBlock, Supports, TiedBlock};
use crate::linalg::{LuChoice, LuFactor, LuPlan, SparseMatrix, SparsePattern};
use nalgebra::Vector2;
use order::banded_order;
use rayon::prelude::*;
use std::collections::HashMap;
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
///
/// # Panics
/// Its methods, when a field (`u`, `by`) has not one displacement per node.
#[derive(Debug, Clone)]
pub struct Model {
    mesh: JointMesh,
    materials: Vec<Arc<dyn SubstrateLaw>>,
    options: ModelOptions,
    supports: Supports,
    /// Per component of each node, its place among the unknowns.
    unknowns: Vec<[u32; 2]>,
    /// Of each unknown, its node and component; of a block, the number of the block from the number of nodes on, and 0
    /// or 1 for its point, 2 for its rotation.
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

/// The unknowns of a joint in their order.
struct Numbering {
    /// As of [`Model`].
    unknowns: Vec<[u32; 2]>,
    owners: Vec<(u32, u8)>,
    blocks: Vec<TiedBlock>,
    /// Of each node, the number of the block that moves it.
    master: Vec<u32>,
    /// Of each element, its unknowns in rising order.
    groups: Vec<Vec<u32>>,
}

impl Numbering {
    /// Numbers the unknowns of `mesh` held by `supports`, so that those of each of its elements `corners` are near each
    /// other.
    fn new(mesh: &JointMesh, supports: &Supports, corners: &[[u32; 4]]) -> Self {
        let n_nodes = mesh.nodes().len();
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
        let group = |couplings: &Vec<u32>| {
            let of = |&id: &u32| match (id as usize).checked_sub(n_nodes) {
                Some(block) => blocks[block].unknowns.to_vec(),
                None => unknowns[id as usize].to_vec(),
            };
            let mut group: Vec<u32> = couplings.iter().flat_map(of).collect();
            group.retain(|&unknown| unknown != NONE);
            group.sort_unstable();
            group.dedup();
            group
        };
        let groups = couplings.iter().map(group).collect();
        Self { unknowns, owners, blocks, master, groups }
    }
}

/// Adds the forces at the nodes of an element.
fn add_at(corners: &[u32; 4], force: &ElementVector, sum: &mut [[f64; 2]]) {
    for (k, &node) in corners.iter().enumerate() {
        sum[node as usize][0] += force[2 * k];
        sum[node as usize][1] += force[2 * k + 1];
    }
}

/// Where the unknowns of `owners` lie, mm.
fn positions_of(owners: &[(u32, u8)], mesh: &JointMesh, blocks: &[TiedBlock]) -> Vec<[f64; 2]> {
    let at = |&(id, _): &(u32, u8)| match (id as usize).checked_sub(mesh.nodes().len()) {
        Some(block) => blocks[block].centre,
        None => mesh.nodes()[id as usize],
    };
    owners.iter().map(at).collect()
}

/// Finds where each entry of the stiffness of an element with these `unknowns` at its corners goes, column by column.
fn places_of(unknowns: [[u32; 2]; 4], pattern: &SparsePattern) -> [u32; 64] {
    let mut places = [NONE; 64];
    let unknown = |k: usize| unknowns[k / 2][k % 2];
    for row in 0..8 {
        for column in 0..8 {
            if unknown(row) != NONE && unknown(column) != NONE {
                let place = pattern.place(unknown(row) as usize, unknown(column) as usize);
                places[8 * column + row] = place.expect("an entry of the pattern") as u32;
            }
        }
    }
    places
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
    /// A node that does not exist, one that is held or tied twice, a body that can move freely, another number of
    /// materials than of groups.
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
        let Numbering { unknowns, owners, blocks, master, groups } = Numbering::new(&mesh, &supports, &corners);
        let pattern = SparsePattern::from_groups(owners.len(), groups.iter().map(Vec::as_slice));
        let pattern = Arc::new(pattern);
        let is_tied = |corners: &[u32; 4]| corners.iter().any(|&node| master[node as usize] != NONE);
        let place = |corners: &[u32; 4]| match is_tied(corners) {
            true => [NONE; 64],
            false => places_of(corners.map(|node| unknowns[node as usize]), &pattern),
        };
        let places = corners.par_iter().map(place).collect();
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
        let plan = LuPlan::new(&pattern, &positions_of(&owners, &mesh, &blocks), options.solver);
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

    /// The same with other materials for its groups of elements.
    ///
    /// # Panics
    /// When there is not one material for each group.
    pub fn with_materials(&self, materials: Vec<Arc<dyn SubstrateLaw>>) -> Self {
        assert_eq!(materials.len(), self.materials.len(), "one material for each group");
        Self { materials, ..self.clone() }
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

    /// Place of a component (0: x, 1: y) of a node among the unknowns; `None` when it is prescribed, or moved by a
    /// rigid block.
    pub fn unknown(&self, node: usize, component: usize) -> Option<usize> {
        let place = self.unknowns[node][component];
        (place != NONE).then_some(place as usize)
    }

    /// Where each unknown lies, mm.
    pub fn unknown_positions(&self) -> Vec<[f64; 2]> {
        positions_of(&self.owners, &self.mesh, &self.blocks)
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
    pub(super) fn gather(&self, element: usize, u: &[[f64; 2]]) -> ElementVector {
        let corners = &self.corners[element];
        ElementVector::from_fn(|k, _| u[corners[k / 2] as usize][k % 2])
    }

    /// Adds up the nodal forces of all elements, in their order.
    fn add_up(&self, forces: &[ElementVector], sum: &mut [[f64; 2]]) {
        sum.fill([0.0; 2]);
        self.corners.iter().zip(forces).for_each(|(corners, force)| add_at(corners, force, sum));
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
            // The second derivative of a place by the rotation is minus its arm; the lever is the arm turned by 90
            // degrees.
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

    /// Derivative of the internal force where the adhesive is thicker, by the share `along` of each interface element, at
    /// fixed displacements, at every node.
    pub(super) fn force_by_thickness(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]], along: &[f64]) -> Vec<[f64; 2]> {
        let mut sum = vec![[0.0; 2]; self.mesh.nodes().len()];
        let touching = Touching(law);
        for ((k, interface), along) in self.interfaces.iter().enumerate().zip(along) {
            let element = self.quads.len() + k;
            let force = interface.force_by_thickness(self.bond(k, law, &touching), &self.gather(element, u));
            add_at(&self.corners[element], &(force * *along), &mut sum);
        }
        sum
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
        forces.iter().zip(sums).for_each(|(force, sum)| add_at(&self.corners[element], force, sum));
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

    /// Derivatives of the nodal forces of an element by each parameter of the material of `group`; none for other
    /// elements.
    pub(super) fn force_of_by_material(
        &self,
        element: usize,
        group: usize,
        u: &[[f64; 2]],
    ) -> Option<Vec<ElementVector>> {
        let quad = self.quads.get(element).filter(|_| self.mesh.element_group()[element] as usize == group)?;
        Some(quad.force_by_parameters(&*self.materials[group], &self.gather(element, u)))
    }

    /// Memory of the element arrays, the matrix and, where it is known beforehand, the factor, bytes.
    pub fn bytes(&self) -> usize {
        let per_element = size_of::<Q4>() + size_of::<[u32; 64]>() + size_of::<ElementStiffness>();
        self.corners.len() * per_element + 12 * self.pattern.n_values() + 8 * self.plan.n_values().unwrap_or(0)
    }
}
