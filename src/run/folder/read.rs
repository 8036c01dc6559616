//! Files that a run writes whole, and what its steps have written, read back.

use crate::field::Status;
use crate::io::joint::read_table;
use crate::io::store::Store;
use crate::mechanics::Joint;
use crate::run::words::{Result, RunError};
use serde::de::DeserializeOwned;
use std::fs;
use std::path::Path;

pub(crate) fn read_text(path: &Path) -> Result<String> {
    fs::read_to_string(path).map_err(|error| RunError::file(path, "read", error))
}

pub(crate) fn write_file(path: &Path, content: impl AsRef<[u8]>) -> Result<()> {
    fs::write(path, content).map_err(|error| RunError::file(path, "written", error))
}

pub(crate) fn make_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).map_err(|error| RunError::file(path, "made", error))
}

pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = read_text(path)?;
    serde_json::from_str(&text).map_err(|source| RunError::Json { path: path.to_owned(), source })
}

/// The frames of a store that have such a status.
pub(crate) fn frames_that(is_so: impl Fn(Option<Status>) -> bool, store: &Store) -> Result<Vec<usize>> {
    let mut numbers = Vec::new();
    for number in 1..=store.n_frames() {
        numbers.extend(is_so(store.status(number)?).then_some(number));
    }
    Ok(numbers)
}

/// Displacements by instant and node.
pub(crate) type Fields = Vec<Vec<[f64; 2]>>;

/// The computed displacements, from `solution.csv`.
pub(crate) fn fields(folder: &Path, joint: &Joint, n: usize) -> Result<Fields> {
    let n_nodes = joint.model.mesh().nodes().len();
    let n_instants = n.max(joint.boundary.instants().len());
    let path = folder.join("solution.csv");
    let (columns, rows) = read_table(&path)?;
    let at = ["ux_mm", "uy_mm"].map(|name| columns.iter().position(|column| column == name));
    let [Some(x), Some(y)] = at else { return Err(format!("{}: no columns ux_mm and uy_mm", path.display()).into()) };
    let mut fields: Fields = vec![Vec::new(); n_instants];
    for row in rows {
        let cell = |k: usize| row.get(k).copied().unwrap_or(f64::NAN);
        let (instant, node) = (cell(0) as usize, cell(1) as usize);
        if let Some(field) = instant.checked_sub(1).and_then(|k| fields.get_mut(k)).filter(|_| node < n_nodes) {
            field.resize(n_nodes, [0.0; 2]);
            field.iter_mut().skip(node).take(1).for_each(|u| *u = [cell(x), cell(y)]);
        }
    }
    Ok(fields)
}
