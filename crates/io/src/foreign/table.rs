//! A field as a table: text with a line of names.

use super::layout::{Invalid, LAYOUTS, Layout, LengthUnit};
use super::{FieldError, FieldOptions, FieldPoints, Meaning};
use crate::case::Decimal;
use crate::load::decimals::{Evidence, agreed, evidence, number};
use crate::text::decoded;
use std::path::Path;

/// Lines among which the names of the columns are looked for: preambles of machines are long.
pub(super) const PREAMBLE: usize = 1000;
/// Rows whose numbers show the decimal mark.
const SHOWN_ROWS: usize = 500;

/// What stands between cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    Sign(char),
    Space,
}

pub(super) const SEPARATORS: [Separator; 4] =
    [Separator::Sign(';'), Separator::Sign('\t'), Separator::Sign(','), Separator::Space];

impl Separator {
    pub(super) fn cells<'a>(self, line: &'a str) -> Vec<&'a str> {
        let bare = |cell: &'a str| cell.trim().trim_matches('"').trim();
        match self {
            Self::Sign(sign) => line.trim_end_matches(['\r', '\n']).split(sign).map(bare).collect(),
            Self::Space => line.split_whitespace().map(bare).collect(),
        }
    }
}

/// The line of names, and what it says.
struct Header {
    layout: &'static Layout,
    /// Its line, from 0.
    line: usize,
    separator: Separator,
    /// Names in small letters without unit.
    names: Vec<String>,
    /// As they stand.
    given: Vec<String>,
    units: Vec<Option<LengthUnit>>,
}

/// A name in small letters without its unit, and the unit.
pub(super) fn name_and_unit(cell: &str) -> (String, Option<LengthUnit>) {
    let cell = cell.trim().trim_matches('"').trim();
    let (name, unit) = match cell.split_once(['[', '(']) {
        Some((name, rest)) => (name, LengthUnit::named(rest.trim_end_matches([']', ')', ' ']))),
        None => (cell, None),
    };
    let unit = unit.or_else(|| {
        LengthUnit::named(name.rsplit_once('_')?.1)
            .filter(|unit| matches!(unit, LengthUnit::Px | LengthUnit::Um | LengthUnit::Mm))
    });
    (name.trim().to_lowercase().replace(' ', "_"), unit)
}

/// What a line is without the signs with which comments and names of columns begin.
pub(super) fn bare(line: &str) -> &str {
    let line = line.trim_start_matches('\u{feff}').trim();
    let line = line.trim_start_matches(['#', '%', '*']).trim();
    match line.get(..9) {
        Some(word) if word.eq_ignore_ascii_case("variables") => {
            line.get(9..).unwrap_or("").trim_start_matches([' ', '='])
        }
        _ => line,
    }
}

impl Header {
    fn find(lines: &[&str], path: &Path, wanted: Option<&'static Layout>) -> Result<Self, FieldError> {
        let mut most: Vec<String> = Vec::new();
        for (line, text) in lines.iter().enumerate().take(PREAMBLE) {
            for separator in SEPARATORS {
                let given: Vec<String> = separator.cells(bare(text)).into_iter().map(str::to_owned).collect();
                if given.len() < 4 {
                    continue;
                }
                let (names, units): (Vec<_>, Vec<_>) = given.iter().map(|cell| name_and_unit(cell)).unzip();
                let fits = |layout: &&Layout| match wanted {
                    Some(wanted) => layout.name == wanted.name && layout.places(&names).is_some(),
                    None => layout.is_of(&names),
                };
                if let Some(layout) = LAYOUTS.iter().find(fits) {
                    return Ok(Self { layout, line, separator, names, given, units });
                }
                let is_words = names.iter().all(|name| name.parse::<f64>().is_err());
                if is_words && separator != Separator::Space && given.len() > most.len() {
                    most = given;
                }
            }
        }
        let (path, columns) = (path.to_owned(), most);
        Err(match wanted {
            None => FieldError::Unknown { path, columns },
            Some(layout) => {
                let wanted: Vec<String> = layout.columns.iter().map(|names| names.join(", ")).collect();
                let wanted = if wanted.is_empty() { "it is in HDF5".into() } else { wanted.join(" or ") };
                FieldError::Missing { path, layout: layout.name, wanted, columns }
            }
        })
    }

    fn at(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|column| column == name)
    }
}

/// Whether a line is no row: empty, a comment, or a zone of Tecplot.
fn is_no_row(line: &str) -> bool {
    let line = line.trim();
    line.is_empty()
        || line.starts_with(['#', '%', '*'])
        || line.get(..4).is_some_and(|word| word.eq_ignore_ascii_case("zone"))
}

/// Reads the text of a table.
pub(super) fn parse(bytes: &[u8], path: &Path, options: &FieldOptions) -> Result<FieldPoints, FieldError> {
    let (text, _) = decoded(bytes).map_err(|line| FieldError::NoText { path: path.to_owned(), line })?;
    let lines: Vec<&str> = text.lines().collect();
    let mut header = Header::find(&lines, path, options.layout)?;
    let places = header.layout.places(&header.names).unwrap_or_default();
    let mut rows: Vec<(usize, Vec<&str>)> = Vec::new();
    let below = lines.iter().enumerate().skip(header.line + 1).filter(|(_, line)| !is_no_row(line));
    for (line, text) in below {
        // Tecplot names columns with commas and parts them by spaces.
        if rows.is_empty() && header.separator.cells(text).len() == 1 {
            header.separator = Separator::Space;
        }
        let cells = header.separator.cells(text);
        let is_units = rows.is_empty() && places.iter().all(|&at| cells.get(at).is_some_and(|cell| is_unit(cell)));
        if is_units {
            header.units =
                cells.iter().map(|cell| name_and_unit(&format!("u [{}]", cell.trim_matches(['[', ']']))).1).collect();
            continue;
        }
        rows.push((line + 1, cells));
    }
    let unit = |k: usize| places.get(k).and_then(|&at| header.units.get(at).copied().flatten());
    let column = |k: usize| places.get(k).and_then(|&at| header.given.get(at)).map_or("", String::as_str);
    let meaning = Meaning::of(header.layout, [unit(0), unit(2)], [column(0), column(2)], path, options)?;
    points(&header, &rows, path, &meaning)
}

fn is_unit(cell: &str) -> bool {
    LengthUnit::named(cell.trim_matches(['[', ']', '(', ')'])).is_some()
}

/// The points in the rows below a header.
fn points(
    header: &Header,
    rows: &[(usize, Vec<&str>)],
    path: &Path,
    meaning: &Meaning,
) -> Result<FieldPoints, FieldError> {
    let layout = header.layout;
    let places = layout.places(&header.names).unwrap_or_default();
    let decimal = decimal_of(rows, &places);
    let sigma_at = layout.sigma.and_then(|[u, v]| Some([header.at(u)?, header.at(v)?]));
    let flag_at = match layout.invalid {
        Some(Invalid::Zero(name)) => header.at(name),
        _ => None,
    };
    let mut found = FieldPoints { layout, points: Vec::with_capacity(rows.len()), n_invalid: 0 };
    for (line, cells) in rows {
        let last = places.iter().max().copied().unwrap_or(0);
        if cells.len() <= last {
            let (found, wanted) = (cells.len(), header.names.len());
            return Err(FieldError::Row { path: path.to_owned(), line: *line, found, wanted });
        }
        let value = |at: usize| cells.get(at).and_then(|cell| number(cell, decimal));
        let sigma = sigma_at.and_then(|[u, v]| Some([value(u)?, value(v)?]));
        let is_marked = match layout.invalid {
            Some(Invalid::NegativeSigma) => sigma.is_some_and(|[u, _]| u < 0.0),
            Some(Invalid::Zero(_)) => flag_at.and_then(value) == Some(0.0),
            None => false,
        };
        let mut numbers = [0.0; 4];
        let mut is_known = !is_marked;
        for (to, &at) in numbers.iter_mut().zip(&places) {
            match value(at) {
                Some(value) => *to = value,
                None if cells.get(at).is_some_and(|cell| is_no_value(cell)) => is_known = false,
                None => {
                    let column = header.given.get(at).cloned().unwrap_or_default();
                    let text = cells.get(at).map_or("", |cell| cell).to_owned();
                    return Err(FieldError::Number { path: path.to_owned(), line: *line, column, text });
                }
            }
        }
        match is_known {
            true => found.points.push(meaning.point(numbers, sigma)),
            false => found.n_invalid += 1,
        }
    }
    Ok(found)
}

/// What stands where there is no value.
fn is_no_value(cell: &str) -> bool {
    const WORDS: [&str; 8] = ["", "nan", "-nan", "none", "null", "na", "n/a", "-"];
    let bare = cell.to_ascii_lowercase();
    // Windows writes NaN so.
    WORDS.contains(&bare.as_str()) || bare.contains("#ind") || bare.contains("#qnan") || bare.contains("inf")
}

/// The decimal mark of a field. Nobody groups the digits of positions: a mark that might stand for thousands is that of
/// decimals.
fn decimal_of(rows: &[(usize, Vec<&str>)], places: &[usize; 4]) -> Decimal {
    let cells = || rows.iter().take(SHOWN_ROWS).flat_map(|(_, cells)| places.iter().filter_map(|&at| cells.get(at)));
    let shown = agreed(cells().filter_map(|cell| match evidence(cell) {
        Evidence::Is(mark) => Some(mark),
        _ => None,
    }));
    let possible = cells().find_map(|cell| match evidence(cell) {
        Evidence::Is(mark) | Evidence::Either(mark) => Some(mark),
        Evidence::None => None,
    });
    shown.or(possible).unwrap_or(Decimal::Point)
}
