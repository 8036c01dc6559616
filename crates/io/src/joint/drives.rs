//! Supports and loads of a case, with the columns that they name.

use super::{JointFileError, bytes_of};
use crate::case::{CaseAppliedLoad, CaseHistory, CaseSupport, CaseText};
use std::path::Path;

/// A value over the instants.
#[derive(Debug, Clone, PartialEq)]
pub enum History {
    /// The same at every instant.
    Constant(f64),
    /// One for each instant.
    List(Vec<f64>),
}

/// The sections `[[support]]` and `[[applied_load]]`, with their values.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DrivesInput {
    /// Supports, and their displacements along x and y, mm.
    pub supports: Vec<(CaseSupport, [Option<History>; 2])>,
    /// Loads, and their forces along x and y (N/mm), and their tractions (MPa).
    pub loads: Vec<(CaseAppliedLoad, [Option<History>; 4])>,
}

impl DrivesInput {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.supports.is_empty() && self.loads.is_empty()
    }

    /// The number of instants of the longest list; 1 where all values are constant.
    pub fn n_instants(&self) -> usize {
        let of = |history: &Option<History>| match history {
            Some(History::List(values)) => values.len(),
            _ => 1,
        };
        let all = self.supports.iter().flat_map(|(_, u)| u).chain(self.loads.iter().flat_map(|(_, f)| f));
        all.map(of).max().unwrap_or(1)
    }

    /// Reads the columns that the sections name; `base` is the folder of the case.
    pub(super) fn read(
        supports: &[CaseSupport],
        loads: &[CaseAppliedLoad],
        base: &Path,
        text: &CaseText,
    ) -> Result<Self, JointFileError> {
        let value = |section: &'static str, key: &'static str, given: &Option<CaseHistory>| {
            let in_case = |error| JointFileError::InCase(text.place(section, Some(key)), Box::new(error));
            given.as_ref().map(|given| history(given, key, base).map_err(in_case)).transpose()
        };
        let supports = supports.iter().map(|support| {
            let x = value("support", "u_x_mm", &support.u_x_mm)?;
            Ok((support.clone(), [x, value("support", "u_y_mm", &support.u_y_mm)?]))
        });
        let supports = supports.collect::<Result<_, JointFileError>>()?;
        let loads = loads.iter().map(|load| {
            let of = |key, given| value("applied_load", key, given);
            let forces = [of("F_x_N_per_mm", &load.f_x_n_per_mm)?, of("F_y_N_per_mm", &load.f_y_n_per_mm)?];
            let [x, y] = forces;
            Ok((load.clone(), [x, y, of("T_x_MPa", &load.t_x_mpa)?, of("T_y_MPa", &load.t_y_mpa)?]))
        });
        Ok(Self { supports, loads: loads.collect::<Result<_, JointFileError>>()? })
    }
}

fn history(given: &CaseHistory, key: &'static str, base: &Path) -> Result<History, JointFileError> {
    let wrong = |what: String| JointFileError::Wrong(format!("{key}: {what}"));
    let finite = |values: Vec<f64>| match values.iter().position(|value| !value.is_finite()) {
        Some(at) => Err(wrong(format!("value {} is not finite", at + 1))),
        None if values.is_empty() => Err(wrong("the list is empty; give a value for each instant".to_owned())),
        None => Ok(History::List(values)),
    };
    match given {
        &CaseHistory::Constant(value) if value.is_finite() => Ok(History::Constant(value)),
        CaseHistory::Constant(_) => Err(wrong("the value is not finite".to_owned())),
        CaseHistory::List(values) => finite(values.clone()),
        &CaseHistory::Ramp { to, instants } => match instants {
            1..=1_000_000 => finite((1..=instants).map(|k| to * k as f64 / instants as f64).collect()),
            _ => Err(wrong(format!("instants = {instants}: give a number from 1 to 1000000"))),
        },
        CaseHistory::Column { file, column, factor } => {
            let values = read_column(&base.join(file), column)?;
            finite(values.into_iter().map(|value| factor.unwrap_or(1.0) * value).collect())
        }
    }
}

/// The column `name` of a CSV file with one header line; lines that begin with `#` are comments.
fn read_column(path: &Path, name: &str) -> Result<Vec<f64>, JointFileError> {
    let bytes = bytes_of(path)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut rows =
        csv::ReaderBuilder::new().comment(Some(b'#')).flexible(true).trim(csv::Trim::All).from_reader(text.as_bytes());
    let empty = || JointFileError::file(path, "the table has no row");
    let names = rows.headers().cloned().map_err(|_| empty())?;
    if names.is_empty() {
        return Err(empty());
    }
    let Some(place) = names.iter().position(|other| other == name) else {
        let there = names.iter().collect::<Vec<_>>().join(", ");
        return Err(JointFileError::file(path, format!("there is no column \"{name}\"; it has {there}")));
    };
    let mut values = Vec::new();
    for row in rows.records() {
        let wrong = |line: u64, what: String| JointFileError::Row { path: path.to_owned(), line: line as usize, what };
        let line = |position: Option<&csv::Position>| position.map_or(0, csv::Position::line);
        let row = row.map_err(|error| wrong(line(error.position()), error.to_string()))?;
        if row.iter().all(str::is_empty) {
            continue;
        }
        let cell = row.get(place).unwrap_or("");
        let value = cell.parse::<f64>().ok().filter(|value| value.is_finite());
        let what = || format!("{name} is '{cell}', not a finite number");
        values.push(value.ok_or_else(|| wrong(line(row.position()), what()))?);
    }
    if values.is_empty() { Err(empty()) } else { Ok(values) }
}
