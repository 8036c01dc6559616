//! Records as objects of Python, and options of Python as case files.

use crate::errors::{raise, raised};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use quadrille::io::case::{CaseFile, parse_case};
use serde_json::Value;
use std::path::Path;

/// `value` as None, bool, int, float, str, list or dict.
pub fn to_python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Null => py.None().into_bound(py),
        Value::Bool(value) => value.into_pyobject(py)?.to_owned().into_any(),
        Value::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(whole), _) => whole.into_pyobject(py)?.into_any(),
            (None, Some(whole)) => whole.into_pyobject(py)?.into_any(),
            (None, None) => number.as_f64().unwrap_or(f64::NAN).into_pyobject(py)?.into_any(),
        },
        Value::String(text) => text.into_pyobject(py)?.into_any(),
        Value::Array(items) => {
            let items = items.iter().map(|item| to_python(py, item)).collect::<PyResult<Vec<_>>>()?;
            PyList::new(py, items)?.into_any()
        }
        Value::Object(items) => {
            let dict = PyDict::new(py);
            for (key, value) in items {
                dict.set_item(key, to_python(py, value)?)?;
            }
            dict.into_any()
        }
    })
}

/// A record of the library as a dict.
pub fn record<'py, T: serde::Serialize>(py: Python<'py>, record: &T) -> PyResult<Bound<'py, PyAny>> {
    let value = serde_json::to_value(record).map_err(|error| raise("QuadrilleError", error.to_string()))?;
    to_python(py, &value)
}

/// The case that `json` holds, an object with the sections of a case file; `path` gives its folder and stands in
/// messages.
pub fn case_of(json: &str, path: &Path) -> PyResult<CaseFile> {
    let wrong = |what: String| raise("OptionError", what);
    let value: Value = serde_json::from_str(json).map_err(|error| wrong(error.to_string()))?;
    let text = toml::to_string(&value).map_err(|error| wrong(format!("the options are no case: {error}")))?;
    parse_case(&text, path).map_err(raised)
}
