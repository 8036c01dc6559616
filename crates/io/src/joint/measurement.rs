//! The table of the displacements that parameters are fitted to.

use super::table::{parse_row, split_table};
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
pub fn read_measurement(path: &Path, mm_per_px: Option<f64>) -> Result<MeasurementTable, JointFileError> {
    parse_measurement(&bytes_of(path)?, path, mm_per_px)
}

/// The table with the content `bytes`; `path` stands in messages. See [`read_measurement`].
pub fn parse_measurement(
    bytes: &[u8],
    path: &Path,
    mm_per_px: Option<f64>,
) -> Result<MeasurementTable, JointFileError> {
    if let Some(value) = mm_per_px.filter(|value| !(value.is_finite() && *value > 0.0)) {
        let what = format!("pixel_size_mm = {value}: it must be a finite number above zero");
        return Err(JointFileError::section("measurement", what));
    }
    let text = String::from_utf8_lossy(bytes);
    let wrong = |what: String| JointFileError::file(path, what);
    let (header, rows) = split_table(&text, path)?;
    let is = |wanted: &str| header.split(',').map(str::trim).eq(wanted.split(','));
    let factor = match mm_per_px {
        _ if is(HEADER) => 1.0,
        Some(scale) if is(HEADER_PX) => scale,
        None if is(HEADER_PX) => {
            let remedy = "give ux_mm,uy_mm with y up, or [measurement] pixel_size_mm";
            return Err(wrong(format!("the displacements are in pixels; {remedy}")));
        }
        _ => return Err(wrong(format!("the header must be {HEADER}, not '{}'", header.trim()))),
    };
    let mut instants: BTreeMap<usize, BTreeMap<u32, [f64; 2]>> = BTreeMap::new();
    for (line, row) in rows {
        let wrong = |what: String| JointFileError::Row { path: path.to_owned(), line, what };
        let (instant, node, u) = parse_row(row, ["ux", "uy"]).map_err(wrong)?;
        if instants.entry(instant).or_default().insert(node, u.map(|u| factor * u)).is_some() {
            return Err(wrong(format!("node {node} stands twice in instant {instant}")));
        }
    }
    if instants.is_empty() {
        return Err(wrong("the table has no row".to_owned()));
    }
    Ok(MeasurementTable { path: path.to_owned(), instants })
}
