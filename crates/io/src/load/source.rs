//! The text of a load file.

use super::error::LoadError;
use super::remarks;
use crate::case::Decimal;
use crate::remark::Remark;
use crate::text::{decoded, read_file};
use std::path::Path;

/// A load file before it is taken apart.
pub(super) struct Source {
    pub text: String,
    /// The decimal mark that is asked for.
    pub decimal: Option<Decimal>,
    /// What there is to say of its text.
    pub remarks: Vec<Remark>,
}

impl Source {
    /// Reads the file `path`, whatever its encoding.
    pub fn read(path: &Path, decimal: Option<Decimal>) -> Result<Self, LoadError> {
        let bytes = read_file(path, LoadError::NotFound, LoadError::Io)?;
        let (text, encoding) = decoded(&bytes).map_err(|line| LoadError::NotText { path: path.to_owned(), line })?;
        Ok(Self { text, decimal, remarks: encoding.map(remarks::encoding).into_iter().collect() })
    }

    /// A text that is there.
    pub fn of(text: &str) -> Self {
        Self { text: text.to_owned(), decimal: None, remarks: Vec::new() }
    }
}
