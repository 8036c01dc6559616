//! Files of a joint: its case file, its mesh, the displacements of its border, the tables of a solution.
//!
//! Lengths in mm, stresses in MPa, x to the right and y **up** (THEORY 1); nodes are counted from 0, instants from 1.

use super::case::CaseError;
use super::mesh_file::{MeshFileError, parse_mesh};
use serde::Deserialize;
use std::collections::HashMap;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The case file of `quadrille simulate`; what it does not say is `None`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointCase {
    /// Folder of the case file: relative names in it are relative to this.
    #[serde(skip)]
    pub base: PathBuf,
    /// The table `[mesh]`.
    pub mesh: CaseJointMesh,
    /// The table `[boundary]`.
    pub boundary: CaseBoundary,
    /// The table `[substrate]`, with `[substrate.NAME]` where groups of elements have their own material.
    pub substrate: toml::Table,
    /// The table `[cohesive]`.
    pub cohesive: toml::Table,
    /// The table `[output]`.
    #[serde(default)]
    pub output: CaseJointOutput,
}

/// The table `[mesh]`: a file, or a correlation run, or a rectangle.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseJointMesh {
    /// A mesh file: JSON, Gmsh `.msh`, or `.vtu`.
    pub file: Option<String>,
    /// The store `fields.zarr` of a correlation run with two zones, or the folder of the run.
    pub store: Option<String>,
    /// Side of the square elements, mm.
    pub element_size_mm: Option<f64>,
    /// Elements along the joint.
    pub columns: Option<usize>,
    /// Rows of elements in each strip.
    pub rows: Option<usize>,
    /// Distance of the faces, mm.
    pub gap_mm: Option<f64>,
    /// Cut every element into this many by as many.
    pub refine: Option<usize>,
}

/// The table `[boundary]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseBoundary {
    /// Table of displacements: `instant,node,x_mm,y_mm,ux_mm,uy_mm`.
    pub file: Option<String>,
    /// The store of a correlation run: its outer nodes are prescribed.
    pub store: Option<String>,
    /// `none` (default) or `overall`.
    pub remove_rigid_motion: Option<String>,
}

/// The table `[output]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseJointOutput {
    /// Instants to draw, from 1; default: first, middle, last.
    pub figures: Option<Vec<usize>>,
    /// Also the derivatives by the materials' parameters.
    #[serde(default)]
    pub substrate_sensitivities: bool,
}

/// Reads the case file `path`.
///
/// # Errors
/// A file that cannot be read, that is not TOML, or that has a key that such a file does not have.
pub fn read_joint_case(path: &Path) -> Result<JointCase, CaseError> {
    let text = std::fs::read_to_string(path).map_err(|reason| match reason.kind() {
        ErrorKind::NotFound => CaseError::NotFound { path: path.to_owned() },
        ErrorKind::InvalidData => CaseError::NotText { path: path.to_owned(), line: 1 },
        _ => CaseError::Io { path: path.to_owned(), reason },
    })?;
    let mut case: JointCase = toml::from_str(&text).map_err(|error| {
        let before = text.get(..error.span().map_or(0, |span| span.start)).unwrap_or("");
        CaseError::Invalid {
            path: path.to_owned(),
            line: 1 + before.matches('\n').count(),
            column: 1 + before.rsplit('\n').next().unwrap_or("").chars().count(),
            key: None,
            message: error.message().replace('\n', "; "),
        }
    })?;
    case.base = path.parent().map(Path::to_owned).unwrap_or_default();
    Ok(case)
}

/// What a mesh file holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointMeshFile {
    /// Positions, mm, y up.
    pub nodes: Vec<[f64; 2]>,
    /// Corners of the elements, counter-clockwise; of a triangle the last one twice.
    pub elements: Vec<[u32; 4]>,
    /// Interface elements, lower left, lower right, upper left, upper right; `None` when the file names none.
    pub interfaces: Option<Vec<[u32; 4]>>,
    /// Names of the groups of elements; empty for one group.
    pub groups: Vec<String>,
    /// Group of each element.
    pub element_group: Vec<u32>,
    /// Whether the file gives its nodes no numbers from 0, so that positions tell them.
    pub by_position: bool,
}

/// Why a file of a joint cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum JointFileError {
    /// There is no such file.
    #[error("{}: there is no such file; check the name and the folder", path.display())]
    NotFound {
        /// The file.
        path: PathBuf,
    },
    /// The file system refuses.
    #[error("{}: the file cannot be read: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: io::Error,
    },
    /// Not the JSON of a mesh.
    #[error("{}: no mesh of a joint in JSON ({reason}); it needs \"nodes\" [x, y] in mm and \"quads\", and \"cohesive\" where the faces are not to be found by geometry", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A `.msh` or `.vtu` file that cannot be used.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// A table without the columns that are needed.
    #[error("{}: the header must be instant,node,x_mm,y_mm,ux_mm,uy_mm, not '{found}'", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// The header there is.
        found: String,
    },
    /// A row that is none.
    #[error("{}, line {line}: {what}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
    /// An instant without all nodes.
    #[error("{}: instant {instant} has no row for node {node}, which instant {other} has; every instant needs the same nodes", path.display())]
    MissingNode {
        /// The file.
        path: PathBuf,
        /// The instant without.
        instant: usize,
        /// The node.
        node: u32,
        /// An instant with it.
        other: usize,
    },
    /// Instants that are not 1, 2, 3, ....
    #[error("{}: there is no instant {instant}, but instant {last}; instants must be numbered 1, 2, 3, ... without a gap", path.display())]
    MissingInstant {
        /// The file.
        path: PathBuf,
        /// The one that is missing.
        instant: usize,
        /// The last one.
        last: usize,
    },
    /// A table without rows.
    #[error("{}: the table has no row", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, JointFileError> {
    std::fs::read(path).map_err(|reason| match reason.kind() {
        ErrorKind::NotFound => JointFileError::NotFound { path: path.to_owned() },
        _ => JointFileError::Io { path: path.to_owned(), reason },
    })
}

#[derive(Deserialize)]
struct MeshJson {
    nodes: Vec<[f64; 2]>,
    quads: Vec<[u32; 4]>,
    cohesive: Option<Vec<[u32; 4]>>,
    groups: Option<Vec<String>>,
    quad_group: Option<Vec<u32>>,
}

/// Reads a mesh of a joint: JSON (`nodes`, `quads`, `cohesive`; optional `groups` and `quad_group`), Gmsh `.msh`,
/// or `.vtu`, told by content. Coordinates are mm with y up. In `.msh` and `.vtu` the physical groups of surfaces
/// (or the cell data `zone`) are groups of elements; nodes of different groups at the same place are one node, so that
/// the layers of a strip hang together; nodes are numbered in the order of the groups.
///
/// # Errors
/// See [`JointFileError`].
pub fn read_joint_mesh(path: &Path) -> Result<JointMeshFile, JointFileError> {
    let bytes = bytes_of(path)?;
    if bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{') {
        let json = |error: serde_json::Error| JointFileError::Json { path: path.to_owned(), reason: error.to_string() };
        let MeshJson { nodes, quads, cohesive, groups, quad_group } = serde_json::from_slice(&bytes).map_err(json)?;
        let (groups, element_group) = (groups.unwrap_or_default(), quad_group.unwrap_or_default());
        return Ok(JointMeshFile {
            nodes,
            elements: quads,
            interfaces: cohesive,
            groups,
            element_group,
            by_position: false,
        });
    }
    let zones = parse_mesh(&bytes, path)?.zones;
    let mut mesh = JointMeshFile { by_position: true, ..JointMeshFile::default() };
    let mut number: HashMap<[u64; 2], u32> = HashMap::new();
    for zone in zones {
        // Adding zero makes -0 the same place as 0.
        let of: Vec<u32> = (zone.nodes.iter())
            .map(|&position| {
                *number.entry(position.map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                    mesh.nodes.push(position);
                    mesh.nodes.len() as u32 - 1
                })
            })
            .collect();
        let group = mesh.groups.len() as u32;
        mesh.groups.push(zone.name);
        for corners in zone.elements {
            let corners = corners.map(|node| of[node as usize]);
            mesh.element_group.push(group);
            mesh.elements.push(counter_clockwise(corners, &mesh.nodes));
        }
    }
    Ok(mesh)
}

/// The corners counter-clockwise (y up); of a triangle the last one twice.
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

/// The table of prescribed displacements.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryTable {
    /// Number of each node.
    pub nodes: Vec<u32>,
    /// Position of each node as the table gives it, mm.
    pub positions: Vec<[f64; 2]>,
    /// Displacements of the nodes at each instant, mm.
    pub instants: Vec<Vec<[f64; 2]>>,
}

/// Reads `instant,node,x_mm,y_mm,ux_mm,uy_mm`; lines that begin with `#` are comments. Rows may come in any order.
///
/// # Errors
/// See [`JointFileError`].
pub fn read_boundary(path: &Path) -> Result<BoundaryTable, JointFileError> {
    let bytes = bytes_of(path)?;
    let text = String::from_utf8_lossy(&bytes);
    let owned = || path.to_owned();
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let Some((_, header)) = lines.next() else { return Err(JointFileError::Empty { path: owned() }) };
    if header.split(',').map(str::trim).ne(["instant", "node", "x_mm", "y_mm", "ux_mm", "uy_mm"]) {
        return Err(JointFileError::Header { path: owned(), found: header.trim().to_owned() });
    }
    let (mut nodes, mut positions): (Vec<u32>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
    let mut place: HashMap<u32, usize> = HashMap::new();
    let mut values: Vec<HashMap<u32, [f64; 2]>> = Vec::new();
    for (line, row) in lines {
        let wrong = |what: String| JointFileError::Row { path: owned(), line, what };
        let fields: Vec<&str> = row.split(',').map(str::trim).collect();
        let &[instant, node, x, y, ux, uy] = fields.as_slice() else {
            return Err(wrong(format!("{} values instead of 6", fields.len())));
        };
        let count = |text: &str, what: &str| {
            text.parse::<u32>().map_err(|_| wrong(format!("{what} is '{text}', not a whole number")))
        };
        let real = |text: &str, what: &str| match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(wrong(format!("{what} is '{text}', not a finite number"))),
        };
        let (instant, node) = (count(instant, "instant")? as usize, count(node, "node")?);
        let (x, y, ux, uy) = (real(x, "x_mm")?, real(y, "y_mm")?, real(ux, "ux_mm")?, real(uy, "uy_mm")?);
        if instant == 0 || instant > 1_000_000 {
            return Err(wrong(format!("instant is {instant}; instants are counted from 1")));
        }
        values.resize_with(values.len().max(instant), HashMap::new);
        if values[instant - 1].insert(node, [ux, uy]).is_some() {
            return Err(wrong(format!("node {node} stands twice in instant {instant}")));
        }
        place.entry(node).or_insert_with(|| {
            nodes.push(node);
            positions.push([x, y]);
            nodes.len() - 1
        });
    }
    if values.is_empty() {
        return Err(JointFileError::Empty { path: owned() });
    }
    let last = values.len();
    if let Some(instant) = values.iter().position(HashMap::is_empty) {
        return Err(JointFileError::MissingInstant { path: owned(), instant: instant + 1, last });
    }
    let mut instants = Vec::with_capacity(last);
    for (k, given) in values.iter().enumerate() {
        if let Some(&node) = nodes.iter().find(|node| !given.contains_key(node)) {
            let other = 1 + values.iter().position(|given| given.contains_key(&node)).unwrap_or(0);
            return Err(JointFileError::MissingNode { path: owned(), instant: k + 1, node, other });
        }
        instants.push(nodes.iter().map(|node| given[node]).collect());
    }
    Ok(BoundaryTable { nodes, positions, instants })
}

/// Writes a table: `#` lines with `notes`, the header `columns`, and the rows; numbers with 17 digits.
///
/// # Errors
/// Those of `out`.
pub fn write_table<W: Write>(
    mut out: W,
    notes: &[String],
    columns: &[String],
    rows: impl Iterator<Item = (Vec<u64>, Vec<f64>)>,
) -> io::Result<()> {
    for note in notes.iter().flat_map(|note| note.lines()) {
        writeln!(out, "# {note}")?;
    }
    writeln!(out, "{}", columns.join(","))?;
    for (numbers, values) in rows {
        let mut first = true;
        for number in numbers {
            write!(out, "{}{number}", if first { "" } else { "," })?;
            first = false;
        }
        for value in values {
            write!(out, ",{value:.16e}")?;
        }
        writeln!(out)?;
    }
    out.flush()
}
