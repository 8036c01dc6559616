//! Which steps of a run were done, and with which inputs.

use crate::run::folder::RunFolder;
use crate::run::plan::Outcome;
use crate::run::words::{Result, RunError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

const STEPS: &str = "steps.json";

/// A step that was begun, or done.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Step {
    /// Hash of what it was begun with, while it is not done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    begun: Option<String>,
    /// Whether all converged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    complete: Option<bool>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inputs: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    quadrille: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}

/// `steps.json`: which steps were done, with which inputs.
pub(crate) struct Steps {
    path: PathBuf,
    pub done: BTreeMap<String, Step>,
}

impl Steps {
    /// The record in `folder`, which is made when it is not there. A folder with other results is refused unless
    /// `overwrite`, which also forgets all steps.
    pub fn open(folder: &Path, overwrite: bool) -> Result<Self> {
        let path = folder.join(STEPS);
        let text = fs::read_to_string(&path).ok();
        RunFolder::open(folder, overwrite || text.is_some())?;
        let read = text.filter(|_| !overwrite).and_then(|text| serde_json::from_str(&text).ok());
        let steps = Self { path, done: read.unwrap_or_default() };
        steps.write()?;
        Ok(steps)
    }

    fn write(&self) -> Result<()> {
        let text = serde_json::to_string_pretty(&self.done).map_err(std::io::Error::other);
        let written = text.and_then(|text| fs::write(&self.path, text + "\n"));
        written.map_err(|error| RunError::file(&self.path, "written", error))
    }

    pub fn is_done(&self, step: &str, inputs: &str) -> bool {
        self.done.get(step).is_some_and(|step| step.inputs.as_deref() == Some(inputs))
    }

    pub fn forget(&mut self, step: &str) -> Result<()> {
        self.done.remove(step);
        self.write()
    }

    /// Notes that a step is begun, and tells whether it has been before with the same inputs: what is there of it is
    /// good.
    pub fn begin(&mut self, step: &str, inputs: &str) -> Result<bool> {
        let before = self
            .done
            .get(step)
            .is_some_and(|step| [&step.inputs, &step.begun].into_iter().any(|known| known.as_deref() == Some(inputs)));
        self.done.insert(step.to_owned(), Step { begun: Some(inputs.to_owned()), ..Step::default() });
        self.write()?;
        Ok(before)
    }

    pub fn note(&mut self, step: &str, inputs: &str, begin: Instant, outcome: Outcome) -> Result<()> {
        let done = Step {
            begun: None,
            complete: Some(outcome == Outcome::Fine),
            inputs: Some(inputs.to_owned()),
            quadrille: Some(env!("CARGO_PKG_VERSION").to_owned()),
            seconds: Some(begin.elapsed().as_secs_f64()),
        };
        self.done.insert(step.to_owned(), done);
        self.write()
    }

    pub fn outcome(&self, step: &str) -> Outcome {
        let complete = self.done.get(step).is_some_and(|step| step.complete == Some(true));
        if complete { Outcome::Fine } else { Outcome::Incomplete }
    }
}
