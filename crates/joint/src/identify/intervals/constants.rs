//! Constants of the model that are not known exactly: what their uncertainty does to the estimate (THEORY 7, 11).
//!
//! To first order `dX/dc = -A J^T W dU/dc`. The derivatives of the displacements come from the tangent at the solution:
//! the change of the internal forces when the constant moves, solved for the free nodes. No further forward run is
//! needed.

use crate::identify::{Evaluation, LoadCell, ObservedInstant, Problem, Statistics};
use crate::linalg::Dense;
use crate::mechanics::cohesive::{CohesiveLaw, Jump};
use crate::mechanics::{Instant, JointMesh, JointParts, Kinematics, Linearised, Model, NodalField, ReactionAt};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Step by which a face or the thickness is moved, by the size of the elements: its square is the error of the
/// derivative.
const STEP: f64 = 1e-5;

/// A constant with its standard uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant {
    /// Its name in files.
    pub name: String,
    /// Which.
    pub kind: ConstantKind,
    /// Its value, where it is a number.
    pub value: Option<f64>,
    /// The unit of value and standard uncertainty, `1` for a pure number.
    pub unit: &'static str,
    /// Its standard uncertainty; zero where it is exact or nothing is known.
    pub std: f64,
    /// Where the standard uncertainty comes from.
    pub source: Source,
}

/// Where a standard uncertainty comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The case states it.
    Stated,
    /// The case states none: a default.
    Default,
    /// The case says that there is none.
    Exact,
    /// The case states none, and there is nothing that a default could be made of: no scale, or a value of zero.
    Unknown,
    /// It follows from the data.
    Computed,
}

impl Source {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stated => "stated",
            Self::Default => "default",
            Self::Exact => "exact",
            Self::Unknown => "not stated",
            Self::Computed => "computed",
        }
    }
}

/// A face of the adhesive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Face {
    /// That of the lower strip.
    Lower,
    /// That of the upper strip.
    Upper,
}

/// A kind of constant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ConstantKind {
    /// Parameter `index` of the material of these groups of elements.
    Material {
        /// The groups; they share the value.
        groups: Vec<usize>,
        /// Place among the parameters of their material.
        index: usize,
    },
    /// A parameter of the law that is prescribed; nothing while it is fitted.
    Law {
        /// Its place among the parameters of the law.
        index: usize,
    },
    /// Thickness of the adhesive, mm: the upper strip lies further away. Only the objective jump knows it.
    Thickness,
    /// Position of a face along the normal (from the lower to the upper strip), mm: the strip is taller, and what was
    /// measured at its first row of nodes is continued along the edges of its elements.
    Face(Face),
    /// Pixel size: all lengths, measured and of the mesh, grow alike.
    PixelSize,
    /// Width of the specimen, mm: forces of the model are its multiple.
    Width,
    /// The camera in one direction of its parameters, by standard uncertainties: the measured displacements are off by
    /// its entry in [`Observation::camera`](crate::identify::Observation), those of the border as well.
    Camera {
        /// Its place there.
        term: usize,
    },
    /// Relative size of the noise: it moves no estimate and scales what the noise does.
    NoiseLevel,
}

impl ConstantKind {
    /// Whether the model follows by its tangent.
    fn needs_tangent(&self) -> bool {
        matches!(self, Self::Material { .. } | Self::Camera { .. })
    }
}

/// What a constant does when it is off by its standard uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct ConstantEffect {
    /// The constant.
    pub constant: Constant,
    /// Change of each scaled unknown.
    pub scaled: Vec<f64>,
    /// Change of each parameter of the law: of those fitted what `scaled` says, of a prescribed one its own. Behind
    /// them those of the fitted ones of materials.
    pub law: Vec<f64>,
    /// Change of the computed jumps at each instant compared, with the parameters of the law as they are.
    pub jumps: Vec<Vec<Jump>>,
    /// The same of the computed force, N; zero where the load cell has no value.
    pub forces: Vec<f64>,
    /// Change of the rows, computed less measured, mm: a column for each instant compared.
    pub rows: Vec<Dense>,
}

/// Change of an instant for a unit of the constant, with the parameters of the law as they are.
struct Change {
    /// Of computed less measured displacement at every node.
    nodes: NodalField,
    jumps: Vec<Jump>,
    /// Of the computed force, N.
    force: f64,
    /// Of computed less measured force, N, where the fitted parameters follow the constant.
    row: f64,
}

/// The model with a face or the thickness moved by `by`.
struct Moved {
    model: Model,
    by: f64,
    /// Nodes that were moved against their strip: with the node behind and its distance along the normal.
    face: Vec<[u32; 2]>,
    distance: Vec<f64>,
}

impl Moved {
    /// Derivative along the normal of the field `u` at the nodes of the face; zero elsewhere.
    fn slope(&self, u: &[[f64; 2]]) -> NodalField {
        let mut slope = vec![[0.0; 2]; u.len()];
        for (&[node, behind], distance) in self.face.iter().zip(&self.distance) {
            let (a, b) = (u[node as usize], u[behind as usize]);
            slope[node as usize] = [0, 1].map(|c| (a[c] - b[c]) / distance);
        }
        slope
    }

    /// What a unit of the constant changes at the field `u` that `base` was linearised at.
    fn change(
        &self,
        base: &Model,
        law: &dyn CohesiveLaw,
        tangent: &Linearised<'_>,
        u: &[[f64; 2]],
        cell: Option<&LoadCell>,
    ) -> Change {
        let slope = self.slope(u);
        // The prescribed nodes of the face keep what was measured, continued to their new place.
        let mut lead = vec![[0.0; 2]; u.len()];
        base.prescribed().iter().for_each(|&node| lead[node as usize] = slope[node as usize]);
        let along = |by: &NodalField| -> NodalField {
            u.iter().zip(by).map(|(u, by)| [0, 1].map(|c| u[c] + self.by * by[c])).collect()
        };
        let (more, before) = (self.model.forces(law, &along(&lead)), base.forces(law, u));
        let force = more.iter().zip(&before).map(|(a, b)| [0, 1].map(|c| (a[c] - b[c]) / self.by)).collect();
        let mut nodes = tangent.by_force(&[force]).swap_remove(0);
        nodes.iter_mut().zip(&lead).for_each(|(u, lead)| *u = [0, 1].map(|c| u[c] + lead[c]));
        let (after, jumps) = (self.model.jumps(&along(&nodes)), base.jumps(u));
        let rate = |(a, b): (&Jump, &Jump)| Jump {
            normal: (a.normal - b.normal) / self.by,
            tangential: (a.tangential - b.tangential) / self.by,
        };
        let jumps = after.iter().zip(&jumps).map(rate).collect();
        let force = cell.map_or(0.0, |cell| {
            let more = cell.force_on(&self.model, cell.group.nodes.clone(), law, &along(&nodes));
            (more - cell.width_mm * cell.reaction(base, law, u).value) / self.by
        });
        nodes.iter_mut().zip(&slope).for_each(|(u, slope)| *u = [0, 1].map(|c| u[c] - slope[c]));
        Change { nodes, jumps, force, row: force }
    }
}

/// The joint at an instant compared, as far as the effects of constants need it.
struct AtInstant<'a> {
    problem: &'a Problem<'a>,
    model: &'a Model,
    law: &'a dyn CohesiveLaw,
    instant: &'a Instant,
    /// Number of the instant of the border.
    index: usize,
    /// `None` where no constant needs it, or it has no inverse.
    tangent: Option<Linearised<'a>>,
    /// The load cell where it has a value, and the reaction that it should show.
    reaction: Option<(&'a LoadCell, ReactionAt)>,
    /// Derivatives of the displacements by the parameters of the material of each group, once they are asked for.
    by_group: BTreeMap<usize, Vec<NodalField>>,
}

impl<'a> AtInstant<'a> {
    fn new(
        problem: &'a Problem<'a>,
        evaluation: &'a Evaluation,
        law: &'a dyn CohesiveLaw,
        index: usize,
        tangent_needed: bool,
    ) -> Self {
        let model = evaluation.model(problem);
        let instant = &evaluation.solution.instants[index];
        let u = &instant.displacement;
        let tangent = if tangent_needed { model.linearise(law, u).ok() } else { None };
        let cell = problem.observation.cell().filter(|cell| cell.at(index).is_some());
        let reaction = cell.map(|cell| (cell, cell.reaction(model, law, u)));
        Self { problem, model, law, instant, index, tangent, reaction, by_group: BTreeMap::new() }
    }

    fn still(&self) -> NodalField {
        vec![[0.0; 2]; self.instant.displacement.len()]
    }

    /// Change of the force when all nodes move by `nodes`.
    fn carried(&self, nodes: &NodalField) -> f64 {
        self.reaction.as_ref().map_or(0.0, |(cell, reaction)| cell.width_mm * reaction.change(nodes))
    }

    /// Derivative of the force by a parameter of the law at fixed displacements.
    fn by_law(&self, index: usize) -> f64 {
        self.reaction.as_ref().map_or(0.0, |(cell, reaction)| cell.width_mm * reaction.by_law[index])
    }

    /// The whole force.
    fn force(&self) -> f64 {
        self.reaction.as_ref().map_or(0.0, |(cell, reaction)| cell.width_mm * reaction.value)
    }

    /// What a unit of a constant changes; `moved` is the model with it moved, where it is a length of the joint.
    fn change(&mut self, kind: &ConstantKind, moved: Option<&Moved>) -> Option<Change> {
        let (model, u) = (self.model, &self.instant.displacement);
        let no_jumps = || vec![Jump::default(); model.mesh().pairs().len()];
        match kind {
            ConstantKind::Material { groups, index } => self.by_material(groups, *index),
            ConstantKind::Law { index } => {
                let nodes = self.instant.sensitivities.get(*index)?.clone();
                let jumps = model.jump_changes(u, &nodes);
                let force = self.carried(&nodes) + self.by_law(*index);
                Some(Change { nodes, jumps, force, row: force })
            }
            ConstantKind::Width => {
                let force = self.reaction.as_ref().map_or(0.0, |(cell, _)| self.force() / cell.width_mm);
                Some(Change { nodes: self.still(), jumps: no_jumps(), force, row: force })
            }
            ConstantKind::Thickness if model.options().kinematics == Kinematics::Paper => {
                Some(Change { nodes: self.still(), jumps: no_jumps(), force: 0.0, row: 0.0 })
            }
            ConstantKind::Thickness | ConstantKind::Face(_) => {
                let cell = self.reaction.as_ref().map(|(cell, _)| *cell);
                Some(moved?.change(model, self.law, self.tangent.as_ref()?, u, cell))
            }
            ConstantKind::PixelSize => self.by_pixel_size(),
            ConstantKind::Camera { term } => self.by_camera(*term),
            ConstantKind::NoiseLevel => None,
        }
    }

    /// The border moves by what it is off, and the model follows; what is compared is off by itself.
    fn by_camera(&self, term: usize) -> Option<Change> {
        let (model, measured) = (self.model, &self.problem.joint.measured);
        let of_term = self.problem.observation.camera.get(term)?;
        let off = of_term.instants.get(self.index)?;
        let mut nodes = self.still();
        if of_term.is_of_border {
            let border =
                measured.prescribed.iter().map(|&node| off.get(node as usize).copied()).collect::<Option<_>>()?;
            let moved = measured.boundary(vec![border]).ok()?;
            nodes = self.tangent.as_ref()?.by_boundary(moved.instants()).pop()?;
        }
        let (jumps, force) = (model.jump_changes(&self.instant.displacement, &nodes), self.carried(&nodes));
        nodes.iter_mut().zip(off).for_each(|(u, off)| *u = [0, 1].map(|c| u[c] - off[c]));
        Some(Change { nodes, jumps, force, row: force })
    }

    fn by_material(&mut self, groups: &[usize], index: usize) -> Option<Change> {
        let (model, u) = (self.model, &self.instant.displacement);
        let tangent = self.tangent.as_ref()?;
        let mut nodes = self.still();
        for &group in groups {
            let fields = self.by_group.entry(group).or_insert_with(|| tangent.by_material(group));
            add(&mut nodes, 1.0, fields.get(index)?);
        }
        let jumps = model.jump_changes(u, &nodes);
        let own = |cell: &LoadCell| groups.iter().map(|&group| cell.by_material(model, group, u)[index]).sum::<f64>();
        let force = self.carried(&nodes) + self.reaction.as_ref().map_or(0.0, |(cell, _)| own(cell));
        Some(Change { nodes, jumps, force, row: force })
    }

    /// Were all parameters of the law to grow by their power of mm, the solution would grow as the data do: what a
    /// prescribed one, which does not, takes away. Those fitted follow, see [`Problem::constant_effects`].
    fn by_pixel_size(&self) -> Option<Change> {
        let (model, u) = (self.model, &self.instant.displacement);
        let small = model.options().kinematics.is_small();
        let (mut nodes, mut all) = (self.still(), if small { u.clone() } else { self.still() });
        // A reaction by width grows as lengths do, what the load cell shows does not.
        let (mut force, mut row) = (self.force(), self.force());
        for (index, (p, value)) in self.law.parameters().iter().zip(self.law.values()).enumerate() {
            let grown = -power_of_length(p.unit) * value;
            let field = self.instant.sensitivities.get(index)?;
            add(&mut all, grown, field);
            let of_force = grown * (self.carried(field) + self.by_law(index));
            force += of_force;
            if !self.problem.is_fitted(&ConstantKind::Law { index }) {
                add(&mut nodes, grown, field);
                row += of_force;
            }
        }
        let mut jumps = model.jump_changes(u, &all);
        if !small {
            // All lengths grow alike: the jumps as well, whatever has turned.
            jumps.iter_mut().zip(model.jumps(u)).for_each(|(sum, jump)| {
                *sum = Jump { normal: sum.normal + jump.normal, tangential: sum.tangential + jump.tangential };
            });
        }
        Some(Change { nodes, jumps, force, row })
    }
}

impl Problem<'_> {
    /// The effect of each constant on the unknowns, to first order; without those that are exact, that are fitted, or
    /// whose effect cannot be computed at some instant (no tangent, no mesh).
    pub(crate) fn constant_effects(
        &self,
        evaluation: &Evaluation,
        statistics: &Statistics,
        constants: &[Constant],
    ) -> Vec<ConstantEffect> {
        let Ok(law) = self.unknowns.law_at(&evaluation.x) else { return Vec::new() };
        let law = &*law;
        let asked: Vec<&Constant> = constants.iter().filter(|c| c.std > 0.0 && !self.is_fitted(&c.kind)).collect();
        let asked: Vec<&Constant> = asked.into_iter().filter(|c| c.kind != ConstantKind::NoiseLevel).collect();
        let moved: Vec<Option<Moved>> =
            asked.par_iter().map(|c| move_constant(evaluation.model(self), &c.kind)).collect();
        let tangent_needed =
            moved.iter().any(Option::is_some) || asked.iter().any(|constant| constant.kind.needs_tangent());
        let of_instant = |observed: &ObservedInstant| -> Vec<Option<Change>> {
            let mut there = AtInstant::new(self, evaluation, law, observed.index, tangent_needed);
            asked.iter().zip(&moved).map(|(constant, moved)| there.change(&constant.kind, moved.as_ref())).collect()
        };
        let changes: Vec<Vec<Option<Change>>> = self.observation.instants.par_iter().map(of_instant).collect();
        let slopes = self.unknowns.slopes(&evaluation.x);
        let effect = |(k, &constant): (usize, &&Constant)| {
            let changes = changes.iter().map(|list| list[k].as_ref()).collect::<Option<Vec<&Change>>>()?;
            self.effect_of(constant, &changes, (evaluation, statistics), &slopes)
        };
        asked.iter().enumerate().filter_map(effect).collect()
    }

    /// The effect of a constant that changes the instants by `changes`; `slopes` are those of the unknowns. `None`
    /// where it is not finite.
    fn effect_of(
        &self,
        constant: &Constant,
        changes: &[&Change],
        (evaluation, statistics): (&Evaluation, &Statistics),
        slopes: &[f64],
    ) -> Option<ConstantEffect> {
        // Of the pixel size a relative change is meant.
        let std = match (&constant.kind, constant.value) {
            (ConstantKind::PixelSize, Some(value)) => constant.std / value,
            _ => constant.std,
        };
        let rows_of = |(change, observed): (&&Change, &ObservedInstant)| {
            let of_node = |node: usize, c: usize| std * change.nodes[node][c];
            self.observation.column(observed.index, of_node, |_| std * change.row)
        };
        let rows: Vec<Dense> = changes.iter().zip(&self.observation.instants).map(rows_of).collect();
        let mut scaled = statistics.shift(&rows);
        if constant.kind == ConstantKind::PixelSize {
            for (k, unknown) in self.unknowns.list().iter().enumerate() {
                scaled[k] += std * power_of_length(unknown.parameter.unit) * evaluation.x[k] / slopes[k];
            }
        }
        if scaled.iter().any(|z| !z.is_finite()) {
            return None;
        }
        let times = |jump: &Jump| Jump { normal: std * jump.normal, tangential: std * jump.tangential };
        let jumps = changes.iter().map(|change| change.jumps.iter().map(times).collect()).collect();
        let forces = changes.iter().map(|change| std * change.force).collect();
        let law = self.law_change(constant, &evaluation.x, &scaled);
        Some(ConstantEffect { constant: constant.clone(), scaled, law, jumps, forces, rows })
    }

    /// Change of each parameter of the law for the change `scaled` of the unknowns at `x` and one of `constant`, where
    /// that is one of them.
    pub(crate) fn law_change(&self, constant: &Constant, x: &[f64], scaled: &[f64]) -> Vec<f64> {
        let mut law = vec![0.0; self.unknowns.law().parameters().len() + self.unknowns.of_materials().len()];
        if let ConstantKind::Law { index } = constant.kind {
            law[index] = constant.std;
        }
        for ((unknown, slope), z) in self.unknowns.list().iter().zip(self.unknowns.slopes(x)).zip(scaled) {
            law[unknown.index] = slope * z;
        }
        law
    }

    /// Whether a constant is among the unknowns.
    pub(crate) fn is_fitted(&self, kind: &ConstantKind) -> bool {
        matches!(kind, ConstantKind::Law { index } if self.unknowns.list().iter().any(|u| u.index == *index))
    }
}

/// `sum += factor field`.
fn add(sum: &mut NodalField, factor: f64, field: &NodalField) {
    sum.iter_mut().zip(field).for_each(|(sum, u)| *sum = [0, 1].map(|c| sum[c] + factor * u[c]));
}

/// Power of mm in the unit of a parameter.
pub(crate) fn power_of_length(unit: &str) -> f64 {
    match unit {
        "mm" | "N/mm" => 1.0,
        "MPa/mm" => -1.0,
        _ => 0.0,
    }
}

/// The model with the constant moved a little; `None` where it is another kind, or such a mesh cannot be made.
fn move_constant(model: &Model, kind: &ConstantKind) -> Option<Moved> {
    let mesh = model.mesh();
    let by = STEP * mesh.element_size();
    let (nodes, face, distance) = match kind {
        ConstantKind::Thickness if model.options().kinematics != Kinematics::Paper => {
            (thicker(mesh, by)?, Vec::new(), Vec::new())
        }
        ConstantKind::Face(face) => {
            let normals = normals(mesh, *face);
            let mut nodes = mesh.nodes().to_vec();
            for (&node, n) in &normals {
                nodes[node as usize] = [0, 1].map(|c| nodes[node as usize][c] + by * n[c]);
            }
            let (face, distance) = behind(mesh, &normals).into_iter().unzip();
            (nodes, face, distance)
        }
        _ => return None,
    };
    let mesh = JointMesh::new(JointParts {
        nodes,
        elements: mesh.elements().to_vec(),
        interfaces: mesh.interfaces().to_vec(),
        groups: mesh.groups().to_vec(),
        element_group: mesh.element_group().to_vec(),
        cracked: mesh.cracked().to_vec(),
        ..JointParts::default()
    });
    let model = model.held_alike(mesh.ok()?, *model.options()).ok()?;
    Some(Moved { model, by, face, distance })
}

/// Unit normal, from the lower to the upper strip, at each node of a face.
fn normals(mesh: &JointMesh, face: Face) -> BTreeMap<u32, [f64; 2]> {
    let mut sums: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
    for &[l1, l2, u1, u2] in mesh.interfaces() {
        let t = mesh.twice_along([l1, l2, u1, u2]);
        let ends = match face {
            Face::Lower => [l1, l2],
            Face::Upper => [u1, u2],
        };
        for node in ends {
            let sum = sums.entry(node).or_default();
            *sum = [sum[0] - t[1], sum[1] + t[0]];
        }
    }
    sums.retain(|_, n| n[0].hypot(n[1]) > 0.0);
    sums.values_mut().for_each(|n| *n = n.map(|c| c / n[0].hypot(n[1])));
    sums
}

/// Of each node of a face the node behind it: at the other end of the edge that leaves the face most steeply, with its
/// distance along the normal (from there to the face).
fn behind(mesh: &JointMesh, normals: &BTreeMap<u32, [f64; 2]>) -> Vec<([u32; 2], f64)> {
    let mut steepest: BTreeMap<u32, (f64, u32, f64)> = BTreeMap::new();
    for corners in mesh.elements() {
        for k in 0..4 {
            let edge = [corners[k], corners[(k + 1) % 4]];
            for [node, other] in [edge, [edge[1], edge[0]]] {
                let Some(n) = normals.get(&node).filter(|_| !normals.contains_key(&other)) else { continue };
                let (a, b) = (mesh.nodes()[node as usize], mesh.nodes()[other as usize]);
                let edge = [a[0] - b[0], a[1] - b[1]];
                let along = edge[0] * n[0] + edge[1] * n[1];
                let share = along.abs() / edge[0].hypot(edge[1]);
                let better = steepest.get(&node).is_none_or(|&(most, before, _)| (share, before) > (most, other));
                if share > 0.1 && better {
                    steepest.insert(node, (share, other, along));
                }
            }
        }
    }
    steepest.into_iter().map(|(node, (_, other, along))| ([node, other], along)).collect()
}

/// The nodes with the faces of the adhesive `by` further apart: the upper strip is moved along the mean normal.
fn thicker(mesh: &JointMesh, by: f64) -> Option<Vec<[f64; 2]>> {
    let mut normal = [0.0; 2];
    for n in normals(mesh, Face::Upper).values() {
        normal = [normal[0] + n[0], normal[1] + n[1]];
    }
    let length = normal[0].hypot(normal[1]);
    let upper = mesh.strip()[mesh.pairs()[0][1] as usize];
    let moved = |(&[x, y], &strip): (&[f64; 2], &u32)| match strip == upper {
        true => [x + by * normal[0] / length, y + by * normal[1] / length],
        false => [x, y],
    };
    (length > 0.0).then(|| mesh.nodes().iter().zip(mesh.strip()).map(moved).collect())
}
