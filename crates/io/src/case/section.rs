//! Sections of a case, laid over each other key by key.

use super::schema::schema_of;
use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

/// `section` with what `flags` say over it. A switch that is off says nothing.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::case::{CaseImages, over};
/// let file = CaseImages { page: Some(1), pixel_size_mm: Some(0.1), ..CaseImages::default() };
/// let flags = CaseImages { page: Some(2), ..CaseImages::default() };
/// assert_eq!(over(&flags, &file)?, CaseImages { page: Some(2), ..file });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A value that a case file may not hold.
pub fn over<T: Serialize + DeserializeOwned>(flags: &T, section: &T) -> Result<T, String> {
    let mut keys = keys_of(section)?;
    keys.extend(keys_of(flags)?.into_iter().filter(|(_, value)| *value != Value::Boolean(false)));
    keys.try_into().map_err(in_words)
}

/// `section` with the defaults of its schema, as a run records it. A default that the schema calls `x-implied` is
/// recorded by its absence.
///
/// # Errors
/// A value that a case file may not hold.
pub fn complete<T: Serialize + DeserializeOwned + JsonSchema>(section: &T) -> Result<T, String> {
    let mut keys = keys_of(section)?;
    for (key, about) in schema_of::<T>().get("properties").and_then(|keys| keys.as_object()).into_iter().flatten() {
        let Some(default) = about.get("default") else { continue };
        let default = Value::try_from(default).map_err(in_words)?;
        if about.get("x-implied").is_none() {
            keys.entry(key).or_insert(default);
        } else if keys.get(key) == Some(&default) {
            keys.remove(key);
        }
    }
    keys.try_into().map_err(in_words)
}

fn keys_of<T: Serialize>(section: &T) -> Result<Table, String> {
    Table::try_from(section).map_err(in_words)
}

fn in_words(error: impl std::fmt::Display) -> String {
    error.to_string().trim_end().to_owned()
}
