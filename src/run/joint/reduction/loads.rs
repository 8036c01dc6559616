//! Loads and displacements of the machine, for a reduced test.

use crate::field::Value;
use crate::io::case::CaseReduction;
use crate::io::load::{LoadColumn, LoadTable};
use crate::run::words::{Result, RunError};
use std::path::Path;

pub(super) fn wrong(what: &str) -> RunError {
    format!("[reduction] {what}").into()
}

/// The column of the load, and what makes its largest magnitude positive.
pub(super) fn force<'a>(asked: &CaseReduction, loads: &'a LoadTable, path: &Path) -> Result<(&'a LoadColumn, f64)> {
    let column = loads.force(asked.force.as_deref(), path)?;
    let largest = column.values.iter().flatten().copied().max_by(|a, b| a.abs().total_cmp(&b.abs()));
    match largest {
        None | Some(0.0) => Err(format!("{}: column {} has no load", path.display(), column.name).into()),
        Some(largest) => Ok((column, largest.signum())),
    }
}

pub(super) fn exact(value: f64) -> Value {
    Value { value, sigma: 0.0 }
}

/// The displacement of the machine at the instants of `loads_n` (frame, load), less what it gives way; it grows towards
/// the largest load. `None` where none is asked for.
pub(super) fn of_machine(
    asked: &CaseReduction,
    loads: &LoadTable,
    loads_n: &[(usize, f64)],
) -> Result<Option<Vec<Option<f64>>>> {
    let Some(name) = &asked.displacement else { return Ok(None) };
    let called = |column: &&LoadColumn| column.name == *name || column.name_and_unit().0 == name;
    let column = loads.columns.iter().find(called).ok_or_else(|| {
        let there: Vec<&str> = loads.columns.iter().map(|column| column.name.as_str()).collect();
        format!("[reduction] displacement = \"{name}\": there is no such column; there are {}", there.join(", "))
    })?;
    if column.name_and_unit().1 != "mm" {
        return Err(format!("[reduction] displacement: {} is no length", column.name).into());
    }
    let compliance = asked.machine_compliance_mm_per_n.unwrap_or(0.0);
    let largest = loads_n.iter().max_by(|a, b| a.1.total_cmp(&b.1));
    let ends =
        loads_n.iter().find_map(|(frame, _)| column.at(*frame)).zip(largest.and_then(|(frame, _)| column.at(*frame)));
    let sign = if ends.is_some_and(|(first, there)| there < first) { -1.0 } else { 1.0 };
    let at = |(frame, load_n): &(usize, f64)| column.at(*frame).map(|u| sign * u - compliance * load_n);
    Ok(Some(loads_n.iter().map(at).collect()))
}
