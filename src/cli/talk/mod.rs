//! How a command speaks: how much, in what colour, of progress and results, and of words that it does not understand.

mod fitting;
mod lines;
mod paint;
mod progress;
mod results;
pub(crate) mod voice;
pub(crate) mod wrong_words;

pub(crate) use fitting::Fitting;
pub(crate) use lines::{WIDTH, wrapped};
pub(crate) use paint::{Paint, WARNING};
pub(crate) use progress::Progress;

use crate::cli::args::ProgressKind;
use std::time::Duration;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Talk {
    Quiet,
    Normal,
    Verbose,
    /// One JSON object a line.
    Json,
}

impl Talk {
    /// Time between two plain lines, or two lines for programs.
    pub fn every(self) -> Duration {
        Duration::from_secs(if self == Self::Json { 1 } else { 5 })
    }

    /// What the flags of a command without --verbose ask for.
    pub fn of(kind: ProgressKind, quiet: bool) -> Self {
        match (quiet, kind) {
            (true, _) => Self::Quiet,
            (_, ProgressKind::Json) => Self::Json,
            _ => Self::Normal,
        }
    }
}
