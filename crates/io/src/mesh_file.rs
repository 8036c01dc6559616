//! Mesh files: Gmsh `.msh` and VTK `.vtu`, read as zones of quadrilaterals and triangles.
//!
//! Both readers are our own: they take what a file holds, check every number against the file before it is
//! believed, and name the place of a fault. (Of the crates that were tried, the one for `.msh` forgets the
//! numbers of the nodes and the names of the groups, and both stop with a panic on some damaged files.)

mod gmsh;
mod inp;
mod model;
mod sound;
mod vtu;

pub use model::{ModelField, ModelFileError, is_model, read_model};

use crate::mesh::ZoneElements;
use crate::text::read_file;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// How far the nodes may lie from one plane z = constant, px.
const FLAT_PX: f64 = 1e-6;

/// The zones of a mesh file.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshFile {
    /// Its zones, in the order of their numbers in the file. Node positions are px of the reference image, y
    /// down; a triangle is an element whose last two nodes are equal.
    pub zones: Vec<ZoneElements>,
    /// The physical groups of curves of a `.msh` file that have a name. Those of images leave them aside.
    pub curves: Vec<NamedCurve>,
    /// What a user should know: lines and points, and elements of no group, left aside. Often empty.
    pub notes: Vec<String>,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
}

/// A named group of curves.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCurve {
    /// Its name.
    pub name: String,
    /// Positions of the nodes on it, each once.
    pub nodes: Vec<[f64; 2]>,
}

/// Why a file gives no mesh.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeshFileError {
    /// There is no such file.
    #[error("{}: there is no such mesh file; check the name and the folder", .0.display())]
    NotFound(PathBuf),
    /// The file system refuses.
    #[error("{}: the mesh file cannot be read: {}", .0.display(), .1)]
    Io(PathBuf, io::Error),
    /// The content is neither of the two formats: its first bytes.
    #[error("{}: not a mesh: the content begins with {}; give a Gmsh .msh file (version 4.1 or 2.2) or a VTK .vtu file", .0.display(), .1)]
    NotAMesh(PathBuf, String),
    /// A version or a variant of the format that is not read: what it is, and what to do.
    #[error("{}: {} is not read; {}", .0.display(), .1, .2)]
    Unsupported(PathBuf, String, String),
    /// The file ends too early: what is missing.
    #[error("{}: the mesh file is cut off: {}; copy or save it again", .0.display(), .1)]
    Truncated(PathBuf, String),
    /// Something that does not belong there: the line, or the byte of a binary file, and what is wrong.
    #[error("{}, {}: {}; the file is damaged: copy or save it again", .0.display(), .1, .2)]
    Invalid(PathBuf, String, String),
    /// An element that cannot be used.
    #[error(
        "{}: element {element} is {kind}; give a plane mesh of four-node quadrilaterals and three-node triangles",
        path.display()
    )]
    ElementKind {
        /// The file.
        path: PathBuf,
        /// Its number in the file.
        element: u64,
        /// What it is.
        kind: String,
    },
    /// An element names a node that is not there.
    #[error("{}: element {element} has the node {node}, which is not in the file; save the whole mesh", path.display())]
    NodeMissing {
        /// The file.
        path: PathBuf,
        /// The element's number in the file.
        element: u64,
        /// The node's number in the file.
        node: i64,
    },
    /// Two elements have the same nodes.
    #[error(
        "{}: elements {element} and {other} have the same nodes and would count twice; delete one of them",
        path.display()
    )]
    Twice {
        /// The file.
        path: PathBuf,
        /// One element's number in the file.
        element: u64,
        /// The other's.
        other: u64,
    },
    /// Two elements of a zone lie over each other.
    #[error(
        "{}: elements {element} and {other} lie over each other, where pixels would count twice; mesh the surface once",
        path.display()
    )]
    Overlap {
        /// The file.
        path: PathBuf,
        /// One element's number in the file.
        element: u64,
        /// The other's.
        other: u64,
    },
    /// A node lies within the side of an element that does not have it.
    #[error(
        "{}: node {node} of element {other} lies within a side of element {element}, which would gape there; let the \
         elements share all nodes of their sides",
        path.display()
    )]
    Hanging {
        /// The file.
        path: PathBuf,
        /// The node's number in the file.
        node: u64,
        /// The element with the side.
        element: u64,
        /// The element with the node.
        other: u64,
    },
    /// A coordinate is NaN or infinite.
    #[error("{}: node {node} is at ({x}, {y}) px: its position must be finite", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The node's number in the file.
        node: u64,
        /// Column.
        x: f64,
        /// Row.
        y: f64,
    },
    /// The nodes are not in one plane z = constant.
    #[error(
        "{}: node {node} has z = {z} and node {other} z = {other_z}: the mesh must lie in the image plane, with one z",
        path.display()
    )]
    NotFlat {
        /// The file.
        path: PathBuf,
        /// One node.
        node: u64,
        /// Its z.
        z: f64,
        /// Another node.
        other: u64,
        /// Its z.
        other_z: f64,
    },
    /// There is no quadrilateral and no triangle: what it holds instead, with ` (` and `)`, or nothing.
    #[error("{}: the file holds no quadrilateral and no triangle{}; save the surface mesh", .0.display(), .1)]
    Empty(PathBuf, String),
    /// No zone has this name; the names that there are.
    #[error("{}: there is no group '{}'; the file has {}", .0.display(), .1, .2)]
    NoGroup(PathBuf, String, String),
}

/// Reads the zones of the mesh file `path`: Gmsh `.msh` (version 4.1, text or binary; version 2.2, text) or VTK
/// `.vtu` (text, binary, appended; uncompressed or zlib). The content decides, not the ending of the name.
///
/// Node positions are **px of the reference image, x to the right, y down**; z is ignored, but must be
/// the same for all nodes. Quadrilaterals and triangles are taken, lines and points left aside. The physical
/// groups of surfaces of a `.msh` file, or the cell data `zone` of a `.vtu` file, become zones, each with its own
/// copy of the nodes; without any there is one zone named `mesh`. A `.vtu` file written by quadrille is such a file.
///
/// # Errors
/// See [`MeshFileError`]: each names the file, what is wrong and what to do.
pub fn read_mesh(path: &Path) -> Result<MeshFile, MeshFileError> {
    let bytes = read_file(path, MeshFileError::NotFound, MeshFileError::Io)?;
    let mut mesh = parse_mesh(&bytes, path)?;
    mesh.sha256 = super::images::sha256(&bytes);
    Ok(mesh)
}

/// The mesh in `bytes`, without the hash; `path` stands in messages.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::mesh_file::parse_mesh;
/// let text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 8 8 0\n2 40 8 0\n3 8 40 0\n$EndNodes\n\
///             $Elements\n1\n1 2 0 1 2 3\n$EndElements\n";
/// let mesh = parse_mesh(text.as_bytes(), "a.msh".as_ref()).unwrap();
/// assert_eq!(mesh.zones[0].elements, [[0, 1, 2, 2]]);
/// ```
///
/// # Errors
/// As [`read_mesh`], but nothing is read.
pub fn parse_mesh(bytes: &[u8], path: &Path) -> Result<MeshFile, MeshFileError> {
    let parsed = if gmsh::is_msh(bytes) {
        gmsh::parse(bytes)
    } else if vtu::is_vtk_xml(bytes) {
        vtu::parse(bytes)
    } else {
        return Err(MeshFileError::NotAMesh(path.to_owned(), super::images::beginning(bytes)));
    };
    parsed.and_then(Parsed::finish).map_err(|problem| problem.of(path))
}

impl MeshFile {
    /// The zone named `group` alone.
    ///
    /// # Errors
    /// [`MeshFileError::NoGroup`], which names the zones there are and, as the file, `path`.
    pub fn group(self, group: &str, path: &Path) -> Result<ZoneElements, MeshFileError> {
        let there: Vec<_> = self.zones.iter().map(|zone| format!("'{}'", zone.name)).collect();
        self.zones
            .into_iter()
            .find(|zone| zone.name == group)
            .ok_or_else(|| MeshFileError::NoGroup(path.to_owned(), group.to_owned(), there.join(", ")))
    }
}

/// What a reader can find wrong, before the file's name is known.
#[derive(Debug)]
enum MeshFileFault {
    Unsupported { what: String, remedy: String },
    Truncated(String),
    Invalid { place: String, what: String },
    ElementKind { element: u64, kind: String },
    NodeMissing { element: u64, node: i64 },
    Twice { element: u64, other: u64 },
    Overlap { element: u64, other: u64 },
    Hanging { node: u64, element: u64, other: u64 },
    NotFinite { node: u64, x: f64, y: f64 },
    NotFlat { node: u64, z: f64, other: u64, other_z: f64 },
    Empty { aside: String },
}

impl MeshFileFault {
    fn of(self, path: &Path) -> MeshFileError {
        let path = path.to_owned();
        match self {
            MeshFileFault::Unsupported { what, remedy } => MeshFileError::Unsupported(path, what, remedy),
            MeshFileFault::Truncated(what) => MeshFileError::Truncated(path, what),
            MeshFileFault::Invalid { place, what } => MeshFileError::Invalid(path, place, what),
            MeshFileFault::ElementKind { element, kind } => MeshFileError::ElementKind { path, element, kind },
            MeshFileFault::NodeMissing { element, node } => MeshFileError::NodeMissing { path, element, node },
            MeshFileFault::Twice { element, other } => MeshFileError::Twice { path, element, other },
            MeshFileFault::Overlap { element, other } => MeshFileError::Overlap { path, element, other },
            MeshFileFault::Hanging { node, element, other } => MeshFileError::Hanging { path, node, element, other },
            MeshFileFault::NotFinite { node, x, y } => MeshFileError::NotFinite { path, node, x, y },
            MeshFileFault::NotFlat { node, z, other, other_z } => {
                MeshFileError::NotFlat { path, node, z, other, other_z }
            }
            MeshFileFault::Empty { aside } => MeshFileError::Empty(path, aside),
        }
    }
}

/// A node as the file has it.
#[derive(Debug, Clone, Copy)]
struct FileNode {
    /// Its number in the file.
    number: u64,
    at: [f64; 3],
}

/// A quadrilateral or a triangle as the file has it.
#[derive(Debug, Clone, Copy)]
struct FileElement {
    /// Its number in the file.
    number: u64,
    /// Places of its nodes in the list of nodes; the last two of a triangle are equal.
    nodes: [usize; 4],
    /// Number of its group.
    group: Option<i64>,
}

#[derive(Debug, Default)]
struct Parsed {
    nodes: Vec<FileNode>,
    elements: Vec<FileElement>,
    /// Names of groups, by their numbers.
    names: BTreeMap<i64, String>,
    /// Named groups of curves: the places of their nodes.
    curves: BTreeMap<String, BTreeSet<usize>>,
    /// Points and lines among the elements.
    n_aside: usize,
}

impl Parsed {
    /// Checks the positions, and gives each group its own nodes.
    fn finish(self) -> Result<MeshFile, MeshFileFault> {
        let aside = match self.n_aside {
            0 => String::new(),
            1 => "1 point or line".to_owned(),
            n => format!("{n} points and lines"),
        };
        if self.elements.is_empty() {
            return Err(MeshFileFault::Empty {
                aside: if aside.is_empty() { aside } else { format!(" (but {aside})") },
            });
        }
        let mut notes = Vec::new();
        if !aside.is_empty() {
            notes.push(format!("{aside} left aside"));
        }
        self.check_positions()?;

        // Without any group all elements are one; with groups, elements of none are not meant.
        let grouped = self.elements.iter().any(|element| element.group.is_some());
        let mut zones: BTreeMap<i64, Builder> = BTreeMap::new();
        let mut of_zones: BTreeMap<i64, Vec<&FileElement>> = BTreeMap::new();
        let mut n_ungrouped = 0;
        for element in &self.elements {
            let group = match element.group {
                Some(group) => group,
                None if grouped => {
                    n_ungrouped += 1;
                    continue;
                }
                None => 0,
            };
            zones.entry(group).or_default().add(element, &self.nodes);
            of_zones.entry(group).or_default().push(element);
        }
        of_zones.values().try_for_each(|elements| sound::check(elements, &self.nodes))?;
        if n_ungrouped > 0 {
            notes.push(format!("elements in no group left aside: {n_ungrouped}"));
        }
        let named = |(group, zone): (i64, Builder)| {
            let name = match self.names.get(&group) {
                Some(name) => name.clone(),
                None if grouped => format!("group{group}"),
                None => "mesh".to_owned(),
            };
            ZoneElements { name, nodes: zone.nodes, elements: zone.elements }
        };
        let zones = zones.into_iter().map(named).collect();
        #[expect(clippy::indexing_slicing, reason = "places were found in this list of nodes")]
        let curve = |(name, places): (&String, &BTreeSet<usize>)| {
            let at = |&place: &usize| [self.nodes[place].at[0], self.nodes[place].at[1]];
            NamedCurve { name: name.clone(), nodes: places.iter().map(at).collect() }
        };
        let curves = self.curves.iter().map(curve).collect();
        Ok(MeshFile { zones, curves, notes, sha256: String::new() })
    }

    /// Every node of an element is finite, and all have one z. Other nodes do not matter.
    fn check_positions(&self) -> Result<(), MeshFileFault> {
        let mut first: Option<FileNode> = None;
        for &place in self.elements.iter().flat_map(|element| &element.nodes) {
            let Some(&node) = self.nodes.get(place) else { continue };
            let [x, y, z] = node.at;
            if !(x.is_finite() && y.is_finite()) {
                return Err(MeshFileFault::NotFinite { node: node.number, x, y });
            }
            let reference = *first.get_or_insert(node);
            let off = (z - reference.at[2]).abs();
            if off.is_nan() || off > FLAT_PX {
                let (other, other_z) = (reference.number, reference.at[2]);
                return Err(MeshFileFault::NotFlat { node: node.number, z, other, other_z });
            }
        }
        Ok(())
    }
}

/// A zone that grows.
#[derive(Debug, Default)]
struct Builder {
    /// Number in the zone by place in the file's list.
    local: HashMap<usize, u32>,
    nodes: Vec<[f64; 2]>,
    elements: Vec<[u32; 4]>,
}

impl Builder {
    fn add(&mut self, element: &FileElement, nodes: &[FileNode]) {
        #[expect(clippy::indexing_slicing, reason = "the caller has looked every node up")]
        let number = |place: usize| {
            *self.local.entry(place).or_insert_with(|| {
                let [x, y, _] = nodes[place].at;
                self.nodes.push([x, y]);
                self.nodes.len() as u32 - 1
            })
        };
        self.elements.push(element.nodes.map(number));
    }
}
