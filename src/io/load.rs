//! Load files: what other instruments recorded, one row for each image.

use ::csv::{ReaderBuilder, StringRecord};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A quantity recorded beside the images, such as time or force.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadColumn {
    /// Its name with its unit, as it stands in tables: `load_N`, `time_s`.
    pub name: String,
    /// Its value at each deformed image, from frame 1 on; `None` where the file says nothing.
    pub values: Vec<Option<f64>>,
}

impl LoadColumn {
    /// The name without the unit, and the unit: `load`, `N`. See [`name_and_unit`].
    pub fn name_and_unit(&self) -> (&str, &str) {
        name_and_unit(&self.name)
    }

    /// Its value at a frame, numbered from 1.
    pub fn at(&self, frame: usize) -> Option<f64> {
        self.values.get(frame.checked_sub(1)?).copied().flatten()
    }
}

/// The name of a column of a load file without its unit, and the unit. A quantity without unit has the unit `1`.
///
/// ```
/// use quadrille::io::load::name_and_unit;
/// assert_eq!(name_and_unit("cross_head_mm"), ("cross_head", "mm"));
/// assert_eq!(name_and_unit("frame"), ("frame", "1"));
/// ```
pub fn name_and_unit(column: &str) -> (&str, &str) {
    column.rsplit_once('_').unwrap_or((column, "1"))
}

/// What a load file says about a series.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LoadTable {
    /// The columns, in the order of the file, without the number of the frame.
    pub columns: Vec<LoadColumn>,
}

/// Why a load file cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LoadError {
    /// There is no such file.
    #[error("{}: there is no such load file; check the name and the folder", path.display())]
    NotFound {
        /// The file.
        path: PathBuf,
    },
    /// The file system refuses.
    #[error("{}: the load file cannot be read: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: io::Error,
    },
    /// The file is not UTF-8 text.
    #[error("{}, line {line}: the load file is no UTF-8 text; save it as CSV (UTF-8)", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// Line of the first byte that is none, from 1.
        line: usize,
    },
    /// There is no header, or no row after it.
    #[error("{}: the load file has no {what}; a header such as `time_s,load_N` and a row per image are needed", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// Header, column or row.
        what: &'static str,
    },
    /// A column's name does not end in a unit.
    #[error(
        "{}, line {line}: column '{column}' has no unit; write it as {column}_N or {column} [N], {column}_1 when it has none",
        path.display()
    )]
    NoUnit {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The column.
        column: String,
    },
    /// Two columns have one name, or one has none.
    #[error("{}, line {line}: a column named '{column}' stands there twice or has no name", path.display())]
    ColumnName {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The name.
        column: String,
    },
    /// A row is longer or shorter than the header, or cannot be taken apart.
    #[error("{}, line {line}: {found} values under {expected} columns{}", path.display(), hint(*.decimal_commas))]
    Row {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Values in the row.
        found: usize,
        /// Columns of the header.
        expected: usize,
        /// Whether the row looks as if it had decimal commas between commas.
        decimal_commas: bool,
    },
    /// A cell holds no finite number.
    #[error("{}, line {line}, column '{column}': '{text}' is no finite number", path.display())]
    Number {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The column.
        column: String,
        /// What stands there.
        text: String,
    },
    /// The column `frame` holds no frame of the series.
    #[error("{}, line {line}: frame '{text}' is not among the {n_frames} deformed images (0 is the reference)", path.display())]
    Frame {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// What stands there.
        text: String,
        /// Deformed images of the series.
        n_frames: usize,
    },
    /// A frame has two rows.
    #[error("{}, line {line}: frame {frame} has a row already", path.display())]
    Twice {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The frame.
        frame: usize,
    },
    /// As many rows as there are neither deformed images nor images in all.
    #[error(
        "{}: {n_rows} rows for {n_frames} deformed images; give {n_frames} rows, {} with the reference first, or a column `frame`",
        path.display(), n_frames + 1
    )]
    Length {
        /// The file.
        path: PathBuf,
        /// Rows of the file.
        n_rows: usize,
        /// Deformed images of the series.
        n_frames: usize,
    },
}

fn hint(decimal_commas: bool) -> &'static str {
    if decimal_commas { "; with decimal commas separate columns by ;" } else { "" }
}

/// Reads the load file `path` for a series of `n_frames` deformed images. See [`parse_load`].
///
/// # Errors
/// A file that cannot be read, and those of [`parse_load`].
pub fn read_load(path: &Path, n_frames: usize) -> Result<LoadTable, LoadError> {
    let bytes = std::fs::read(path).map_err(|reason| match reason.kind() {
        ErrorKind::NotFound => LoadError::NotFound { path: path.to_owned() },
        _ => LoadError::Io { path: path.to_owned(), reason },
    })?;
    match std::str::from_utf8(&bytes) {
        Ok(text) => parse_load(text, path, n_frames),
        Err(error) => {
            let line = 1 + bytes[..error.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
            Err(LoadError::NotText { path: path.to_owned(), line })
        }
    }
}

/// The load file with the content `text`; `path` stands in messages.
///
/// A header with a unit at the end of each name (`load_N`, `load [N]` or `load (N)`; `_1` or `[-]` for none), then one
/// row per image. Columns are separated by `,`, `;` or tabs; where they are not separated by `,`, numbers may have a
/// decimal comma. Lines that begin with `#` and empty lines are passed over; an empty cell is a value that is not
/// known. A column `frame` gives the number of the deformed image, from 1 (0, the reference, is passed over), in any
/// order and with gaps; without it, rows are the deformed images in order, or all images with the reference first.
///
/// ```
/// use quadrille::io::load::parse_load;
/// let table = parse_load("time [s];load [kN]\n0;0\n1,5;2,25\n3;4\n", "load.csv".as_ref(), 2)?;
/// assert_eq!(table.columns[1].name, "load_kN");
/// assert_eq!(table.columns[1].values, [Some(2.25), Some(4.0)]);
/// # Ok::<(), quadrille::io::load::LoadError>(())
/// ```
///
/// # Errors
/// No header or row, names without unit, rows of another length, cells that are no number, frames that do not exist
/// or come twice, and another number of rows than images: each names the file and the line.
pub fn parse_load(text: &str, path: &Path, n_frames: usize) -> Result<LoadTable, LoadError> {
    let text = text.trim_start_matches('\u{feff}');
    let path = path.to_owned();
    let first = text.lines().find(|line| !line.trim().is_empty() && !line.starts_with('#'));
    let Some(first) = first else { return Err(LoadError::Empty { path, what: "header" }) };
    let separator = [b';', b'\t', b','].into_iter().find(|&s| first.as_bytes().contains(&s)).unwrap_or(b',');
    let mut reader = ReaderBuilder::new()
        .delimiter(separator)
        .comment(Some(b'#'))
        .has_headers(false)
        .flexible(true)
        .trim(::csv::Trim::All)
        .from_reader(text.as_bytes());
    let mut records = reader.records().filter(|record| {
        // A row of nothing but separators is an empty line of a spreadsheet.
        record.as_ref().map_or(true, |record| record.iter().any(|cell| !cell.is_empty()))
    });
    let line_of = |record: &StringRecord| record.position().map_or(0, |position| position.line());
    // `text` is UTF-8 and rows may have any length: the parser has nothing left to refuse.
    let refused = |error: ::csv::Error| LoadError::Io { path: path.clone(), reason: io::Error::other(error) };
    let Some(header) = records.next().transpose().map_err(refused)? else {
        return Err(LoadError::Empty { path, what: "header" });
    };
    let line = line_of(&header);
    let mut names: Vec<String> = Vec::new();
    for cell in &header {
        let name = if cell.eq_ignore_ascii_case("frame") { "frame".to_owned() } else { with_unit(cell) };
        if cell.is_empty() || names.contains(&name) {
            return Err(LoadError::ColumnName { path, line, column: name });
        }
        let has_unit = name.rsplit_once('_').is_some_and(|(name, unit)| !name.is_empty() && !unit.is_empty());
        if name != "frame" && !has_unit {
            return Err(LoadError::NoUnit { path, line, column: name });
        }
        names.push(name);
    }
    let frame_column = names.iter().position(|name| name == "frame");
    let columns: Vec<usize> = (0..names.len()).filter(|&at| Some(at) != frame_column).collect();
    if columns.is_empty() {
        return Err(LoadError::Empty { path, what: "column of values" });
    }
    let mut rows: Vec<(u64, Option<usize>, Vec<Option<f64>>)> = Vec::new();
    for record in records {
        let record = record.map_err(refused)?;
        let line = line_of(&record);
        if record.len() != names.len() {
            let decimal_commas = separator == b',' && record.len() == 2 * names.len();
            let (found, expected) = (record.len(), names.len());
            return Err(LoadError::Row { path, line, found, expected, decimal_commas });
        }
        let frame = match frame_column {
            Some(at) => {
                let frame = record[at].parse::<usize>().ok().filter(|&frame| frame <= n_frames);
                let text = || record[at].to_owned();
                Some(frame.ok_or_else(|| LoadError::Frame { path: path.clone(), line, text: text(), n_frames })?)
            }
            None => None,
        };
        let number = |&at: &usize| {
            let cell = &record[at];
            let plain = if separator == b',' { cell.to_owned() } else { cell.replacen(',', ".", 1) };
            match plain.parse::<f64>() {
                _ if cell.is_empty() => Ok(None),
                Ok(value) if value.is_finite() => Ok(Some(value)),
                _ => {
                    let column = names[at].clone();
                    Err(LoadError::Number { path: path.clone(), line, column, text: cell.to_owned() })
                }
            }
        };
        rows.push((line, frame, columns.iter().map(number).collect::<Result<_, _>>()?));
    }
    if rows.is_empty() {
        return Err(LoadError::Empty { path, what: "row" });
    }
    if frame_column.is_none() {
        // With the reference first its row is frame 0.
        let first = match rows.len() {
            n if n == n_frames => 1,
            n if n == n_frames + 1 => 0,
            n_rows => return Err(LoadError::Length { path, n_rows, n_frames }),
        };
        rows.iter_mut().zip(first..).for_each(|(row, frame)| row.1 = Some(frame));
    }
    let mut taken = vec![false; n_frames + 1];
    let mut table: Vec<LoadColumn> =
        columns.iter().map(|&at| LoadColumn { name: names[at].clone(), values: vec![None; n_frames] }).collect();
    for (line, frame, values) in rows {
        let frame = frame.unwrap_or(0);
        if std::mem::replace(&mut taken[frame], true) {
            return Err(LoadError::Twice { path, line, frame });
        }
        for (column, value) in table.iter_mut().zip(values) {
            if frame > 0 {
                column.values[frame - 1] = value;
            }
        }
    }
    Ok(LoadTable { columns: table })
}

/// `load [N]` and `load (N)` as `load_N`; blanks inside a name as `_`.
fn with_unit(cell: &str) -> String {
    let bracketed = [('[', ']'), ('(', ')')].into_iter().find_map(|(open, close)| {
        let (name, unit) = cell.strip_suffix(close)?.rsplit_once(open)?;
        let unit = if ["-", ""].contains(&unit.trim()) { "1" } else { unit.trim() };
        Some(format!("{}_{unit}", name.trim()))
    });
    bracketed.unwrap_or_else(|| cell.to_owned()).replace([' ', '\t'], "_")
}
