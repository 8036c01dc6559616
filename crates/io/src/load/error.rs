//! Why a load file cannot be used.

use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// The column that a cross-section adds.
pub(super) const STRESS: &str = "stress_MPa";

/// Why a load file cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LoadError {
    /// There is no such file.
    #[error("{}: there is no such load file; check the name and the folder", .0.display())]
    NotFound(PathBuf),
    /// The file system refuses.
    #[error("{}: the load file cannot be read: {}", .0.display(), .1)]
    Io(PathBuf, io::Error),
    /// The file is not UTF-8 text.
    #[error("{}, line {line}: the load file is not UTF-8 text; save it as CSV (UTF-8)", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// Line of the first byte that is none, from 1.
        line: usize,
    },
    /// There is no header, column, or row after it.
    #[error("{}: the load file has no {}; a header such as `time_s,load_N` and a row per image are needed", .0.display(), .1)]
    Empty(PathBuf, &'static str),
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
    /// Two columns have one name, or one has none: line, from 1, and name.
    #[error("{}, line {}: a column named '{}' stands there twice or has no name", .0.display(), .1, .2)]
    ColumnName(PathBuf, u64, String),
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
    #[error("{}, line {line}, column '{column}': '{text}' is not a finite number; leave cells empty that are not known", path.display())]
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
    /// A number that may be a thousand times another: nothing in the file shows which.
    #[error(
        "{}, line {line}, column '{column}': '{text}' may be {}; say which mark stands before decimals with decimal = \"point\" \
         or \"comma\" (--load-decimal)",
        path.display(), two_values(text)
    )]
    Ambiguous {
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
    /// There is no column of that name to take times from; those that there are.
    #[error("{}: there is no column '{}' to take times from; the columns are {}", .0.display(), .1, list(.2))]
    NoTime(PathBuf, String, Vec<String>),
    /// This column of times is in another unit.
    #[error("{}: the times in column '{}' are not seconds; write the unit as [s], [ms], [min] or [h], or give clock times such \
         as 10:31:05.20", .0.display(), .1)]
    TimeUnit(PathBuf, String),
    /// A row is earlier than the one before it, or has no time.
    #[error(
        "{}, line {line}, column '{column}': times must not fall, and every row needs one; sort the rows, or cut the record where \
         the clock was set back",
        path.display()
    )]
    TimeOrder {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The column.
        column: String,
    },
    /// The images have clock times, this column of times of the record has none.
    #[error("{}: the frames have clock times, and column '{}' of the load file counts seconds; give both as clock times, or \
         both in seconds from the same moment", .0.display(), .1)]
    Clocks(PathBuf, String),
    /// No frame was taken during the record.
    #[error(
        "{}: no frame lies within the record: it goes from {from} to {to} s, the frames from {first} to {last} s; check the \
         interval of the frames and the time of the reference in the record (start_s)",
        path.display()
    )]
    Apart {
        /// The file.
        path: PathBuf,
        /// First time of the record, s.
        from: f64,
        /// Last time of the record, s.
        to: f64,
        /// First time of a frame, s.
        first: f64,
        /// Last time of a frame, s.
        last: f64,
    },
    /// No force to make a stress of among these columns, or too many.
    #[error("{}: for a stress one column of force in N (or kN, ...) is needed, of several one named load or force, and none named \
         {}; the columns are {}", .0.display(), STRESS, list(.1))]
    Force(PathBuf, Vec<String>),
    /// No column of forces of the name asked for, or too many to choose from among these.
    #[error("{}: {}; the columns are {}", .0.display(), no_force(.1.as_deref()), list(.2))]
    NoForce(PathBuf, Option<String>, Vec<String>),
    /// Times of the frames that are missing, given twice, or mean nothing.
    #[error("{0}")]
    Times(String),
    /// As many rows as there are neither deformed images nor images in all.
    #[error(
        "{}: {n_rows} rows for {n_frames} deformed images; give {n_frames} rows, {} with the reference first, a column `frame`, or \
         the column of times by which rows and frames are joined (--load-time)",
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

/// What a number with one point or comma may be.
fn two_values(text: &str) -> String {
    let without = text.replace(['.', ','], "");
    format!("{without} or {}", text.replace(',', "."))
}

fn list(names: &[String]) -> String {
    names.join(", ")
}

fn no_force(column: Option<&str>) -> String {
    match column {
        Some(name) => format!("there is no column '{name}' of forces in N (or kN, ...)"),
        None => "one column of force in N (or kN, ...) is needed, of several one named load or force; name it with column = \"..\""
            .to_owned(),
    }
}

fn hint(decimal_commas: bool) -> &'static str {
    if decimal_commas { "; with decimal commas separate columns by ;" } else { "" }
}
