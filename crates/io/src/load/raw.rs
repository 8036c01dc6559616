//! A load file as it stands: names, units, cells.

use super::error::LoadError;
use super::remarks;
use super::units::{Named, is_unit};
use crate::remark::Remark;
use ::csv::{ReaderBuilder, StringRecord};
use std::io;
use std::path::{Path, PathBuf};

/// Which columns of a file are taken.
#[derive(Clone, Copy)]
pub(super) enum Wanted<'a> {
    /// All; each has a unit.
    All,
    /// All; the one called so may have no unit, since it may hold clock times.
    WithTime(&'a str),
    /// Those called so alone, which may have no unit.
    Only(&'a [&'a str]),
}

/// The cells of a load file under the names of their columns.
#[derive(Default)]
pub(super) struct RawTable {
    path: PathBuf,
    /// Names with units, without that of the frame.
    pub columns: Vec<String>,
    /// Names as the file has them, in the same order.
    pub given: Vec<String>,
    factors: Vec<f64>,
    /// Where they stand in a row.
    places: Vec<usize>,
    frame_at: Option<usize>,
    rows: Vec<StringRecord>,
    decimal_comma: bool,
    /// Units that are converted.
    pub remarks: Vec<Remark>,
}

impl RawTable {
    /// Takes the `wanted` columns of `text` apart; `path` stands in messages.
    pub fn parse(text: &str, path: &Path, wanted: Wanted<'_>) -> Result<Self, LoadError> {
        let text = text.trim_start_matches('\u{feff}');
        let path = path.to_owned();
        let first = text.lines().find(|line| !line.trim().is_empty() && !line.starts_with('#'));
        let Some(first) = first else { return Err(LoadError::Empty(path, "header")) };
        let separator = [b';', b'\t', b','].into_iter().find(|&s| first.as_bytes().contains(&s)).unwrap_or(b',');
        let mut reader = ReaderBuilder::new()
            .delimiter(separator)
            .comment(Some(b'#'))
            .has_headers(false)
            .flexible(true)
            .trim(::csv::Trim::All)
            .from_reader(text.as_bytes());
        // `text` is UTF-8 and rows may have any length: the parser has nothing left to refuse.
        let refused = |error: ::csv::Error| LoadError::Io(path.clone(), io::Error::other(error));
        // A row of nothing but separators is an empty line of a spreadsheet.
        let is_row = |record: &StringRecord| record.iter().any(|cell| !cell.is_empty());
        let all = reader.records().collect::<Result<Vec<_>, _>>().map_err(refused)?;
        let all: Vec<StringRecord> = all.into_iter().filter(is_row).collect();
        let mut records = all.iter().cloned().peekable();
        let Some(header) = records.next() else { return Err(LoadError::Empty(path, "header")) };
        // Machines end lines with a separator.
        let n_columns =
            header.iter().collect::<Vec<_>>().iter().rposition(|cell| !cell.is_empty()).map_or(0, |at| at + 1);
        let lacks_unit = |cell: &str| !is_frame(cell) && Named::new(cell, None).unit.is_none();
        let are_units = |row: &StringRecord| {
            row.iter().all(|cell| !cell.starts_with(|c: char| c.is_ascii_digit()) && number(cell, true).is_none())
        };
        // A name such as Axial_Force looks as if it had a unit.
        let is_blank = |cell: &str| ["", "-"].contains(&cell);
        let are_known =
            |row: &StringRecord| row.iter().all(|cell| is_blank(cell) || is_unit(cell)) && !row.iter().all(is_blank);
        let lacks = header.iter().any(lacks_unit);
        let units = records.next_if(|row| are_units(row) && (lacks || are_known(row)));
        let line = line_of(&header);
        let mut table = Self { path, decimal_comma: separator != b',', ..Self::default() };
        let is_empty_below = |at: usize| all.iter().all(|row| row.get(at).is_none_or(str::is_empty));
        let n_columns = if (n_columns..header.len()).all(is_empty_below) { n_columns } else { header.len() };
        for (at, cell) in header.iter().enumerate().take(n_columns) {
            let below = units.as_ref().map(|units| units.get(at).unwrap_or(""));
            table.name(at, cell, below, line, wanted)?;
        }
        if table.columns.is_empty() {
            return Err(LoadError::Empty(table.path, "column of values"));
        }
        for record in records {
            let (found, expected) = (record.len(), n_columns);
            let beyond = record.iter().skip(expected).all(str::is_empty);
            if found < expected || !beyond {
                let decimal_commas = separator == b',' && found == 2 * expected;
                let line = line_of(&record);
                return Err(LoadError::Row { path: table.path, line, found, expected, decimal_commas });
            }
            table.rows.push(record);
        }
        if table.rows.is_empty() {
            return Err(LoadError::Empty(table.path, "row"));
        }
        Ok(table)
    }

    fn name(
        &mut self,
        at: usize,
        cell: &str,
        below: Option<&str>,
        line: u64,
        wanted: Wanted<'_>,
    ) -> Result<(), LoadError> {
        let twice = |column: String| LoadError::ColumnName(self.path.clone(), line, column);
        if is_frame(cell) {
            return match self.frame_at.replace(at) {
                None => Ok(()),
                Some(_) => Err(twice("frame".to_owned())),
            };
        }
        let named = Named::new(cell, below);
        let name = named.name();
        let is_time = match wanted {
            Wanted::All => false,
            Wanted::WithTime(time) => is_called(time, &name, cell),
            Wanted::Only(names) if names.iter().any(|time| is_called(time, &name, cell)) => true,
            Wanted::Only(_) => return Ok(()),
        };
        if cell.is_empty() || self.columns.contains(&name) {
            return Err(twice(name));
        }
        if (named.unit.is_none() && !is_time) || named.base.is_empty() {
            return Err(LoadError::NoUnit { path: self.path.clone(), line, column: name });
        }
        if named.factor != 1.0 {
            self.remarks.push(remarks::unit(&name, &named.given, named.factor));
        }
        self.columns.push(name);
        self.given.push(cell.to_owned());
        self.factors.push(named.factor);
        self.places.push(at);
        Ok(())
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn n_rows(&self) -> usize {
        self.rows.len()
    }

    #[expect(clippy::indexing_slicing, reason = "rows are counted by their callers, from n_rows")]
    pub fn line(&self, row: usize) -> u64 {
        line_of(&self.rows[row])
    }

    /// A cell as it stands.
    #[expect(clippy::indexing_slicing, reason = "no row is shorter than the columns, which `parse` has compared")]
    pub fn cell(&self, row: usize, column: usize) -> &str {
        &self.rows[row][self.places[column]]
    }

    /// The column that is called so, with or without its unit.
    pub fn called(&self, name: &str) -> Option<usize> {
        self.columns.iter().zip(&self.given).position(|(column, given)| is_called(name, column, given))
    }

    /// A number of the table, in the unit of its column's name; `None` where the cell is empty.
    #[expect(clippy::indexing_slicing, reason = "columns are counted by their callers")]
    pub fn value(&self, row: usize, column: usize) -> Result<Option<f64>, LoadError> {
        let cell = self.cell(row, column);
        if cell.is_empty() {
            return Ok(None);
        }
        // In a quoted cell between commas a comma can only be decimal.
        match number(cell, self.decimal_comma || cell.contains(',')) {
            Some(value) => Ok(Some(value * self.factors[column])),
            None => Err(LoadError::Number {
                path: self.path.clone(),
                line: self.line(row),
                column: self.columns[column].clone(),
                text: cell.to_owned(),
            }),
        }
    }

    /// Every number, row by row.
    pub fn values(&self) -> Result<Vec<Vec<Option<f64>>>, LoadError> {
        let row = |row: usize| (0..self.columns.len()).map(|column| self.value(row, column)).collect();
        (0..self.n_rows()).map(row).collect()
    }

    /// The number of the frame of each row, 0 for the reference: from the column `frame`, or in order.
    #[expect(
        clippy::indexing_slicing,
        reason = "the column was found in the header, and frames beyond the last are refused"
    )]
    pub fn frames(&self, n_frames: usize) -> Result<Vec<usize>, LoadError> {
        let Some(at) = self.frame_at else {
            // With the reference first its row is frame 0.
            let first = match self.n_rows() {
                n if n == n_frames => 1,
                n if n == n_frames + 1 => 0,
                n_rows => return Err(LoadError::Length { path: self.path.clone(), n_rows, n_frames }),
            };
            return Ok((first..first + self.n_rows()).collect());
        };
        let mut taken = vec![false; n_frames + 1];
        let frame = |(row, record): (usize, &StringRecord)| {
            let (path, line) = (self.path.clone(), self.line(row));
            match record[at].parse::<usize>().ok().filter(|&frame| frame <= n_frames) {
                None => Err(LoadError::Frame { path, line, text: record[at].to_owned(), n_frames }),
                Some(frame) if std::mem::replace(&mut taken[frame], true) => {
                    Err(LoadError::Twice { path, line, frame })
                }
                Some(frame) => Ok(frame),
            }
        };
        self.rows.iter().enumerate().map(frame).collect()
    }
}

fn line_of(record: &StringRecord) -> u64 {
    record.position().map_or(0, |position| position.line())
}

fn is_frame(cell: &str) -> bool {
    cell.eq_ignore_ascii_case("frame")
}

/// Whether `name` is the column `full` (with its unit), `given` in the file.
fn is_called(name: &str, full: &str, given: &str) -> bool {
    let same = |other: &str| name.trim().replace(' ', "_").eq_ignore_ascii_case(&other.replace(' ', "_"));
    let base = Named::new(given, None).base;
    same(full) || same(given) || same(&base)
}

/// A finite number.
fn number(cell: &str, decimal_comma: bool) -> Option<f64> {
    let plain = if decimal_comma { cell.replacen(',', ".", 1) } else { cell.to_owned() };
    plain.parse().ok().filter(|value: &f64| value.is_finite())
}
