//! Displacements by the numbers of nodes, as finite-element programs list them.

use super::FieldError;
use super::layout::LengthUnit;
use super::table::{PREAMBLE, SEPARATORS, bare, name_and_unit};
use crate::text::{decoded, read_regular};
use std::path::Path;

/// Names of the columns, in small letters.
const NODE: [&str; 5] = ["node", "node_label", "nodelabel", "node_id", "id"];
const U: [&str; 5] = ["ux", "u1", "u.u1", "u-u1", "u_x"];
const V: [&str; 5] = ["uy", "u2", "u.u2", "u-u2", "u_y"];

/// Displacements of nodes by their numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeTable {
    /// Number, and displacement along x and y.
    pub rows: Vec<(u64, [f64; 2])>,
    /// Their unit where the table names it.
    pub unit: Option<LengthUnit>,
}

/// Reads a table with the columns node, ux, uy (or `U.U1` and `U.U2`, as reports of Abaqus have them). Lines that do not
/// begin with the number of a node are no rows.
///
/// # Errors
/// A file that cannot be read, no such columns, a displacement that is no number.
pub fn read_node_table(path: &Path) -> Result<NodeTable, FieldError> {
    let bytes = read_regular(path).map_err(|error| FieldError::Io(path.to_owned(), error))?;
    let (text, _) = decoded(&bytes).map_err(|line| FieldError::NoText { path: path.to_owned(), line })?;
    let lines: Vec<&str> = text.lines().collect();
    let header = lines.iter().enumerate().take(PREAMBLE).find_map(|(line, text)| {
        SEPARATORS.into_iter().find_map(|separator| {
            let cells = separator.cells(bare(text)).into_iter();
            let columns: Vec<(String, Option<LengthUnit>)> = cells.map(name_and_unit).collect();
            let at = |names: &[&str]| columns.iter().position(|(name, _)| names.contains(&without_unit(name)));
            let places = [at(&NODE)?, at(&U)?, at(&V)?];
            let unit = columns.get(places[1]).and_then(|(_, unit)| *unit);
            Some((line, separator, places, unit))
        })
    });
    let Some((line, separator, places, unit)) = header else {
        return Err(FieldError::Missing {
            path: path.to_owned(),
            layout: "of nodes",
            wanted: "node, ux, uy".to_owned(),
            columns: Vec::new(),
        });
    };
    let mut rows = Vec::new();
    for (line, text) in lines.iter().enumerate().skip(line + 1) {
        let cells = separator.cells(text);
        let cell = |k: usize| places.get(k).and_then(|&at| cells.get(at)).copied().unwrap_or_default();
        let Ok(node) = cell(0).parse::<u64>() else { continue };
        let number = |k: usize, column: &str| {
            let wrong = || FieldError::Number {
                path: path.to_owned(),
                line: line + 1,
                column: column.to_owned(),
                text: cell(k).to_owned(),
            };
            cell(k).parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong)
        };
        rows.push((node, [number(1, "ux")?, number(2, "uy")?]));
    }
    Ok(NodeTable { rows, unit })
}

/// A name without the unit at its end, as in `ux_mm`.
fn without_unit(name: &str) -> &str {
    name.strip_suffix("_mm").or(name.strip_suffix("_um")).unwrap_or(name)
}
