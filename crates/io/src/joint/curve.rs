//! Uniaxial curves of materials.

use super::{JointFileError, read_table};
use crate::case::{CaseMaterial, CaseSubstrate};
use std::path::Path;
const COLUMNS: [&str; 2] = ["strain", "stress_MPa"];

/// Puts the curves of files that `substrate` names, relative to `base`, into it in place of their names.
///
/// # Errors
/// A file that cannot be read, or without the columns; a curve that is given twice.
pub fn read_curves(substrate: &mut CaseSubstrate, base: &Path) -> Result<(), JointFileError> {
    let CaseSubstrate { common, groups } = substrate;
    for material in std::iter::once(common).chain(groups.values_mut()) {
        let CaseMaterial { file, curve, .. } = material;
        let Some(name) = file.take() else { continue };
        let path = base.join(&name);
        if curve.is_some() {
            return Err(JointFileError::section("substrate", "file and curve are both given; take one away"));
        }
        let (columns, rows) = read_table(&path)?;
        let place = |wanted: &str| columns.iter().position(|column| column == wanted);
        let (Some(strain), Some(stress)) = (place(COLUMNS[0]), place(COLUMNS[1])) else {
            let what = format!("the header must be strain,stress_MPa, not '{}'", columns.join(","));
            return Err(JointFileError::File(path, what));
        };
        *curve = Some(rows.iter().filter_map(|row| Some([*row.get(strain)?, *row.get(stress)?])).collect());
    }
    Ok(())
}
