//! A joint as its case file describes it: mesh, materials, law and prescribed displacements, ready to run.

use super::case_error::OF_MESH;
use super::cohesive::{
    CohesiveLaw, ExtendedXuNeedleman, LAW_NAMES, NoAdhesive, Parameter, law_by_name, parameters_by_name,
};
use super::drives::{drives_of_case, nodes_of_group};
use super::remarks;
use super::substrate::{
    PlaneState, RambergOsgood, SUBSTRATE_NAMES, SubstrateLaw, Tabulated, substrate_by_name, substrate_parameters,
};
use super::{
    BoundaryFault, BoundaryHistory, Carry, Drives, JointError, JointMesh, JointParts, Kinematics, MeshFault, Model,
    ModelOptions, NodeGroup, Quadrature, select_nodes, wrong,
};
use crate::field::RigidMotion;
use crate::io::case::{
    CaseCohesive, CaseLaws, CaseMaterial, CaseRigidMotion, CaseSubstrate, EXACT, LawKey, LawKeys, STD,
};
use crate::io::joint::{BoundaryInput, BoundaryTable, JointInput, JointMeshFile, JointRun, MeshInput};
use crate::remark::Remark;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Share of an element's size by which a node of a table may lie beside that of the mesh: more than any rounding of
/// the table, less than would make two nodes one.
const SAME_PLACE: f64 = 1e-3;

/// A joint ready to run: what the tables `[mesh]`, `[boundary]`, `[substrate]` and `[cohesive]` of a case file say.
#[derive(Debug)]
pub struct Joint {
    /// Mesh, materials and prescribed nodes.
    pub model: Model,
    /// The law of the adhesive with the values of the case.
    pub law: Box<dyn CohesiveLaw>,
    /// The displacements of the prescribed nodes.
    pub boundary: BoundaryHistory,
    /// The mesh that displacements were measured on, and what leads from it to that of the model.
    pub measured: MeasuredMesh,
    /// Groups of nodes whose reactions are given.
    pub groups: Vec<NodeGroup>,
    /// The rigid motion that was taken off at each instant; empty when none was asked to be.
    pub removed: Vec<RigidMotion>,
    /// What is possible, but hardly meant.
    pub remarks: Vec<Remark>,
}

/// The mesh of a measurement. Its nodes have the same numbers in the mesh of the model, which may be a refinement.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredMesh {
    /// The mesh as it was given.
    pub mesh: JointMesh,
    /// Its prescribed nodes.
    pub prescribed: Vec<u32>,
    /// What carries its nodal values to the model's mesh; `None` where they are one.
    pub carry: Option<Carry>,
    /// Supports and loads of the model, which come to the prescribed nodes.
    pub drives: Drives,
}

impl MeasuredMesh {
    /// Displacements of the model's prescribed nodes, from those of the prescribed nodes of this mesh at each instant.
    ///
    /// # Errors
    /// See [`BoundaryHistory::new`].
    pub fn boundary(&self, instants: Vec<Vec<[f64; 2]>>) -> Result<BoundaryHistory, BoundaryFault> {
        if self.prescribed.is_empty() {
            return BoundaryHistory::of_drives(&self.drives, instants.len());
        }
        let boundary = BoundaryHistory::new(self.prescribed.clone(), instants)?;
        match &self.carry {
            Some(carry) => self.mesh.carry_boundary(carry, &boundary),
            None => boundary,
        }
        .with(&self.drives)
    }
}

/// Largest share of the border of a body that may be lost in some frame: what is left still says how it moves.
const MOST_LOST: f64 = 0.1;

/// What is said of a mesh of several parts without a law between them.
const NO_LAW: &str = "is missing, and the mesh has more than one part: give the law of the adhesive between them \
                      (docs/mechanics.md); without one there is one body, whose nodes hang together";

/// Key of the one value of a material that need not be given.
const FACTOR: &str = "curve_factor";

impl Joint {
    /// The joint of a case.
    ///
    /// # Errors
    /// See [`JointError`].
    pub fn new(input: &JointInput) -> Result<Self, JointError> {
        let case = &input.case;
        let (law, kinematics, quadrature) = law_of_case(&case.cohesive)?;
        let mut mesh = mesh(&input.mesh, law.name() == NoAdhesive::NAME)?;
        let held = held_nodes(input, &mesh)?;
        if let Some(text) = &case.mesh.crack {
            let refused = |what: String| wrong("mesh", Some("crack"), format!("crack = \"{text}\": {what}"));
            let nodes = select_nodes(text, &mesh).map_err(refused)?;
            mesh = mesh.with_crack(&nodes).map_err(|fault| refused(fault.to_string()))?;
        }
        let mut found = Vec::new();
        let mut boundary = match &input.boundary {
            BoundaryInput::Table(table) => Some(from_table(table, &input.mesh, &mesh, held.as_deref(), &mut found)?),
            BoundaryInput::Run(run) => Some(from_run(run, &mesh, held, &mut found)?),
            BoundaryInput::Drives => None,
        };
        let mut measured = MeasuredMesh {
            mesh: mesh.clone(),
            prescribed: boundary.as_ref().map_or_else(Vec::new, |boundary| boundary.nodes().to_vec()),
            carry: None,
            drives: Drives::default(),
        };
        if let Some(k) = case.mesh.refine {
            let (fine, carry) =
                mesh.refined(k).map_err(|fault| JointError::Mesh { place: OF_MESH.to_owned(), fault })?;
            boundary = boundary.map(|boundary| mesh.carry_boundary(&carry, &boundary));
            mesh = fine;
            measured.carry = Some(carry);
        }
        let mut removed = Vec::new();
        if case.boundary.remove_rigid_motion == Some(CaseRigidMotion::Overall) {
            let Some(measured) = boundary.filter(|_| input.drives.is_empty()) else {
                let what = "remove_rigid_motion = \"overall\" would move what [[support]] holds; take one of them away";
                return Err(wrong("boundary", Some("remove_rigid_motion"), what.to_owned()));
            };
            let (left, motions) = measured.without_rigid_motion(mesh.nodes());
            (boundary, removed) = (Some(left), motions);
            if kinematics == Kinematics::Paper {
                let largest = removed.iter().fold(0.0_f64, |most, motion| most.max(motion.rotation_rad.abs()));
                found.push(remarks::rigid_motion_removed(largest, mesh.gap()));
            }
        }
        let materials = materials_of_case(&case.substrate, mesh.groups())?;
        let options = ModelOptions { kinematics, quadrature, ..ModelOptions::default() };
        let (model, boundary) = match boundary {
            Some(boundary) if input.drives.is_empty() => {
                (Model::new(mesh, materials, boundary.nodes(), options)?, boundary)
            }
            border => {
                let n = border.as_ref().map(|border| border.instants().len());
                let (drives, n) = drives_of_case(input, &mesh, measured.carry.as_ref(), n)?;
                let driven = match border {
                    Some(border) => border.with(&drives),
                    None => BoundaryHistory::of_drives(&drives, n),
                };
                let boundary = driven.map_err(JointError::Drives)?;
                measured.drives = drives;
                let model =
                    Model::supported(mesh, materials, boundary.supports(), options).map_err(JointError::Held)?;
                (model, boundary)
            }
        };
        let groups = node_groups(input, &model, &boundary, measured.carry.as_ref())?;
        let mut joint = Self { model, law, boundary, measured, groups, removed, remarks: found };
        joint.doubt_units();
        Ok(joint)
    }

    /// Lengths that cannot all be in mm.
    fn doubt_units(&mut self) {
        let (size, opening) = (self.model.mesh().element_size(), self.law.front_opening());
        let has_adhesive = !self.model.mesh().interfaces().is_empty();
        if has_adhesive && (size > 1e4 * opening || size < 1e-4 * opening) {
            self.remarks.push(remarks::elements_apart(size, opening));
        }
        let largest = self.boundary.instants().iter().flatten().flatten().fold(0.0_f64, |most, u| most.max(u.abs()));
        let extent = self.model.mesh().extent();
        if largest > extent {
            self.remarks.push(remarks::border_apart(largest, extent));
        }
    }
}

/// The nodes that are prescribed where `[boundary] free` names parts of the border.
fn held_nodes(input: &JointInput, mesh: &JointMesh) -> Result<Option<Vec<u32>>, JointError> {
    let names = &input.case.boundary.free;
    let mut free = vec![false; mesh.nodes().len()];
    for name in names {
        let refused = |what: String| wrong("boundary", Some("free"), format!("free: {name}: {what}"));
        let nodes = nodes_of_group(input, name, mesh, None).map_err(refused)?;
        nodes.into_iter().for_each(|node| free[node as usize] = true);
    }
    Ok((!names.is_empty()).then(|| mesh.outer_nodes_without(|node| free[node as usize])))
}

/// The mesh of a joint, or `of_body`: of one body.
fn mesh(input: &MeshInput, of_body: bool) -> Result<JointMesh, JointError> {
    if of_body && matches!(input, MeshInput::Rectangle { .. }) {
        return Err(wrong("cohesive", None, NO_LAW.to_owned()));
    }
    match input {
        MeshInput::File(file) | MeshInput::Run(file) => {
            let JointMeshFile { path, nodes, elements, interfaces, faces, lower, groups, element_group, .. } =
                file.clone();
            let paired = interfaces.as_ref().is_some_and(|list| !(of_body && list.is_empty()));
            let interfaces = interfaces.unwrap_or_default();
            let cracked = Vec::new();
            let parts = JointParts { nodes, elements, interfaces, cracked, faces, lower, groups, element_group };
            let made = match of_body {
                true if paired => return Err(wrong("cohesive", None, NO_LAW.to_owned())),
                true => match JointMesh::of_body(parts) {
                    Err(MeshFault::NoInterface) => return Err(wrong("cohesive", None, NO_LAW.to_owned())),
                    made => made,
                },
                false if paired => JointMesh::new(parts),
                false => JointMesh::from_strips(parts),
            };
            made.map_err(|fault| JointError::Mesh { place: path.display().to_string(), fault })
        }
        &MeshInput::Rectangle { element_size, columns, rows, gap } => {
            JointMesh::rectangular(columns, rows, element_size, gap)
                .map_err(|fault| JointError::Mesh { place: OF_MESH.to_owned(), fault })
        }
    }
}

/// The groups of nodes of the case and those that supports and loads name; else those of the mesh file of which some
/// node is prescribed; else the prescribed nodes of each strip.
fn node_groups(
    input: &JointInput,
    model: &Model,
    boundary: &BoundaryHistory,
    carry: Option<&Carry>,
) -> Result<Vec<NodeGroup>, JointError> {
    let mesh = model.mesh();
    let (mut held, mut loaded) = (vec![false; mesh.nodes().len()], vec![false; mesh.nodes().len()]);
    let supports = boundary.supports();
    let supported = supports.nodes.iter().chain(supports.blocks.iter().flat_map(|block| &block.nodes));
    supported.for_each(|&node| held[node as usize] = true);
    boundary.loaded().iter().for_each(|&node| loaded[node as usize] = true);
    let made = |name: &str, nodes: Vec<u32>| {
        let group = NodeGroup::new(name, nodes);
        NodeGroup { loaded: group.nodes.iter().any(|&node| loaded[node as usize]), ..group }
    };
    let acted_on = |group: &NodeGroup| group.loaded || group.nodes.iter().any(|&node| held[node as usize]);
    // What is free has no reaction.
    let is_free = |name: &&str| input.case.boundary.free.iter().any(|free| free == name);
    let mut names: Vec<&str> = input.case.groups.keys().map(String::as_str).filter(|name| !is_free(name)).collect();
    let of_drives = (input.drives.supports.iter().map(|(support, _)| &support.group))
        .chain(input.drives.loads.iter().map(|(load, _)| &load.group));
    for name in of_drives {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    if !names.is_empty() {
        let group = |name: &str| {
            let refused = |what: String| wrong("groups", Some(name), format!("{name}: {what}"));
            let group = made(name, nodes_of_group(input, name, mesh, carry).map_err(refused)?);
            match acted_on(&group) {
                true => Ok(group),
                false => Err(refused("none of its nodes is prescribed, so that nothing holds it".to_owned())),
            }
        };
        return names.into_iter().map(group).collect();
    }
    let named: Vec<NodeGroup> = match &input.mesh {
        MeshInput::File(file) | MeshInput::Run(file) => {
            let carried = |nodes: &Vec<u32>| carry.map_or_else(|| nodes.clone(), |carry| carry.nodes_between(nodes));
            file.node_groups.iter().map(|(name, nodes)| made(name, carried(nodes))).filter(acted_on).collect()
        }
        MeshInput::Rectangle { .. } => Vec::new(),
    };
    Ok(if named.is_empty() { NodeGroup::of_strips(mesh, model.prescribed()) } else { named })
}

/// The prescribed displacements of a table, for the nodes of `mesh`.
fn from_table(
    table: &BoundaryTable,
    input: &MeshInput,
    mesh: &JointMesh,
    held: Option<&[u32]>,
    found: &mut Vec<Remark>,
) -> Result<BoundaryHistory, JointError> {
    let file = match input {
        MeshInput::File(file) => Some(file),
        MeshInput::Run(_) | MeshInput::Rectangle { .. } => None,
    };
    let by_position = file.is_some_and(|file| file.by_position);
    let tolerance = SAME_PLACE * mesh.element_size();
    let near = |at: [f64; 2], [x, y]: [f64; 2]| (x - at[0]).abs() <= tolerance && (y - at[1]).abs() <= tolerance;
    let mut nodes = Vec::with_capacity(table.nodes.len());
    for (&node, &at) in table.nodes.iter().zip(&table.positions) {
        let named = mesh.nodes().get(node as usize).is_some_and(|&place| near(at, place));
        let found = || mesh.nodes().iter().position(|&place| near(at, place)).filter(|_| by_position);
        let found = if named { Some(node as usize) } else { found() };
        let Some(found) = found else {
            let there = mesh.nodes().get(node as usize).map_or_else(
                || format!("the mesh has {} nodes", mesh.nodes().len()),
                |[x, y]| format!("the mesh has it at ({x}, {y}) mm"),
            );
            let [x, y] = at;
            return Err(JointError::Boundary(format!(
                "{}: node {node} at ({x}, {y}) mm is not a node of the mesh: {there}; nodes are counted from 0, y is up",
                table.path.display()
            )));
        };
        nodes.push(found as u32);
    }
    let mut given = vec![false; mesh.nodes().len()];
    nodes.iter().for_each(|&node| given[node as usize] = true);
    let ends = mesh.face_ends();
    let missing = |border: &[u32]| border.iter().copied().find(|&node| !given[node as usize] && !ends.contains(&node));
    if let Some(node) = file.and_then(|file| file.prescribed.as_deref()).and_then(missing) {
        let [x, y] = mesh.nodes()[node as usize];
        return Err(JointError::Boundary(format!(
            "{}: there is no row for node {node} at ({x}, {y}) mm, which the mesh file has among its prescribed nodes; give its \
             displacement at every instant, or take it off that list",
            table.path.display()
        )));
    }
    let free: Vec<u32> = mesh.outer_nodes().into_iter().filter(|&node| !given[node as usize]).collect();
    let Some(held) = held else {
        found.extend(remarks::border_free(&free));
        return history(nodes, table.instants.clone(), &table.path);
    };
    if let Some(node) = held.iter().find(|&&node| !given[node as usize]) {
        let what =
            format!("{}: there is no row for node {node}, which [boundary] free does not name", table.path.display());
        return Err(JointError::Boundary(what));
    }
    let chosen: Vec<usize> = (0..nodes.len()).filter(|&k| held.binary_search(&nodes[k]).is_ok()).collect();
    let pick = |instant: &Vec<[f64; 2]>| chosen.iter().map(|&k| instant[k]).collect();
    history(chosen.iter().map(|&k| nodes[k]).collect(), table.instants.iter().map(pick).collect(), &table.path)
}

/// The measured displacements of the outer nodes, or of those that are `held`, frame by frame.
fn from_run(
    run: &JointRun,
    mesh: &JointMesh,
    held: Option<Vec<u32>>,
    found: &mut Vec<Remark>,
) -> Result<BoundaryHistory, JointError> {
    found.extend(remarks::frames_left_out(&run.left_out));
    let mut nodes = held.unwrap_or_else(|| mesh.outer_nodes());
    if mesh.interfaces().is_empty() {
        // Of a body a few may be lost, at the edge of a hole: no force acts there.
        let is_lost = |&node: &u32| run.instants.iter().any(|field| field[node as usize].is_none());
        let (lost, kept): (Vec<u32>, Vec<u32>) = nodes.iter().partition(|node| is_lost(node));
        if (lost.len() as f64) < MOST_LOST * nodes.len() as f64 {
            found.extend(remarks::border_lost(&lost));
            nodes = kept;
        }
    }
    let mut instants = Vec::with_capacity(run.instants.len());
    for (&frame, field) in run.frames.iter().zip(&run.instants) {
        let missing = |node: u32| {
            JointError::Boundary(format!(
                "{}: frame {frame} has no displacement at node {node} of the outer border; correlate with fewer frames or another \
                 region",
                run.path.display()
            ))
        };
        let at = |&node: &u32| field[node as usize].ok_or_else(|| missing(node));
        instants.push(nodes.iter().map(at).collect::<Result<_, _>>()?);
    }
    history(nodes, instants, &run.path)
}

fn history(nodes: Vec<u32>, instants: Vec<Vec<[f64; 2]>>, path: &Path) -> Result<BoundaryHistory, JointError> {
    let refused = |fault| JointError::Boundary(format!("{}: {fault}", path.display()));
    BoundaryHistory::new(nodes, instants).map_err(refused)
}

/// The values of a law's parameters, when no other keys are there than those, `others`, and what states uncertainties
/// (which the model does not need).
fn values(
    given: &BTreeMap<String, f64>,
    section: &str,
    model: &str,
    parameters: &[Parameter],
    others: &str,
) -> Result<Vec<f64>, JointError> {
    let keys: Vec<String> = parameters.iter().map(Parameter::key).collect();
    let needed = keys.join(", ");
    let std: Vec<String> = keys.iter().map(|key| format!("{key}{STD}")).collect();
    if let Some(key) = given.keys().find(|&key| !keys.contains(key) && !std.contains(key)) {
        let std = std.join(", ");
        let what = format!(
            "{key}: there is no such key; model = \"{model}\" needs {needed}; also {others}; standard uncertainties: {std}, {EXACT}"
        );
        return Err(wrong(section, Some(key), what));
    }
    let value = |key: &String| {
        let missing = || wrong(section, None, format!("{key} is missing; model = \"{model}\" needs {needed}"));
        given.get(key).copied().ok_or_else(missing)
    };
    keys.iter().map(value).collect()
}

/// The law of the section `[cohesive]`, and how the interface is modelled.
///
/// # Errors
/// See [`JointError`].
pub fn law_of_case(given: &CaseCohesive) -> Result<(Box<dyn CohesiveLaw>, Kinematics, Quadrature), JointError> {
    let model = given.model.as_deref().unwrap_or(ExtendedXuNeedleman::NAME);
    let parameters = parameters_by_name(model)?;
    let values = values(&given.values, "cohesive", model, parameters, "model, kinematics, quadrature")?;
    // A body is stretched by what its strains are compared with: small rotations would be 1.5 strains off.
    let usual = if model == NoAdhesive::NAME { Kinematics::Finite } else { Kinematics::default() };
    let (kinematics, quadrature) = (given.kinematics.unwrap_or(usual), given.quadrature.unwrap_or_default());
    Ok((law_by_name(model, &values)?, kinematics, quadrature))
}

/// One material for each group of elements: that of `[substrate.NAME]`, else that of `[substrate]`.
///
/// # Errors
/// See [`JointError`].
pub fn materials_of_case(
    CaseSubstrate { common, groups: own }: &CaseSubstrate,
    groups: &[String],
) -> Result<Vec<Arc<dyn SubstrateLaw>>, JointError> {
    if let Some(name) = own.keys().find(|name| !groups.contains(name)) {
        let there = groups.join(", ");
        let what = format!("the mesh has no group of elements of that name; it has {there}");
        return Err(wrong(&format!("substrate.{name}"), None, what));
    }
    groups
        .iter()
        .map(|group| {
            let of_group = own.get(group);
            let section = of_group.map_or_else(|| "substrate".to_owned(), |_| format!("substrate.{group}"));
            let CaseMaterial { model, plane, values: given, curve, file, exact: _ } = of_group.unwrap_or(common);
            let model = model.as_deref().unwrap_or(RambergOsgood::NAME);
            let plane = plane.or(common.plane).unwrap_or_default();
            let parameters = substrate_parameters(model, plane)?;
            if model != Tabulated::NAME {
                if let Some(key) = curve.as_ref().map(|_| "curve").or(file.as_ref().map(|_| "file")) {
                    let what = format!("{key}: model = \"{model}\" takes no curve; give model = \"{}\"", Tabulated::NAME);
                    return Err(wrong(&section, Some(key), what));
                }
                let values = values(given, &section, model, parameters, "model, plane")?;
                return Ok(Arc::from(substrate_by_name(model, &values, plane)?));
            }
            let mut given = given.clone();
            given.entry(FACTOR.to_owned()).or_insert(1.0);
            let values = values(&given, &section, model, parameters, "model, plane, file, curve")?;
            let Some(curve) = curve else {
                let what = "file is missing; model = \"tabulated\" needs a file with the columns strain and stress_MPa, or curve = \
                            [[strain, MPa], ...]";
                return Err(wrong(&section, None, what.to_owned()));
            };
            let values: [f64; 3] = values.try_into().unwrap_or([f64::NAN; 3]);
            let law: Arc<dyn SubstrateLaw> = Arc::new(Tabulated::new(values, curve, plane)?);
            Ok(law)
        })
        .collect()
}

/// What each law takes in `[cohesive]` and each material in `[substrate]`, for the schema of case files.
pub fn case_laws() -> CaseLaws {
    let law_keys = |model: &'static str, parameters: &[Parameter]| {
        let keys = parameters.iter().map(|p| LawKey { key: p.key(), symbol: p.name, unit: p.unit, meaning: p.meaning });
        LawKeys { model, keys: keys.collect() }
    };
    // Every name has its parameters.
    let cohesive = LAW_NAMES.iter().filter_map(|name| Some(law_keys(name, parameters_by_name(name).ok()?)));
    // In plane strain a law has all of its parameters.
    let of_material = |name| Some(law_keys(name, substrate_parameters(name, PlaneState::PlaneStrain).ok()?));
    let substrate = SUBSTRATE_NAMES.into_iter().filter_map(of_material);
    CaseLaws { cohesive: cohesive.collect(), substrate: substrate.collect() }
}
