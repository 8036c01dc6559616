//! A load file as it stands: names, units, cells.

use super::clock::clock_time;
use super::decimals::{Evidence, agreed, evidence, number};
use super::error::LoadError;
use super::remarks;
use super::source::Source;
use super::units::{Named, is_unit};
use crate::case::Decimal;
use crate::remark::Remark;
use ::csv::{ReaderBuilder, StringRecord};
use std::borrow::Cow;
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
    /// Whether columns are separated by commas.
    is_comma: bool,
    /// The decimal mark that is asked for.
    decimal: Option<Decimal>,
    /// That of each column, where it is known.
    decimals: Vec<Option<Decimal>>,
    /// Units that are converted.
    pub remarks: Vec<Remark>,
}

impl RawTable {
    /// Takes the `wanted` columns of a file apart; `path` stands in messages.
    pub fn parse(source: &Source, path: &Path, wanted: Wanted<'_>) -> Result<Self, LoadError> {
        let path = path.to_owned();
        let text = source.text.trim_start_matches('\u{feff}');
        let (separator, text) = separator_of(text);
        let Some(separator) = separator else { return Err(LoadError::Empty(path, "header")) };
        let all = records(&text, separator).map_err(|error| LoadError::Io(path.clone(), io::Error::other(error)))?;
        let begin = header_at(&all);
        let mut records = all.iter().skip(begin).cloned().peekable();
        let Some(header) = records.next() else { return Err(LoadError::Empty(path, "header")) };
        // Machines end lines with a separator.
        let n_columns = width(&header);
        let units = records.next_if(|row| are_units_below(&header, row));
        let line = line_of(&header);
        let mut table = Self { path, is_comma: separator == b',', decimal: source.decimal, ..Self::default() };
        table.remarks.clone_from(&source.remarks);
        if begin > 0 {
            table.remarks.push(remarks::preamble(line - 1));
        }
        let below = all.get(begin..).unwrap_or_default();
        let is_empty_below = |at: usize| below.iter().all(|row| row.get(at).is_none_or(str::is_empty));
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
        table.find_decimals();
        Ok(table)
    }

    fn cells(&self, column: usize) -> impl Iterator<Item = &str> {
        (0..self.n_rows()).map(move |row| self.cell(row, column))
    }

    /// The decimal marks that the numbers of a column show.
    fn shown(&self, column: usize) -> impl Iterator<Item = Decimal> {
        self.cells(column).filter_map(|cell| match evidence(cell) {
            Evidence::Is(mark) => Some(mark),
            _ => None,
        })
    }

    /// Which mark stands before the decimals of each column: what its own numbers show, else those of the file.
    fn find_decimals(&mut self) {
        let columns = 0..self.columns.len();
        let of_file = agreed(columns.clone().flat_map(|column| self.shown(column)));
        self.decimals = columns.clone().map(|column| self.decimal.or(agreed(self.shown(column))).or(of_file)).collect();
        let in_thousands = |column: usize| {
            let decimal = (*self.decimals.get(column)?)?;
            let is_other = |cell: &&str| matches!(evidence(cell), Evidence::Either(mark) if mark != decimal);
            let cell = self.cells(column).find(is_other)?;
            Some(remarks::thousands(self.columns.get(column)?, cell, number(cell, decimal)?))
        };
        let said: Vec<Remark> = columns.filter_map(in_thousands).collect();
        self.remarks.extend(said);
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
        let (path, line, name) = (self.path.clone(), self.line(row), self.columns[column].clone());
        let value = match (self.decimals[column], evidence(cell)) {
            (Some(decimal), _) => number(cell, decimal),
            // Where commas separate columns a point is before decimals.
            (None, Evidence::Either(Decimal::Point)) if self.is_comma => number(cell, Decimal::Point),
            // Two numbers of the column contradict each other, or none says anything.
            (None, Evidence::Is(_) | Evidence::Either(_)) => {
                return Err(LoadError::Ambiguous { path, line, column: name, text: cell.to_owned() });
            }
            (None, Evidence::None) => number(cell, Decimal::Point),
        };
        match value {
            Some(value) => Ok(Some(value * self.factors[column])),
            None => Err(LoadError::Number { path, line, column: name, text: cell.to_owned() }),
        }
    }

    /// Every number, row by row.
    pub fn values(&self) -> Result<Vec<Vec<Option<f64>>>, LoadError> {
        let row = |row: usize| (0..self.columns.len()).map(|column| self.value(row, column)).collect();
        (0..self.n_rows()).map(row).collect()
    }

    /// The largest number in the column `frame`, or that of the rows.
    pub fn last_frame(&self) -> usize {
        let of = |record: &StringRecord| whole(record.get(self.frame_at?)?);
        // A number that no series reaches is refused as that of a row.
        self.rows.iter().filter_map(of).max().filter(|last| *last <= 10_000_000).unwrap_or(self.n_rows())
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
            match whole(&record[at]).filter(|&frame| frame <= n_frames) {
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

/// A whole number; tables of programs for numbers write `1.0`.
fn whole(cell: &str) -> Option<usize> {
    let bare =
        cell.split_once('.').filter(|(_, zeros)| zeros.bytes().all(|c| c == b'0')).map_or(cell, |(whole, _)| whole);
    bare.parse().ok()
}

/// What separates the columns of `text`, and the text without a line that says so (`sep=;`, of spreadsheets): the
/// first of `;`, tab and `,` in half of the lines. Lines before the header may have none.
fn separator_of(text: &str) -> (Option<u8>, Cow<'_, str>) {
    let (first, rest) = text.split_once('\n').unwrap_or((text, ""));
    let said = first.trim_end_matches('\r').strip_prefix("sep=").or_else(|| first.trim_end().strip_prefix("SEP="));
    if let Some(&[separator]) = said.map(str::as_bytes) {
        // An empty line in its place: lines are counted.
        return (Some(separator), Cow::Owned(format!("\n{rest}")));
    }
    let lines = || text.lines().filter(|line| !line.trim().is_empty() && !line.starts_with('#'));
    let n = lines().count();
    let among = |&separator: &u8| 2 * lines().filter(|line| line.as_bytes().contains(&separator)).count() >= n;
    ((n > 0).then(|| [b';', b'\t', b','].into_iter().find(among).unwrap_or(b',')), Cow::Borrowed(text))
}

/// The rows of `text` in which something stands.
fn records(text: &str, separator: u8) -> Result<Vec<StringRecord>, ::csv::Error> {
    let mut reader = ReaderBuilder::new()
        .delimiter(separator)
        .comment(Some(b'#'))
        .has_headers(false)
        .flexible(true)
        .trim(::csv::Trim::All)
        .from_reader(text.as_bytes());
    // A row of nothing but separators is an empty line of a spreadsheet.
    let is_row = |record: &StringRecord| record.iter().any(|cell| !cell.is_empty());
    let all = reader.records().collect::<Result<Vec<_>, _>>()?;
    Ok(all.into_iter().filter(is_row).collect())
}

/// Columns of a row up to the last in which something stands.
fn width(row: &StringRecord) -> usize {
    row.iter().collect::<Vec<_>>().iter().rposition(|cell| !cell.is_empty()).map_or(0, |at| at + 1)
}

/// Whether `row`, below the names of `header`, holds their units.
fn are_units_below(header: &StringRecord, row: &StringRecord) -> bool {
    let lacks_unit = |cell: &str| !is_frame(cell) && Named::new(cell, None).unit.is_none();
    let are_units = row
        .iter()
        .all(|cell| !cell.starts_with(|c: char| c.is_ascii_digit()) && number(cell, Decimal::Comma).is_none());
    // A name such as Axial_Force looks as if it had a unit.
    let is_blank = |cell: &str| ["", "-"].contains(&cell);
    let are_known = row.iter().all(|cell| is_blank(cell) || is_unit(cell)) && !row.iter().all(is_blank);
    are_units && (header.iter().any(lacks_unit) || are_known)
}

fn has_name_and_unit(cell: &str) -> bool {
    let named = Named::new(cell, None);
    named.unit.is_some() && !named.base.is_empty()
}

/// The place of the header among the rows: the first of those with names of which the rows below it, units or not, are
/// numbers. The first row of all where there is none such, or where it has units itself.
fn header_at(rows: &[StringRecord]) -> usize {
    let is_value = |cell: &str| {
        cell.is_empty()
            || evidence(cell) != Evidence::None
            || number(cell, Decimal::Point).is_some()
            || clock_time(cell).is_some()
    };
    let is_text = |row: &StringRecord| !row.iter().any(|cell| !cell.is_empty() && is_value(cell));
    let has_units = |row: &StringRecord| {
        let is_named = |cell: &str| is_frame(cell) || has_name_and_unit(cell);
        row.iter().take(width(row)).all(is_named)
    };
    let below_is_data = |at: usize, header: &StringRecord| {
        let is_data =
            |row: &&StringRecord| row.iter().all(is_value) && row.len() >= width(header) && width(row) <= header.len();
        let below = |skip: usize| rows.get(at + skip).filter(is_data).is_some();
        // A line of names with units is a header itself, whatever stands above it.
        let is_units = |row: &StringRecord| !has_units(row) && are_units_below(header, row);
        below(1) || below(2) && rows.get(at + 1).is_some_and(is_units)
    };
    match rows.first() {
        Some(first) if has_units(first) => 0,
        _ => rows.iter().enumerate().position(|(at, row)| is_text(row) && below_is_data(at, row)).unwrap_or(0),
    }
}
