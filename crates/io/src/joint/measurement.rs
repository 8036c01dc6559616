//! The table of the displacements that parameters are fitted to.

use super::{JointFileError, bytes_of};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const HEADER: &str = "instant,node,ux_mm,uy_mm";
const HEADER_PX: &str = "instant,node,ux_px,uy_px";

/// Measured displacements as a table gives them.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasurementTable {
    /// The file.
    pub path: PathBuf,
    /// Of each instant (from 1) that the table has: the displacement of its nodes, mm, y up.
    pub instants: BTreeMap<usize, BTreeMap<u32, [f64; 2]>>,
}

/// Reads `instant,node,ux_mm,uy_mm`, or `ux_px,uy_px` (y up) with the scale `mm_per_px`; lines that begin with `#` are
/// comments. Rows may come in any order, instants may be missing.
///
/// # Errors
/// See [`JointFileError`].
pub fn read_measurement(path: &Path, mm_per_px: Option<f64>) -> Result<MeasurementTable, JointFileError> {
    parse_measurement(&bytes_of(path)?, path, mm_per_px)
}

/// The table with the content `bytes`; `path` stands in messages. See [`read_measurement`].
///
/// # Errors
/// Those of [`read_measurement`], but for a file that cannot be read.
pub fn parse_measurement(
    bytes: &[u8],
    path: &Path,
    mm_per_px: Option<f64>,
) -> Result<MeasurementTable, JointFileError> {
    if let Some(value) = mm_per_px.filter(|value| !(value.is_finite() && *value > 0.0)) {
        return Err(JointFileError::BadScale { value });
    }
    let text = String::from_utf8_lossy(bytes);
    let owned = || path.to_owned();
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let Some((_, header)) = lines.next() else { return Err(JointFileError::Empty { path: owned() }) };
    let is = |wanted: &str| header.split(',').map(str::trim).eq(wanted.split(','));
    let factor = match mm_per_px {
        _ if is(HEADER) => 1.0,
        Some(scale) if is(HEADER_PX) => scale,
        None if is(HEADER_PX) => return Err(JointFileError::NoScale { path: owned() }),
        _ => {
            let found = header.trim().to_owned();
            return Err(JointFileError::Header { path: owned(), needed: HEADER, found });
        }
    };
    let mut instants: BTreeMap<usize, BTreeMap<u32, [f64; 2]>> = BTreeMap::new();
    for (line, row) in lines {
        let wrong = |what: String| JointFileError::Row { path: owned(), line, what };
        let fields: Vec<&str> = row.split(',').map(str::trim).collect();
        let &[instant, node, ux, uy] = fields.as_slice() else {
            return Err(wrong(format!("{} values instead of 4", fields.len())));
        };
        let count = |text: &str, what: &str| {
            text.parse::<u32>().map_err(|_| wrong(format!("{what} is '{text}', not a whole number")))
        };
        let real = |text: &str, what: &str| match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(factor * value),
            _ => Err(wrong(format!("{what} is '{text}', not a finite number"))),
        };
        let (instant, node) = (count(instant, "instant")? as usize, count(node, "node")?);
        let (ux, uy) = (real(ux, "ux")?, real(uy, "uy")?);
        if instant == 0 || instant > 1_000_000 {
            return Err(wrong(format!("instant is {instant}; instants are counted from 1")));
        }
        if instants.entry(instant).or_default().insert(node, [ux, uy]).is_some() {
            return Err(wrong(format!("node {node} stands twice in instant {instant}")));
        }
    }
    if instants.is_empty() {
        return Err(JointFileError::Empty { path: owned() });
    }
    Ok(MeasurementTable { path: owned(), instants })
}
