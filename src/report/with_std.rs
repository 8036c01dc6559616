//! A number with its standard uncertainty.

use super::words::significant;
use crate::field::Value;
use serde::Serialize;

/// A number with its standard uncertainty, as it is written.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WithStd {
    /// The number.
    pub value: f64,
    /// Its standard uncertainty.
    pub std: f64,
}

impl WithStd {
    pub(super) fn in_words(self) -> String {
        let value = significant(self.value, 4);
        // Nothing is exact: nobody has said how uncertain load and displacement are.
        if self.std > 1e-12 * self.value.abs() {
            format!("{value} \u{b1} {}", significant(self.std, 2))
        } else {
            format!("{value} (no uncertainty is stated)")
        }
    }
}

impl WithStd {
    /// `of`, with a relative uncertainty more that it shares with others.
    pub(crate) fn with_common(of: Value, relative: f64) -> Self {
        Self { value: of.value, std: of.sigma.hypot(relative * of.value) }
    }
}

impl From<Value> for WithStd {
    fn from(Value { value, sigma }: Value) -> Self {
        Self { value, std: sigma }
    }
}
