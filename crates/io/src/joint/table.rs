//! Tables of results: whole numbers first, then numbers with 17 digits.

use super::{JointFileError, bytes_of};
use std::io::{self, Write};
use std::path::Path;

/// Writes a table: `#` lines with `notes`, the header `columns`, and the rows; numbers with 17 digits.
pub fn write_table<W: Write>(
    mut out: W,
    notes: &[String],
    columns: &[String],
    rows: impl Iterator<Item = (Vec<u64>, Vec<f64>)>,
) -> io::Result<()> {
    for note in notes.iter().flat_map(|note| note.lines()) {
        writeln!(out, "# {note}")?;
    }
    // Names may hold commas; numbers do not.
    let mut header = csv::Writer::from_writer(&mut out);
    header.write_record(columns)?;
    header.flush()?;
    drop(header);
    for (numbers, values) in rows {
        let mut first = true;
        for number in numbers {
            write!(out, "{}{number}", if first { "" } else { "," })?;
            first = false;
        }
        for value in values {
            // What is not known is an empty cell.
            if value.is_nan() { write!(out, ",")? } else { write!(out, ",{value:.16e}")? }
        }
        writeln!(out)?;
    }
    out.flush()
}

/// Reads a table that [`write_table`] wrote: its columns, and its rows as numbers.
///
/// # Errors
/// A file that cannot be read, a row with another number of values than of columns, or one that is no number.
pub fn read_table(path: &Path) -> Result<(Vec<String>, Vec<Vec<f64>>), JointFileError> {
    parse_table(&bytes_of(path)?, path)
}

/// The table with the content `bytes`; `path` stands in messages. See [`read_table`].
pub fn parse_table(bytes: &[u8], path: &Path) -> Result<(Vec<String>, Vec<Vec<f64>>), JointFileError> {
    let text = String::from_utf8_lossy(bytes);
    let (header, rows) = split_table(&text, path)?;
    // Names may hold commas, in quotes; numbers do not.
    let mut header = csv::ReaderBuilder::new().has_headers(false).from_reader(header.as_bytes()).into_records();
    let header = header.next().and_then(Result::ok).unwrap_or_default();
    let columns: Vec<String> = header.iter().map(|name| name.trim().to_owned()).collect();
    let row = |(line, row): (usize, &str)| {
        let values: Result<Vec<f64>, _> = row.split(',').map(|value| value.trim().parse::<f64>()).collect();
        values.ok().filter(|values| values.len() == columns.len()).ok_or_else(|| JointFileError::Row {
            path: path.to_owned(),
            line,
            what: format!("{} numbers are needed", columns.len()),
        })
    };
    let rows = rows.map(row).collect::<Result<_, _>>()?;
    Ok((columns, rows))
}

/// The header of a table, and its rows with their lines, from 1; without comments and empty lines.
pub(super) fn split_table<'a>(
    text: &'a str,
    path: &Path,
) -> Result<(&'a str, impl Iterator<Item = (usize, &'a str)> + use<'a>), JointFileError> {
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let (_, header) = lines.next().ok_or_else(|| JointFileError::file(path, "the table has no row"))?;
    Ok((header, lines))
}

/// A row `instant,node,..` with further numbers, called `names` in messages.
pub(super) fn parse_row<const N: usize>(row: &str, names: [&str; N]) -> Result<(usize, u32, [f64; N]), String> {
    let fields: Vec<&str> = row.split(',').map(str::trim).collect();
    let Some((&[instant, node], values)) = fields.split_first_chunk().filter(|(_, values)| values.len() == N) else {
        return Err(format!("{} values instead of {}", fields.len(), N + 2));
    };
    let count =
        |text: &str, what: &str| text.parse::<u32>().map_err(|_| format!("{what} is '{text}', not a whole number"));
    let (instant, node) = (count(instant, "instant")? as usize, count(node, "node")?);
    let mut numbers = [0.0; N];
    for ((number, text), name) in numbers.iter_mut().zip(values).zip(names) {
        let value = text.parse().ok().filter(|value: &f64| value.is_finite());
        *number = value.ok_or_else(|| format!("{name} is '{text}', not a finite number"))?;
    }
    if instant == 0 || instant > 1_000_000 {
        return Err(format!("instant is {instant}; instants are counted from 1"));
    }
    Ok((instant, node, numbers))
}
