//! What is wrong with a case file, where, and in plain words.

use super::CaseFile;
use super::schema::schema_of;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};
use thiserror::Error;
use toml::de::{DeTable, DeValue};

/// Why a case file cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaseError {
    /// There is no such file.
    #[error("{}: there is no such case file; check the name and the folder", .0.display())]
    NotFound(PathBuf),
    /// The file system refuses.
    #[error("{}: the case file cannot be read: {}", .0.display(), .1)]
    Io(PathBuf, io::Error),
    /// The file is not UTF-8 text.
    #[error("{}, line {line}: the case file is not UTF-8 text; save it as UTF-8", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// Line of the first byte that is none, from 1.
        line: usize,
    },
    /// Not TOML, an unknown key, a value of the wrong kind or that makes no sense, a section for another command.
    #[error("{}, line {line}: {message}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// The key with its section, such as `correlation.noise`, when it is known.
        key: Option<String>,
        /// What is wrong, with the key and what is expected.
        message: String,
    },
    /// A section that the command needs is not there; what to give.
    #[error("{}: [{}] is missing; {}", .0.display(), .1, .2)]
    Missing(PathBuf, &'static str, &'static str),
}

/// Where a key stands: `case.toml, line 12`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CasePlace {
    /// The file.
    pub path: PathBuf,
    /// Line of the key, or of its section where the key is not there, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// The key with its section, such as `cohesive.r`; the section where no key is meant.
    pub key: String,
}

impl fmt::Display for CasePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, line {}", self.path.display(), self.line)
    }
}

/// The text of a case file, for those who find a fault in a value later: it says where a key stands.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CaseText {
    path: PathBuf,
    text: Arc<str>,
}

impl CaseText {
    pub(super) fn new(path: &Path, text: &str) -> Self {
        Self { path: path.to_owned(), text: text.into() }
    }

    /// The text and its file.
    pub(super) fn parts(&self) -> (&str, &Path) {
        (&self.text, &self.path)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The place of `key` of `section` (`fit`, `substrate.upper`); of the section where the key is not there or none is
    /// meant, of the beginning where there is no such section.
    pub fn place(&self, section: &str, key: Option<&str>) -> CasePlace {
        let table = DeTable::parse(&self.text).ok();
        let at = table.as_ref().and_then(|table| find(table.get_ref(), section, key)).unwrap_or(0);
        let (line, column) = line_and_column(&self.text, at);
        let key = key.map_or_else(|| section.to_owned(), |key| format!("{section}.{key}"));
        CasePlace { path: self.path.clone(), line, column, key }
    }

    /// The error `message` about `key` of `section`, or about the section.
    pub fn refuse(&self, section: &str, key: Option<&str>, message: impl Into<String>) -> CaseError {
        let CasePlace { path, line, column, key } = self.place(section, key);
        CaseError::Invalid { path, line, column, key: Some(key), message: message.into() }
    }
}

/// Where `key` of `section` begins, else the section. A key of `[substrate]` may stand in the section of a group.
fn find(table: &DeTable<'_>, section: &str, key: Option<&str>) -> Option<usize> {
    fn inside<'a, 'i>(value: &'a DeValue<'i>) -> Option<&'a DeTable<'i>> {
        match value {
            DeValue::Table(table) => Some(table),
            DeValue::Array(items) => items.iter().find_map(|item| inside(item.get_ref())),
            _ => None,
        }
    }
    let place = |table: &DeTable<'_>, name: &str| -> Option<usize> {
        table.iter().find(|(key, _)| key.get_ref() == name).map(|(key, _)| key.span().start)
    };
    let (mut here, mut at) = (table, None);
    for name in section.split('.') {
        at = place(here, name).or(at);
        let value = here.iter().find(|(key, _)| key.get_ref() == name).map(|(_, value)| value.get_ref());
        let Some(table) = value.and_then(inside) else { return at };
        here = table;
    }
    let Some(key) = key else { return at };
    place(here, key).or_else(|| here.iter().find_map(|(_, value)| place(inside(value.get_ref())?, key))).or(at)
}

/// Line and column, from 1, of the byte `at`.
fn line_and_column(text: &str, at: usize) -> (usize, usize) {
    let before = text.get(..at.min(text.len())).unwrap_or("");
    (1 + before.matches('\n').count(), 1 + before.rsplit('\n').next().unwrap_or("").chars().count())
}

/// Says where `error` is and in plain words what is wrong.
pub(super) fn explain(error: &toml::de::Error, text: &str, path: &Path) -> CaseError {
    let at = error.span().map_or(0, |span| span.start).min(text.len());
    let (line, column) = line_and_column(text, at);
    let found = DeTable::parse(text).ok().and_then(|table| locate(table.get_ref(), at));
    let (section, key) = match &found {
        Some(found) => (found.section(), Some(found.key())),
        None => (String::new(), None),
    };
    let wrong = plain(error.message());
    let message = match (&found, wrong.split_once(", expected ")) {
        (Some(_), Some((what, expected))) if what.starts_with("unknown key") => {
            let near = found.as_ref().and_then(|found| nearest(&found.name, expected));
            let near = near.map_or_else(String::new, |near| format!("did you mean `{near}`? "));
            format!("{what} {section}; {near}expected {expected}")
        }
        (Some(found), _) => {
            let is_list = found.above.is_empty() && is_list(&found.name);
            let item = if is_list { "expected a section [[..]]" } else { "expected a section" };
            let wrong = wrong.replace("expected a section", item).replace("[[..]]", &format!("[[{}]]", found.name));
            // A list of sections, written as one section.
            let several = is_list && wrong.starts_with("is a section");
            let write = match several {
                true => format!("; there may be several: write [[{0}]] instead of [{0}]", found.name),
                false => String::new(),
            };
            format!("`{}` {section}: {wrong}{write}", found.name)
        }
        // A key that is there twice: the text at the error is the key.
        (None, _) if wrong == "duplicate key" => {
            let name = error.span().and_then(|span| text.get(span)).unwrap_or("");
            format!("the key `{name}` is there twice; remove one")
        }
        (None, _) => guess_meaning(text, line).unwrap_or(wrong),
    };
    CaseError::Invalid { path: path.to_owned(), line, column, key, message }
}

/// What a line that is no TOML shows that it means: a number with a decimal comma, or a text without quotes.
fn guess_meaning(text: &str, line: usize) -> Option<String> {
    let (key, value) = text.lines().nth(line - 1)?.split_once('=')?;
    let (key, value) = (key.trim(), value.split('#').next()?.trim());
    let with_point = value.replacen(',', ".", 1);
    if value.matches(',').count() == 1 && with_point.parse::<f64>().is_ok() {
        return Some(format!("`{key}`: numbers have a decimal point, no comma: {key} = {with_point}"));
    }
    let plain = |c: char| c.is_alphanumeric() || "/\\._-*?~: ".contains(c);
    let word = value.chars().next().is_some_and(|first| first.is_alphabetic() || "/\\.~*".contains(first));
    (word && value.chars().all(plain)).then(|| format!("`{key}`: a text without quotes: write {key} = '{value}'"))
}

/// serde's words in those of a user.
fn plain(message: &str) -> String {
    let message = message.trim_end();
    if let Some(unknown) = message.strip_prefix("unknown field ") {
        return format!("unknown key {unknown}");
    }
    if let Some(unknown) = message.strip_prefix("unknown variant ") {
        return format!("unknown word {unknown}");
    }
    if let Some(missing) = message.strip_prefix("missing field ") {
        return format!("the key {missing} is missing");
    }
    if message == "wanted string or table" {
        return "expected a word in quotes".to_owned();
    }
    if message.starts_with("missing escaped value") {
        return "a backslash in \"..\" starts an escape; write the text in '..' or with / for \\".to_owned();
    }
    if message.starts_with("string values must be quoted") {
        return "there is no value here, or a text without quotes".to_owned();
    }
    let wrong = message.strip_prefix("invalid type: ").or_else(|| message.strip_prefix("invalid value: "));
    // The value may itself hold the words looked for: what is expected stands last, the kind first.
    let Some((found, expected)) = wrong.and_then(|wrong| wrong.rsplit_once(", expected ")) else {
        return message.to_owned();
    };
    let found = [
        ("floating point ", "the number "),
        ("integer ", "the number "),
        ("string ", "the text "),
        ("boolean ", ""),
        ("sequence", "a list"),
        ("map", "a section"),
    ]
    .into_iter()
    .find_map(|(theirs, ours)| found.strip_prefix(theirs).map(|rest| format!("{ours}{rest}")))
    .unwrap_or_else(|| found.to_owned());
    let expected = match expected {
        "u32" => "a whole number, 0 or larger",
        "f64" => "a number",
        "a boolean" => "true or false",
        "a string" | "string or table" => "a text in quotes",
        "a sequence" => "sections [[..]]",
        "usize" | "u64" => "a whole number, 0 or larger",
        "a map" => "a section",
        section if section.starts_with("struct Case") => "a section",
        other => other,
    };
    format!("is {found}, expected {expected}")
}

/// The key among those named in `expected`, each in backticks, that `given` is most like, where it is like one.
fn nearest<'a>(given: &str, expected: &'a str) -> Option<&'a str> {
    let known = expected.split('`').skip(1).step_by(2);
    let (distance, key) = known.map(|key| (strsim::osa_distance(given, key), key)).min()?;
    // A letter wrong, missing, too many or at the place of its neighbour in every four; or the beginning is right.
    (distance <= 1 + given.chars().count() / 4 || strsim::jaro_winkler(given, key) > 0.85).then_some(key)
}

/// Whether the section may be there several times.
fn is_list(section: &str) -> bool {
    static LISTS: LazyLock<Vec<String>> = LazyLock::new(|| {
        let schema = schema_of::<CaseFile>();
        let sections = schema.get("properties").and_then(|sections| sections.as_object()).into_iter().flatten();
        let lists = sections.filter(|(_, about)| about.get("type").is_some_and(|kind| kind == "array"));
        lists.map(|(section, _)| section.clone()).collect()
    });
    LISTS.iter().any(|list| list == section)
}

/// The heading of a section in a case file: `[fit]`, `[[support]]`.
pub fn heading(section: &str) -> String {
    if is_list(section) { format!("[[{section}]]") } else { format!("[{section}]") }
}

/// A key of the file and the sections above it.
struct Located {
    above: Vec<String>,
    name: String,
}

impl Located {
    fn key(&self) -> String {
        self.above.iter().chain([&self.name]).cloned().collect::<Vec<_>>().join(".")
    }

    fn section(&self) -> String {
        match self.above.as_slice() {
            [] => "at the top level".to_owned(),
            above => format!("in {}", heading(&above.join("."))),
        }
    }
}

/// The key that stands, or whose value stands, at the byte `at`; the innermost one.
fn locate(table: &DeTable<'_>, at: usize) -> Option<Located> {
    fn inside(value: &DeValue<'_>, at: usize) -> Option<Located> {
        match value {
            DeValue::Table(table) => locate(table, at),
            DeValue::Array(items) => items.iter().find_map(|item| inside(item.get_ref(), at)),
            _ => None,
        }
    }
    table.iter().find_map(|(key, value)| {
        let name = key.get_ref().to_string();
        if let Some(mut found) = inside(value.get_ref(), at) {
            found.above.insert(0, name);
            return Some(found);
        }
        (key.span().contains(&at) || value.span().contains(&at)).then_some(Located { above: Vec::new(), name })
    })
}
