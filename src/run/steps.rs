//! Which steps of a run were done, and with which inputs.

use super::error::{Result, RunError};
use super::folder::RunFolder;
use super::series::Outcome;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The file.
const STEPS: &str = "steps.json";

/// `steps.json`: which steps were done, with which inputs.
pub(super) struct Steps {
    path: PathBuf,
    pub done: serde_json::Map<String, Value>,
}

impl Steps {
    /// The record in `folder`, which is made when it is not there. A folder with other results is refused unless `overwrite`,
    /// which also forgets all steps.
    pub fn open(folder: &Path, overwrite: bool) -> Result<Self> {
        let path = folder.join(STEPS);
        let text = fs::read_to_string(&path).ok();
        RunFolder::open(folder, overwrite || text.is_some())?;
        let read = text.filter(|_| !overwrite).and_then(|text| serde_json::from_str(&text).ok());
        let done = match read {
            Some(Value::Object(done)) => done,
            _ => serde_json::Map::new(),
        };
        let steps = Self { path, done };
        steps.write()?;
        Ok(steps)
    }

    fn write(&self) -> Result<()> {
        let text = format!("{:#}\n", Value::Object(self.done.clone()));
        Ok(fs::write(&self.path, text).map_err(|error| RunError::file(&self.path, "written", error))?)
    }

    pub fn done(&self, step: &str, inputs: &str) -> bool {
        self.done.get(step).is_some_and(|entry| entry["inputs"] == inputs)
    }

    pub fn forget(&mut self, step: &str) -> Result<()> {
        self.done.remove(step);
        self.write()
    }

    /// Notes that a step is begun, and tells whether it has been before with the same inputs: what is there of it is good.
    pub fn begin(&mut self, step: &str, inputs: &str) -> Result<bool> {
        let before = self.done.get(step).is_some_and(|entry| entry["inputs"] == inputs || entry["begun"] == inputs);
        self.done.insert(step.to_owned(), json!({ "begun": inputs }));
        self.write()?;
        Ok(before)
    }

    pub fn note(&mut self, step: &str, inputs: &str, begin: Instant) -> Result<()> {
        self.note_with(step, inputs, begin, Outcome::Fine)
    }

    pub fn note_with(&mut self, step: &str, inputs: &str, begin: Instant, outcome: Outcome) -> Result<()> {
        let entry = json!({
            "inputs": inputs,
            "seconds": begin.elapsed().as_secs_f64(),
            "complete": outcome == Outcome::Fine,
            "quadrille": env!("CARGO_PKG_VERSION"),
        });
        self.done.insert(step.to_owned(), entry);
        self.write()
    }

    /// What a step that was done came to.
    pub fn outcome(&self, step: &str) -> Outcome {
        let complete = self.done.get(step).is_some_and(|entry| entry["complete"] == true);
        if complete { Outcome::Fine } else { Outcome::Incomplete }
    }
}
