//! What a run has to say: remarks with a code, so that programs and tests need not read English.
//!
//! Every room makes its remarks in one file. What each code means and what to do about it stands in [`Code`].
//! The page `docs/remarks.md` is made from that.

mod code;

pub use code::{Code, Severity, remark_reference};

use serde::{Deserialize, Serialize, Serializer};
use std::collections::BTreeMap;

/// Something that a user should know.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::remark::{About, Code, Remark, Severity};
/// let zone = About::Zone("left".into());
/// let remark = Remark::new(Code::NoiseContradicted, zone, "zone left: the noise is larger").with("ratio", 2.5);
/// assert_eq!((remark.code.name(), remark.severity), ("noise-contradicted", Severity::Warning));
/// assert_eq!(remark.number("ratio"), Some(2.5));
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Remark {
    /// What kind of remark it is.
    pub code: Code,
    /// How grave it is: that of its code.
    pub severity: Severity,
    /// What it is about.
    pub about: About,
    /// The numbers and words of the text by name; names end in the unit.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub values: BTreeMap<String, Value>,
    /// The same as a sentence.
    pub text: String,
}

/// What a remark is about.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum About {
    /// The run as a whole.
    Run,
    /// The reference image.
    Reference,
    /// Frames, by their numbers.
    Frames(Vec<usize>),
    /// A zone, by its name.
    Zone(String),
    /// A crack, by its name.
    Crack(String),
    /// Nodes of the mesh, counted from 0.
    Nodes(Vec<usize>),
    /// Instants of a joint, from 1.
    Instants(Vec<usize>),
    /// A file.
    File(String),
    /// A key of a case file.
    Key(String),
    /// A parameter of a law, of a material or of the geometry.
    Parameter(String),
    /// The load cell, or the load file.
    Load,
    /// The folder of a camera.
    Camera,
    /// The device that does the work.
    Device,
    /// The joint.
    Joint,
    /// The law of the adhesive.
    Law,
    /// The fit.
    Fit,
    /// Tests of a fit of several, by their names.
    Tests(Vec<String>),
}

/// A number or a word.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// A number; one that is not finite is left out of files.
    Number(#[serde(serialize_with = "short")] f64),
    /// A word, or some.
    Text(String),
}

/// Whole numbers without a point.
fn short<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
    let whole = *value as i64;
    if whole as f64 == *value { to.serialize_i64(whole) } else { to.serialize_f64(*value) }
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        Self::Number(value)
    }
}

impl From<usize> for Value {
    fn from(value: usize) -> Self {
        Self::Number(value as f64)
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Value {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl Remark {
    /// A remark without values.
    pub fn new(code: Code, about: About, text: impl Into<String>) -> Self {
        Self { code, severity: code.severity(), about, values: BTreeMap::new(), text: text.into() }
    }

    /// The same with a value. A number that is not finite is left out.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, value: impl Into<Value>) -> Self {
        let value = value.into();
        if !matches!(value, Value::Number(number) if !number.is_finite()) {
            self.values.insert(name.into(), value);
        }
        self
    }

    /// The same as one of the test `name` among several.
    #[must_use]
    pub fn of_test(self, name: &str) -> Self {
        self.after(&format!("test \"{name}\": ")).with("test", name)
    }

    /// The same with `words` before its text.
    #[must_use]
    pub fn after(mut self, words: &str) -> Self {
        self.text.insert_str(0, words);
        self
    }

    /// Whether it is more than a note.
    pub fn is_warning(&self) -> bool {
        self.severity > Severity::Note
    }

    /// The number called `name`.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.values.get(name)? {
            Value::Number(number) => Some(*number),
            Value::Text(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{About, Code, Remark, Severity};
    use std::collections::BTreeSet;

    #[test]
    fn a_remark_is_read_as_it_was_written_and_whole_numbers_have_no_point() {
        let remark = Remark::new(Code::NodesInNoise, About::Frames(vec![2, 4]), "up to 7 nodes")
            .with("nodes", 7_usize)
            .with("share", 0.5)
            .with("unknown", f64::NAN)
            .with("file", "a.tif")
            .of_test("first");
        let text = serde_json::to_string(&remark).unwrap();
        assert_eq!(
            text,
            concat!(
                r#"{"code":"nodes-in-noise","severity":"warning","about":{"frames":[2,4]},"#,
                r#""values":{"file":"a.tif","nodes":7,"share":0.5,"test":"first"},"#,
                r#""text":"test \"first\": up to 7 nodes"}"#
            )
        );
        assert_eq!(serde_json::from_str::<Remark>(&text).unwrap(), remark);
        assert_eq!(serde_json::to_string(&About::Run).unwrap(), r#""run""#);
    }

    #[test]
    fn codes_have_names_of_their_own_that_files_have_too_and_all_is_said_of_them() {
        let names: BTreeSet<&str> = Code::ALL.iter().map(|code| code.name()).collect();
        assert_eq!(names.len(), Code::ALL.len());
        for code in Code::ALL {
            assert_eq!(serde_json::to_value(code).unwrap(), code.name());
            assert!(code.name().chars().all(|c| c.is_ascii_lowercase() || c == '-'), "{}", code.name());
            for text in [code.title(), code.meaning(), code.remedy()] {
                assert!(text.len() > 4 && text.ends_with('.') && !text.contains("  "), "{}: {text}", code.name());
            }
        }
        assert!(Severity::Note < Severity::Warning && Severity::Warning < Severity::Error);
    }
}
