//! The table of the displacements of a joint's border.

use super::table::{parse_row, split_table};
use super::{JointFileError, bytes_of};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The table of prescribed displacements.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryTable {
    /// The file.
    pub path: PathBuf,
    /// Number of each node.
    pub nodes: Vec<u32>,
    /// Position of each node as the table gives it, mm.
    pub positions: Vec<[f64; 2]>,
    /// Displacements of the nodes at each instant, mm.
    pub instants: Vec<Vec<[f64; 2]>>,
}

const HEADER: &str = "instant,node,x_mm,y_mm,ux_mm,uy_mm";

/// Reads `instant,node,x_mm,y_mm,ux_mm,uy_mm`; lines that begin with `#` are comments. Rows may come in any order.
pub fn read_boundary(path: &Path) -> Result<BoundaryTable, JointFileError> {
    parse_boundary(&bytes_of(path)?, path)
}

/// The table with the content `bytes`; `path` stands in messages. See [`read_boundary`].
pub fn parse_boundary(bytes: &[u8], path: &Path) -> Result<BoundaryTable, JointFileError> {
    let text = String::from_utf8_lossy(bytes);
    let wrong = |what: String| JointFileError::file(path, what);
    let (header, rows) = split_table(&text, path)?;
    if header.split(',').map(str::trim).ne(HEADER.split(',')) {
        return Err(wrong(format!("the header must be {HEADER}, not '{}'", header.trim())));
    }
    let (mut nodes, mut positions): (Vec<u32>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
    let mut place: HashMap<u32, usize> = HashMap::new();
    let mut values: Vec<HashMap<u32, [f64; 2]>> = Vec::new();
    for (line, row) in rows {
        let wrong = |what: String| JointFileError::Row { path: path.to_owned(), line, what };
        let (instant, node, [x, y, ux, uy]) = parse_row(row, ["x_mm", "y_mm", "ux_mm", "uy_mm"]).map_err(wrong)?;
        values.resize_with(values.len().max(instant), HashMap::new);
        if values.get_mut(instant - 1).and_then(|instant| instant.insert(node, [ux, uy])).is_some() {
            return Err(wrong(format!("node {node} stands twice in instant {instant}")));
        }
        place.entry(node).or_insert_with(|| {
            nodes.push(node);
            positions.push([x, y]);
            nodes.len() - 1
        });
    }
    if values.is_empty() {
        return Err(wrong("the table has no row".to_owned()));
    }
    let last = values.len();
    if let Some(instant) = values.iter().position(HashMap::is_empty) {
        let instant = instant + 1;
        return Err(wrong(format!(
            "there is no instant {instant}, but instant {last}; instants must be numbered 1, 2, 3, ... without a gap"
        )));
    }
    let mut instants = Vec::with_capacity(last);
    for (k, given) in values.iter().enumerate() {
        if let Some(&node) = nodes.iter().find(|node| !given.contains_key(node)) {
            let other = 1 + values.iter().position(|given| given.contains_key(&node)).unwrap_or(0);
            return Err(wrong(format!(
                "instant {} has no row for node {node}, which instant {other} has; every instant needs the same nodes",
                k + 1
            )));
        }
        instants.push(nodes.iter().map(|node| given[node]).collect());
    }
    Ok(BoundaryTable { path: path.to_owned(), nodes, positions, instants })
}
