//! A case file as it was read, and what each command takes of it.

use super::explain::{explain, heading};
use super::reader::{OF_JOINT, Reader, TESTS};
use super::{CaseError, CaseFile, CaseText};
use crate::text::{read_file, text_of};
use serde::Deserialize;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, Deserializer};

/// A case file as it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct CaseDocument {
    /// All that it says.
    pub case: CaseFile,
    /// Its text.
    pub text: CaseText,
    /// Its sections, in the order of their names.
    sections: Vec<String>,
}

impl CaseDocument {
    /// The document with the content `text`; `path` gives its folder and stands in messages.
    ///
    /// # Errors
    /// No TOML, a key that no section has, a value of the wrong kind.
    pub fn parse(text: &str, path: &Path) -> Result<Self, CaseError> {
        let table = DeTable::parse(text).map_err(|error| explain(&error, text, path))?;
        let sections = table.get_ref().keys().map(|key| key.get_ref().to_string()).collect();
        Ok(Self { case: case_of(table, text, path)?, text: CaseText::new(path, text), sections })
    }

    /// The tables of a case file with the content `text`, as they stand in it.
    ///
    /// # Errors
    /// Those of [`Self::parse`].
    pub fn tables(text: &str, path: &Path) -> Result<serde_json::Value, CaseError> {
        Self::parse(text, path)?;
        toml::from_str(text).map_err(|error| explain(&error, text, path))
    }

    /// Refuses sections that `reader` does not take.
    pub(crate) fn taken_by(&self, reader: Reader) -> Result<(), CaseError> {
        match self.sections.iter().find(|section| !reader.takes(section)) {
            None => Ok(()),
            Some(section) if section == TESTS => {
                let message = "[[test]] names several tests, which quadrille identify fits together; simulate, sweep and run take one";
                Err(self.text.refuse(section, None, message))
            }
            Some(section) if reader == Reader::Tests && OF_JOINT.contains(&section.as_str()) => {
                let message =
                    format!("{} is each test's own: it stands in the case files that [[test]] names", heading(section));
                Err(self.text.refuse(section, None, message))
            }
            Some(section) => {
                let (takers, commands) = (Reader::of(section), reader.commands());
                let headed = heading(section);
                let message = format!("{headed} is for quadrille {takers}; it is not taken by: {commands}");
                Err(self.text.refuse(section, None, message))
            }
        }
    }

    /// What a correlation takes of it.
    ///
    /// # Errors
    /// A section for another command.
    pub fn correlation(self) -> Result<CaseFile, CaseError> {
        self.taken_by(Reader::Correlation)?;
        Ok(self.case)
    }

    /// What a correlation takes of it; sections for other commands are passed over.
    ///
    /// # Errors
    /// Those of [`Self::parse`].
    pub fn of_correlation(&self) -> Result<CaseFile, CaseError> {
        self.part(Reader::Correlation)
    }

    /// The same with more text behind it.
    ///
    /// # Errors
    /// Those of [`Self::parse`].
    pub fn followed_by(&self, more: &str) -> Result<Self, CaseError> {
        let (text, path) = self.text.parts();
        Self::parse(&format!("{}\n{more}", text.trim_end()), path)
    }

    /// The case with those of its sections alone that `reader` takes.
    ///
    /// # Errors
    /// Those of [`Self::parse`].
    pub(crate) fn part(&self, reader: Reader) -> Result<CaseFile, CaseError> {
        let (text, path) = self.text.parts();
        let table = DeTable::parse(text).map_err(|error| explain(&error, text, path))?;
        let span = table.span();
        let sections = table.into_inner().into_iter().filter(|(section, _)| reader.takes(section.get_ref()));
        case_of(Spanned::new(span, sections.collect()), text, path)
    }
}

fn case_of(table: Spanned<DeTable<'_>>, text: &str, path: &Path) -> Result<CaseFile, CaseError> {
    let case = CaseFile::deserialize(Deserializer::from(table)).map_err(|error| explain(&error, text, path))?;
    Ok(CaseFile { base: path.parent().map(Path::to_owned).unwrap_or_default(), ..case })
}

impl CaseFile {
    /// Its text as TOML. Reading it gives an equal case.
    #[expect(clippy::unreachable, reason = "every value has a form, as the comment says, and fuzz/ tries")]
    pub fn to_toml(&self) -> String {
        // Every value of these structs has a form in TOML: numbers fit in 64 bits, keys are text.
        toml::to_string(self).unwrap_or_else(|error| unreachable!("a case has a form in TOML: {error}"))
    }
}

/// Reads the case file `path`.
///
/// # Errors
/// A file that cannot be read, that is not TOML, or that has a key or a value that a case file does not have.
pub fn read_document(path: &Path) -> Result<CaseDocument, CaseError> {
    let bytes = read_file(path, CaseError::NotFound, CaseError::Io)?;
    let text = text_of(&bytes).map_err(|line| CaseError::NotText { path: path.to_owned(), line })?;
    CaseDocument::parse(text, path)
}

/// Reads what a correlation takes of the case file `path`.
///
/// # Errors
/// As [`read_document`], and a section for another command.
pub fn read_case(path: &Path) -> Result<CaseFile, CaseError> {
    read_document(path)?.correlation()
}

/// The same of the content `text`; `path` gives its folder and stands in messages.
///
/// # Errors
/// As [`read_case`], but nothing is read.
pub fn parse_case(text: &str, path: &Path) -> Result<CaseFile, CaseError> {
    CaseDocument::parse(text, path)?.correlation()
}

/// The text of a case file that says what `case` says. Reading it gives an equal case.
pub fn write_case(case: &CaseFile) -> String {
    let body = case.to_toml();
    format!("# Case file of quadrille. File names are relative to the folder of this file.\n{body}")
}
