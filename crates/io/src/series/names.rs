//! The numbers in the names of a series, and the order that they make.
//!
//! What a point or a dash beside digits means shows in no single name: `0.25kN` is a number and `1.2.3` a version,
//! `T-20C` is cold and `a-1` the first. So each place of a name is judged over all names of the series.

use crate::load::unit_of;
use std::cmp::Ordering;
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

/// Fractions that fill so much of the whole numbers between them are counted (2.9, 2.10, 2.11) and no decimals.
const COUNTED: f64 = 0.75;

/// How the numbers at one place of the names are read; without any of it they are digits.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Reading {
    /// The decimal mark.
    decimal: Option<char>,
    sign: bool,
    exponent: bool,
    /// Whether units of different size stand behind them.
    units: bool,
}

/// A place of a number: folder or file on the way, and which number of that name.
type Place = (usize, usize);

/// The order of the files of a series by the numbers in their names: decimals (`0.25`, `0,25`), signs, exponents and
/// units behind (`500N`, `1kN`) where the names as a whole show that they are such.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::series::NameOrder;
/// let mut names = ["F=1kN.png", "F=0.5kN.png", "F=0kN.png", "F=0.25kN.png"].map(std::path::PathBuf::from);
/// let order = NameOrder::of(&names);
/// names.sort_by(|a, b| order.compare(a, b));
/// assert_eq!(names.map(|name| name.display().to_string()), ["F=0kN.png", "F=0.25kN.png", "F=0.5kN.png", "F=1kN.png"]);
/// ```
#[derive(Debug, Clone, Default)]
pub struct NameOrder {
    places: HashMap<Place, Reading>,
}

/// A stretch of a name.
#[derive(Debug, PartialEq)]
enum Part {
    Number(f64),
    Text(String),
}

/// Digits with all that may belong to the number.
#[derive(Debug, Clone, Copy)]
struct Run<'a> {
    /// The name up to the sign.
    before: &'a str,
    /// `+`, `-`, or nothing.
    sign: &'a str,
    digits: &'a str,
    /// Points and commas, each with the digits behind it.
    fractions: &'a str,
    /// `e-3`, or nothing.
    exponent: &'a str,
    /// Letters behind, up to another sign.
    unit: &'a str,
}

impl Run<'_> {
    /// The decimal mark and the digits behind it, where there is just one.
    fn fraction(&self) -> Option<(char, &str)> {
        let mark = self.fractions.chars().next()?;
        Some((mark, self.fractions.get(1..)?)).filter(|(_, digits)| digits.bytes().all(|c| c.is_ascii_digit()))
    }
}

/// The digits at the beginning of `text`.
fn digits(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    text.get(..end).unwrap_or_default()
}

/// The numbers of a name with all that may belong to them.
fn runs(name: &str) -> Vec<Run<'_>> {
    let (mut found, mut at) = (Vec::new(), 0);
    let rest = |at: usize| name.get(at..).unwrap_or_default();
    while let Some(begin) = rest(at).find(|c: char| c.is_ascii_digit()).map(|begin| at + begin) {
        let before = name.get(..begin).unwrap_or_default();
        let bare = before.strip_suffix(['-', '+', '\u{2212}']).filter(|bare| bare.len() >= at);
        // Between digits a dash separates: 2026-11-28.
        let bare = bare.filter(|bare| !bare.ends_with(|c: char| c.is_ascii_digit())).unwrap_or(before);
        let whole = digits(rest(begin));
        at = begin + whole.len();
        let fractions = at;
        while let Some(more) = rest(at).strip_prefix(['.', ',']).map(digits).filter(|more| !more.is_empty()) {
            at += 1 + more.len();
        }
        let exponent = at;
        if let Some(power) = rest(at).strip_prefix(['e', 'E']) {
            let bare = power.strip_prefix(['-', '+']).unwrap_or(power);
            if !digits(bare).is_empty() {
                at += 1 + power.len() - bare.len() + digits(bare).len();
            }
        }
        let unit = rest(at).split(|c: char| !c.is_alphabetic()).next().unwrap_or_default();
        let part = |from: usize, to: usize| name.get(from..to).unwrap_or_default();
        found.push(Run {
            before: bare,
            sign: part(bare.len(), begin),
            digits: whole,
            fractions: part(fractions, exponent),
            exponent: part(exponent, at),
            unit,
        });
    }
    found
}

/// Folders and file of a path, each as text.
fn names(path: &Path) -> Vec<String> {
    path.components().map(|part| part.as_os_str().to_string_lossy().into_owned()).collect()
}

impl NameOrder {
    /// Reads the numbers of `files` as all these names together show them.
    pub fn of<'a, P: AsRef<Path> + 'a>(files: impl IntoIterator<Item = &'a P>) -> Self {
        let all: Vec<Vec<String>> = files.into_iter().map(|file| names(file.as_ref())).collect();
        let mut places: HashMap<Place, Vec<Run<'_>>> = HashMap::new();
        for (level, name) in all.iter().flat_map(|names| names.iter().enumerate()) {
            for (k, run) in runs(name).into_iter().enumerate() {
                places.entry((level, k)).or_default().push(run);
            }
        }
        let read = |(place, runs): (Place, Vec<Run<'_>>)| {
            Some((place, reading(&runs))).filter(|(_, read)| *read != Reading::default())
        };
        Self { places: places.into_iter().filter_map(read).collect() }
    }

    /// Which of two files comes first; ties as by [`natural_order`](super::natural_order).
    pub fn compare(&self, a: &Path, b: &Path) -> Ordering {
        let plain = || super::natural_order(a, b);
        if self.places.is_empty() {
            return plain();
        }
        let (all_a, all_b) = (names(a), names(b));
        let levels = all_a.iter().zip(&all_b).enumerate();
        let order = levels.map(|(level, (a, b))| compare_parts(&self.parts(level, a), &self.parts(level, b)));
        order.into_iter().find(|order| order.is_ne()).unwrap_or(Ordering::Equal).then_with(plain)
    }

    /// Whether the last number in the name of `file` is zero where `first`, of the same name otherwise, has another one
    /// above it.
    pub fn is_zero_of(&self, file: &Path, first: &Path) -> bool {
        let parts = |path: &Path| {
            let names = names(path);
            let level = names.len().checked_sub(1)?;
            let mut parts = self.parts(level, &Path::new(names.last()?).file_stem()?.to_string_lossy());
            let at = parts.iter().rposition(|part| matches!(part, Part::Number(_)))?;
            let Part::Number(number) = parts.remove(at) else { return None };
            Some((parts, at, number))
        };
        let (Some((same, place, zero)), Some((first_same, first_place, number))) = (parts(file), parts(first)) else {
            return false;
        };
        file.parent() == first.parent() && (same, place) == (first_same, first_place) && zero == 0.0 && number > 0.0
    }

    /// A name as its numbers and the texts between them.
    fn parts(&self, level: usize, name: &str) -> Vec<Part> {
        let (mut parts, mut end) = (Vec::new(), 0);
        for (k, run) in runs(name).into_iter().enumerate() {
            let reading = self.places.get(&(level, k)).copied().unwrap_or_default();
            let text = |from: usize, to: usize| Part::Text(name.get(from..to).unwrap_or_default().to_owned());
            let begin = run.before.len() + if reading.sign { 0 } else { run.sign.len() };
            parts.push(text(end, begin));
            end = run.before.len() + run.sign.len() + run.digits.len();
            let mut number = run.digits.to_owned();
            if let Some((_, fraction)) = run.fraction().filter(|(mark, _)| reading.decimal == Some(*mark)) {
                number.push('.');
                number.push_str(fraction);
                end += run.fractions.len();
            }
            if reading.exponent && end == run.before.len() + run.sign.len() + run.digits.len() + run.fractions.len() {
                number.push_str(run.exponent);
                end += run.exponent.len();
            }
            let is_negative = reading.sign && !matches!(run.sign, "" | "+");
            let factor = if reading.units { unit_of(run.unit).map_or(1.0, |(_, factor)| factor) } else { 1.0 };
            let value = number.parse::<f64>().unwrap_or(f64::INFINITY) * factor;
            parts.push(Part::Number(if is_negative { -value } else { value }));
        }
        parts.push(Part::Text(name.get(end..).unwrap_or_default().to_owned()));
        parts.retain(|part| !matches!(part, Part::Text(text) if text.is_empty()));
        parts
    }
}

fn compare_parts(a: &[Part], b: &[Part]) -> Ordering {
    let one = |(a, b): (&Part, &Part)| match (a, b) {
        (Part::Number(a), Part::Number(b)) => a.total_cmp(b),
        (Part::Text(a), Part::Text(b)) => alphanumeric_sort::compare_str(a, b),
        (Part::Number(_), Part::Text(_)) => Ordering::Less,
        (Part::Text(_), Part::Number(_)) => Ordering::Greater,
    };
    let order = a.iter().zip(b).map(one).find(|order| order.is_ne());
    order.unwrap_or_else(|| a.len().cmp(&b.len()))
}

/// How the numbers at one place are read: `runs` are those of all names.
fn reading(runs: &[Run<'_>]) -> Reading {
    let decimal = ['.', ','].into_iter().find(|&mark| is_decimal(runs, mark));
    // Behind a letter or at a dash a sign separates, unless another name has the same and a number without it.
    let bare: BTreeSet<&str> = runs.iter().filter(|run| matches!(run.sign, "" | "+")).map(|run| run.before).collect();
    let is_sign = |run: &Run<'_>| {
        run.before.is_empty()
            || run.before.ends_with(['=', '_', '('])
            || bare.contains(run.before)
            || is_symbol(run.before) && is_signed_unit(run.unit)
    };
    let sign = runs.iter().any(|run| !matches!(run.sign, "" | "+") && is_sign(run));
    // 1e5 may be anything; 1e-5 is a power of ten.
    let exponent = runs.iter().any(|run| run.exponent.contains(['-', '+']));
    Reading { decimal, sign, exponent, units: have_units(runs) }
}

/// Whether a text ends in a letter that stands alone, as the symbol of a quantity does: `T` of `T-20C`.
fn is_symbol(before: &str) -> bool {
    let mut letters = before.chars().rev();
    letters.next().is_some_and(char::is_alphabetic) && !letters.next().is_some_and(char::is_alphanumeric)
}

/// Whether a unit is one of quantities that are below zero as often as not.
fn is_signed_unit(unit: &str) -> bool {
    matches!(unit, "C" | "degC" | "V" | "mV") || unit_of(unit).is_some()
}

/// Whether `mark` is the decimal mark of the numbers at one place.
fn is_decimal(runs: &[Run<'_>], mark: char) -> bool {
    // Dates and versions have several.
    if runs.iter().any(|run| !run.fractions.is_empty() && run.fraction().is_none_or(|(own, _)| own != mark)) {
        return false;
    }
    let mut groups: HashMap<(&str, &str, &str), Vec<&str>> = HashMap::new();
    for run in runs {
        if let Some((_, fraction)) = run.fraction() {
            groups.entry((run.before, run.sign, run.digits)).or_default().push(fraction);
        }
    }
    !groups.is_empty() && !groups.values().any(|fractions| are_counted(fractions))
}

/// Whether the digits behind a point are counted (2.9, 2.10, 2.11) and no decimals.
fn are_counted(fractions: &[&str]) -> bool {
    let shortest = fractions.iter().map(|fraction| fraction.len()).min().unwrap_or(0);
    if fractions.iter().all(|fraction| fraction.len() == shortest) {
        return false; // both readings have one order
    }
    // Who writes 0.5 writes no 0.50.
    let ends_in_zero = |fraction: &&str| fraction.len() > shortest && fraction.ends_with('0');
    let counts: BTreeSet<u64> = fractions.iter().filter_map(|fraction| fraction.parse().ok()).collect();
    let between = counts.last().zip(counts.first()).map_or(0, |(last, first)| last - first);
    fractions.iter().any(ends_in_zero) || counts.len() as f64 >= COUNTED * (between as f64 + 1.0)
}

/// Whether known units of one kind and several sizes stand behind the numbers.
fn have_units(runs: &[Run<'_>]) -> bool {
    let is_zero =
        |run: &&Run<'_>| run.digits.bytes().chain(run.fractions.bytes()).all(|c| matches!(c, b'0' | b'.' | b','));
    let units: Option<Vec<_>> = runs.iter().filter(|run| !is_zero(run)).map(|run| unit_of(run.unit)).collect();
    let units = units.unwrap_or_default();
    units.iter().any(|unit| Some(unit.1) != units.first().map(|first| first.1))
        && units.iter().all(|unit| Some(unit.0) == units.first().map(|first| first.0))
}

/// Sorts the files of a series by the numbers in their names.
pub(super) fn sort(files: &mut [PathBuf]) {
    let order = NameOrder::of(files.iter());
    files.sort_by(|a, b| order.compare(a, b));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `wanted` is the order of these names, however they are given.
    #[track_caller]
    fn assert_order(wanted: &[&str]) {
        for turn in 0..wanted.len() {
            let mut names: Vec<PathBuf> = wanted.iter().rev().map(PathBuf::from).collect();
            names.rotate_left(turn);
            sort(&mut names);
            assert_eq!(names, wanted.iter().map(PathBuf::from).collect::<Vec<_>>());
        }
    }

    #[test]
    fn decimals_signs_exponents_and_units_are_numbers() {
        assert_order(&[
            "F=0kN.png",
            "F=0.25kN.png",
            "F=0.5kN.png",
            "F=0.75kN.png",
            "F=1kN.png",
            "F=1.25kN.png",
            "F=10kN.png",
        ]);
        assert_order(&["F=0,25kN.tif", "F=0,5kN.tif", "F=1kN.tif", "F=1,5kN.tif"]);
        assert_order(&["T-20C.png", "T-10C.png", "T0C.png", "T5.5C.png", "T10C.png"]);
        assert_order(&["T-20.png", "T-10.png", "T+5.png"]);
        assert_order(&["F=-5.tif", "F=-1.tif"]);
        assert_order(&["T-20C.png", "T-10C.png"]);
        assert_order(&["a_F-5kN.png", "a_F-1kN.png"]);
        assert_order(&["rate 1e-4.tif", "rate 2.5e-4.tif", "rate 1e-3.tif", "rate 1e0.tif", "rate 1e+2.tif"]);
        assert_order(&["0N.tif", "500N.tif", "1kN.tif", "1.5kN.tif"]);
        assert_order(&["F=0.25kN/img_2.tif", "F=0.25kN/img_10.tif", "F=0.5kN/img_1.tif"]);
    }

    #[test]
    fn dashes_points_and_commas_between_counts_are_none() {
        assert_order(&["img_0001.tif", "img_2.tif", "img_0010.tif"]);
        assert_order(&["a-1.tif", "a-2.tif", "a-10.tif"]);
        assert_order(&["plate-20C.tif", "plate-40C.tif"]);
        assert_order(&["2026-11-28_001.tif", "2026-11-28_002.tif", "2026-12-01_001.tif"]);
        assert_order(&["v1.2.3.tif", "v1.2.10.tif", "v1.10.1.tif"]);
        assert_order(&["run2.1.tif", "run2.2.tif", "run2.10.tif"]);
        assert_order(&["run2.8.tif", "run2.9.tif", "run2.11.tif"]);
        assert_order(&["img.0001", "img.0002", "img.0010"]);
        assert_order(&["1e2.tif", "1e10.tif", "3e8a.tif"]);
        assert_order(&["0N_a.tif", "5N_a.tif", "6lbs_a.tif"]);
    }

    #[test]
    fn zero_is_named_beside_a_number_above_it() {
        let is_zero = |files: [&str; 2]| {
            let [file, first] = files.map(Path::new);
            NameOrder::of(&[file, first]).is_zero_of(file, first)
        };
        assert!(is_zero(["F=0kN.png", "F=0.25kN.png"]) && is_zero(["a_000.tif", "a_170.tif"]));
        assert!(
            !is_zero(["T0C.png", "T-20C.png"]) && !is_zero(["b/0.png", "a/1.png"]) && !is_zero(["y_0.tif", "x_1.tif"])
        );
    }
}
