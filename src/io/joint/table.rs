//! Tables of results: whole numbers first, then numbers with 17 digits.

use std::io::{self, Write};

/// Writes a table: `#` lines with `notes`, the header `columns`, and the rows; numbers with 17 digits.
///
/// # Errors
/// Those of `out`.
pub fn write_table<W: Write>(
    mut out: W,
    notes: &[String],
    columns: &[String],
    rows: impl Iterator<Item = (Vec<u64>, Vec<f64>)>,
) -> io::Result<()> {
    for note in notes.iter().flat_map(|note| note.lines()) {
        writeln!(out, "# {note}")?;
    }
    writeln!(out, "{}", columns.join(","))?;
    for (numbers, values) in rows {
        let mut first = true;
        for number in numbers {
            write!(out, "{}{number}", if first { "" } else { "," })?;
            first = false;
        }
        for value in values {
            write!(out, ",{value:.16e}")?;
        }
        writeln!(out)?;
    }
    out.flush()
}
