//! The table of the displacements of a joint's border.

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
///
/// # Errors
/// See [`JointFileError`].
pub fn read_boundary(path: &Path) -> Result<BoundaryTable, JointFileError> {
    parse_boundary(&bytes_of(path)?, path)
}

/// The table with the content `bytes`; `path` stands in messages. See [`read_boundary`].
///
/// # Errors
/// Those of [`read_boundary`], but for a file that cannot be read.
pub fn parse_boundary(bytes: &[u8], path: &Path) -> Result<BoundaryTable, JointFileError> {
    let text = String::from_utf8_lossy(bytes);
    let owned = || path.to_owned();
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let Some((_, header)) = lines.next() else { return Err(JointFileError::Empty { path: owned() }) };
    if header.split(',').map(str::trim).ne(HEADER.split(',')) {
        return Err(JointFileError::Header { path: owned(), needed: HEADER, found: header.trim().to_owned() });
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
    Ok(BoundaryTable { path: owned(), nodes, positions, instants })
}
