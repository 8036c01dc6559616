//! Mesh files of a joint.

use super::{JointFileError, bytes_of};
use crate::mesh_file::{MeshFile, parse_mesh};
use serde::Deserialize;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// What a mesh file holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointMeshFile {
    /// The file.
    pub path: PathBuf,
    /// Positions, mm, y up.
    pub nodes: Vec<[f64; 2]>,
    /// Corners of the elements, counter-clockwise; of a triangle the last one twice.
    pub elements: Vec<[u32; 4]>,
    /// Interface elements, lower left, lower right, upper left, upper right; `None` when the file names none.
    pub interfaces: Option<Vec<[u32; 4]>>,
    /// Nodes of the faces of the adhesive, where the file names them; empty otherwise.
    pub faces: Vec<u32>,
    /// The group that lies below the adhesive, where the case says it (`[mesh] zones`).
    pub lower: Option<u32>,
    /// Nodes that the file says are prescribed.
    pub prescribed: Option<Vec<u32>>,
    /// Nodes that the file selects for comparison with a measurement.
    pub selected: Option<Vec<u32>>,
    /// Groups of nodes by name, where the file has such.
    pub node_groups: BTreeMap<String, Vec<u32>>,
    /// Names of the groups of elements; empty for one group.
    pub groups: Vec<String>,
    /// Group of each element.
    pub element_group: Vec<u32>,
    /// Whether the file gives its nodes no numbers from 0, so that positions tell them.
    pub by_position: bool,
    /// Scale of the images that the mesh was drawn on, mm per pixel; `None` of a mesh that knows no image.
    pub mm_per_px: Option<f64>,
}

/// Physical groups of curves of a `.msh` file that a joint knows.
const LOWER_FACE: &str = "lower_face";
const UPPER_FACE: &str = "upper_face";
const BOUNDARY: &str = "boundary";

#[derive(Deserialize)]
struct MeshJson {
    nodes: Vec<[f64; 2]>,
    quads: Vec<[u32; 4]>,
    cohesive: Option<Vec<[u32; 4]>>,
    #[serde(default)]
    lower_face: Vec<u32>,
    #[serde(default)]
    upper_face: Vec<u32>,
    dirichlet_nodes: Option<Vec<u32>>,
    selected_nodes: Option<Vec<u32>>,
    #[serde(default)]
    node_groups: BTreeMap<String, Vec<u32>>,
    #[serde(default)]
    groups: Vec<String>,
    #[serde(default)]
    quad_group: Vec<u32>,
}

/// Reads a mesh of a joint: JSON (`nodes`, `quads`, `cohesive`; optional `groups` and `quad_group`), Gmsh `.msh`,
/// or `.vtu`, told by content. Coordinates are mm with y up. JSON may also list `lower_face`, `upper_face`,
/// `dirichlet_nodes`, `selected_nodes` and `node_groups` (lists by name); a `.msh` file says the same by physical
/// groups of curves named `lower_face`, `upper_face`, `boundary` and whatever else. In `.msh` and `.vtu` the physical
/// groups of surfaces (or the cell data `zone`) are groups of elements; nodes of different groups at the same place are
/// one node, so that the layers of a strip hang together; nodes are numbered in the order of the groups.
pub fn read_joint_mesh(path: &Path) -> Result<JointMeshFile, JointFileError> {
    parse_joint_mesh(&bytes_of(path)?, path)
}

/// The mesh with the content `bytes`; `path` stands in messages. See [`read_joint_mesh`].
pub fn parse_joint_mesh(bytes: &[u8], path: &Path) -> Result<JointMeshFile, JointFileError> {
    if bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{') {
        let wrong = |reason: String| {
            JointFileError::file(
                path,
                format!(
                    "no mesh of a joint in JSON ({reason}); it needs \"nodes\" [x, y] in mm and \"quads\", and \"cohesive\" where \
                     the faces are not to be found by geometry"
                ),
            )
        };
        let mut mesh: MeshJson = serde_json::from_slice(bytes).map_err(|error| wrong(error.to_string()))?;
        mesh.lower_face.append(&mut mesh.upper_face);
        let lists = mesh.dirichlet_nodes.iter().chain(&mesh.selected_nodes);
        let listed = mesh.lower_face.iter().chain(lists.flatten()).chain(mesh.node_groups.values().flatten());
        if let Some(node) = listed.copied().find(|&node| node as usize >= mesh.nodes.len()) {
            let n_nodes = mesh.nodes.len();
            return Err(wrong(format!("a list of nodes names node {node}, there are {n_nodes} (counted from 0)")));
        }
        return Ok(JointMeshFile {
            path: path.to_owned(),
            nodes: mesh.nodes,
            elements: mesh.quads,
            interfaces: mesh.cohesive,
            faces: mesh.lower_face,
            prescribed: mesh.dirichlet_nodes,
            selected: mesh.selected_nodes,
            node_groups: mesh.node_groups,
            groups: mesh.groups,
            element_group: mesh.quad_group,
            ..JointMeshFile::default()
        });
    }
    let MeshFile { zones, curves, .. } = parse_mesh(bytes, path)?;
    let mut mesh = JointMeshFile { path: path.to_owned(), by_position: true, ..JointMeshFile::default() };
    let mut number: HashMap<[u64; 2], u32> = HashMap::new();
    // Adding zero makes -0 the same place as 0.
    let place = |position: [f64; 2]| position.map(|c| (c + 0.0).to_bits());
    for zone in zones {
        let of: Vec<u32> = (zone.nodes.iter())
            .map(|&position| {
                *number.entry(place(position)).or_insert_with(|| {
                    mesh.nodes.push(position);
                    mesh.nodes.len() as u32 - 1
                })
            })
            .collect();
        let group = mesh.groups.len() as u32;
        mesh.groups.push(zone.name);
        for corners in zone.elements {
            #[expect(clippy::indexing_slicing, reason = "a zone numbers its own nodes, which parse_mesh has counted")]
            let corners = corners.map(|node| of[node as usize]);
            mesh.element_group.push(group);
            mesh.elements.push(counter_clockwise(corners, &mesh.nodes));
        }
    }
    for curve in curves {
        let nodes = curve.nodes.iter().filter_map(|&position| number.get(&place(position)).copied());
        match curve.name.as_str() {
            LOWER_FACE | UPPER_FACE => mesh.faces.extend(nodes),
            BOUNDARY => mesh.prescribed.get_or_insert_default().extend(nodes),
            _ => mesh.node_groups.entry(curve.name).or_default().extend(nodes),
        }
    }
    Ok(mesh)
}

/// The corners counter-clockwise (y up); of a triangle the last one twice.
#[expect(clippy::indexing_slicing, reason = "callers have counted the nodes")]
pub fn counter_clockwise([a, b, c, d]: [u32; 4], nodes: &[[f64; 2]]) -> [u32; 4] {
    let at = [a, b, c, d].map(|node| nodes[node as usize]);
    let area: f64 = (0..4)
        .map(|k| {
            let (p, q) = (at[k], at[(k + 1) % 4]);
            p[0] * q[1] - p[1] * q[0]
        })
        .sum();
    match (area < 0.0, c == d) {
        (false, _) => [a, b, c, d],
        (true, true) => [a, c, b, b],
        (true, false) => [a, d, c, b],
    }
}
