//! Points and commas in numbers: decimal marks, or marks between thousands.
//!
//! `1.250` alone may be either. A column has one decimal mark, and mostly so has a file: other numbers show it.

use crate::case::Decimal;

/// Digits of a group of thousands.
const GROUP: usize = 3;

/// What a cell says about the decimal mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Evidence {
    /// Nothing: no mark, or no number.
    None,
    /// It is this one.
    Is(Decimal),
    /// This mark may be either.
    Either(Decimal),
}

const MARKS: [(char, Decimal); 2] = [('.', Decimal::Point), (',', Decimal::Comma)];

fn other(mark: Decimal) -> Decimal {
    if mark == Decimal::Point { Decimal::Comma } else { Decimal::Point }
}

/// Whether the pieces between marks are groups of thousands.
fn are_groups<'a>(mut pieces: impl Iterator<Item = &'a str>) -> bool {
    let first = pieces.next().unwrap_or_default();
    (1..=GROUP).contains(&first.len()) && !first.starts_with('0') && pieces.all(|piece| piece.len() == GROUP)
}

/// What `cell` says.
pub(crate) fn evidence(cell: &str) -> Evidence {
    let bare = cell.trim_start_matches(['+', '-']);
    if !bare.bytes().all(|c| c.is_ascii_digit() || b".,eE+-".contains(&c)) {
        return Evidence::None;
    }
    let (digits, has_exponent) = match bare.split_once(['e', 'E']) {
        Some((digits, _)) => (digits, true),
        None => (bare, false),
    };
    let Some((at, mark)) =
        MARKS.iter().filter_map(|(sign, mark)| Some((digits.rfind(*sign)?, *mark))).max_by_key(|(at, _)| *at)
    else {
        return Evidence::None;
    };
    let (before, after) = (digits.get(..at).unwrap_or_default(), digits.get(at + 1..).unwrap_or_default());
    let is_once = !before.contains(mark.mark());
    match (is_once, before.contains(other(mark).mark())) {
        // 1.250,5
        (true, true) if are_groups(before.split(other(mark).mark())) => Evidence::Is(mark),
        // 1.250.000
        (false, false) if are_groups(digits.split(mark.mark())) => Evidence::Is(other(mark)),
        (true, false) if !has_exponent && are_groups([before, after].into_iter()) => Evidence::Either(mark),
        (true, false) => Evidence::Is(mark),
        _ => Evidence::None,
    }
}

/// The one mark that these say; none where they contradict each other or say nothing.
pub(crate) fn agreed(said: impl Iterator<Item = Decimal>) -> Option<Decimal> {
    let mut said = said.peekable();
    let first = *said.peek()?;
    said.all(|mark| mark == first).then_some(first)
}

/// The finite number that `cell` is with this decimal mark.
pub(crate) fn number(cell: &str, decimal: Decimal) -> Option<f64> {
    let thousands = other(decimal).mark();
    let (whole, rest) = cell.split_at(cell.find([decimal.mark(), 'e', 'E']).unwrap_or(cell.len()));
    let plain = match whole.contains(thousands) {
        true if are_groups(whole.trim_start_matches(['+', '-']).split(thousands)) => whole.replace(thousands, ""),
        true => return None,
        false => whole.to_owned(),
    };
    let text = plain + &rest.replacen(decimal.mark(), ".", 1);
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use Decimal::{Comma, Point};

    #[test]
    fn a_cell_shows_its_decimal_mark_where_it_can_have_no_other() {
        for (cell, wanted) in [
            ("1250", Evidence::None),
            ("1.250", Evidence::Either(Point)),
            ("-12,250", Evidence::Either(Comma)),
            ("0.250", Evidence::Is(Point)),
            ("1250,500", Evidence::Is(Comma)),
            ("1.25", Evidence::Is(Point)),
            (".125", Evidence::Is(Point)),
            ("1,250e3", Evidence::Is(Comma)),
            ("1.250,5", Evidence::Is(Comma)),
            ("1,250.500", Evidence::Is(Point)),
            ("1.250.000", Evidence::Is(Comma)),
            ("07.05.2024", Evidence::None),
            ("10:31:05,200", Evidence::None),
            ("abc", Evidence::None),
            ("", Evidence::None),
        ] {
            assert_eq!(evidence(cell), wanted, "{cell}");
        }
    }

    #[test]
    fn numbers_are_read_with_the_mark_that_is_known() {
        let read = |cell, mark| number(cell, mark);
        assert_eq!([read("1.250", Comma), read("1.250", Point)], [Some(1250.0), Some(1.25)]);
        assert_eq!([read("-1.250.000,5", Comma), read("1,250,000.5", Point)], [Some(-1_250_000.5), Some(1_250_000.5)]);
        assert_eq!(
            [read("2,5e-1", Comma), read("2.5e-1", Point), read(".5", Point)],
            [Some(0.25), Some(0.25), Some(0.5)]
        );
        for (cell, mark) in
            [("1.5", Comma), ("1.000.0", Point), ("12.50,5", Comma), ("nan", Point), ("1e999", Point), ("1,5", Point)]
        {
            assert_eq!(read(cell, mark), None, "{cell}");
        }
    }
}
