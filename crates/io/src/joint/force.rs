//! What the load cell recorded during the test of a joint.

use super::{BoundaryInput, DrivesInput, JointCase, JointFileError};
use crate::load::read_as_asked;
use crate::remark::Remark;
use std::path::{Path, PathBuf};

/// Forces as the load file gives them, at the instants of the border.
#[derive(Debug, Clone, PartialEq)]
pub struct ForceInput {
    /// The file.
    pub path: PathBuf,
    /// The column that was taken, with its unit.
    pub column: String,
    /// The force at each instant, N; `None` where the file says nothing.
    pub values: Vec<Option<f64>>,
    /// What to know about them: units that were converted, instants without a value.
    pub remarks: Vec<Remark>,
}

/// Reads what `[force]` of `case` names, for the instants of `boundary` (of `drives` where there is none): the rows of
/// a table are its instants, those of a correlation run its frames.
pub fn read_force(
    case: &JointCase,
    boundary: &BoundaryInput,
    drives: &DrivesInput,
) -> Result<Option<ForceInput>, JointFileError> {
    let Some(asked) = &case.force else { return Ok(None) };
    let no_file = || JointFileError::section("force", "names no load file; give file = \"load.csv\"");
    let mut load = asked.load().ok_or_else(no_file)?;
    load.file = case.base.join(&load.file).to_string_lossy().into_owned();
    load.frame_times = load.frame_times.map(|file| case.base.join(file).to_string_lossy().into_owned());
    let n_frames = match boundary {
        BoundaryInput::Table(table) => table.instants.len(),
        BoundaryInput::Run(run) => run.frames.iter().chain(&run.left_out).copied().max().unwrap_or(0),
        BoundaryInput::Drives => drives.n_instants(),
    };
    let table = read_as_asked(&load, n_frames)?;
    let column = table.force(asked.column.as_deref(), Path::new(&load.file))?;
    let values = match boundary {
        BoundaryInput::Table(_) | BoundaryInput::Drives => column.values.clone(),
        BoundaryInput::Run(run) => run.frames.iter().map(|&frame| column.at(frame)).collect(),
    };
    let (column, remarks) = (column.name.clone(), table.remarks.clone());
    Ok(Some(ForceInput { path: load.file.into(), column, values, remarks }))
}
