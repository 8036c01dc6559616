//! Colour for what has to be seen, on a terminal only.

use crate::cli::args::ColorChoice;
use crate::field::Status;
use crate::remark::{Remark, Severity};
use std::io::IsTerminal;

/// Whether words are coloured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Paint(bool);

/// What stands in front of a warning.
pub(crate) const WARNING: &str = "warning: ";

const GREEN: u8 = 32;
const YELLOW: u8 = 33;
const RED: u8 = 31;

impl Paint {
    pub const PLAIN: Self = Self(false);

    /// For standard error, where statuses are said: as `choice` has it; by itself on a terminal, unless `NO_COLOR` is
    /// set.
    pub fn of(choice: ColorChoice) -> Self {
        Self::on(choice, std::io::stderr().is_terminal())
    }

    pub fn of_stdout(choice: ColorChoice) -> Self {
        Self::on(choice, std::io::stdout().is_terminal())
    }

    fn on(choice: ColorChoice, terminal: bool) -> Self {
        let refused = || std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        Self(match choice {
            ColorChoice::Always => true,
            ColorChoice::Never => false,
            ColorChoice::Auto => terminal && !refused(),
        })
    }

    fn with(self, code: u8, text: &str) -> String {
        // Blanks around stay as they are: columns keep their width.
        let word = text.trim_end();
        match self.0 && !word.is_empty() {
            true => format!("\x1b[{code}m{word}\x1b[0m{}", &text[word.len()..]),
            false => text.to_owned(),
        }
    }

    /// `text` about a frame of this status.
    pub fn status(self, status: Status, text: &str) -> String {
        match status {
            Status::Converged => self.good(text),
            Status::IterationLimit | Status::PartlyLost => self.doubtful(text),
            _ => self.bad(text),
        }
    }

    /// What is as it should be.
    pub fn good(self, text: &str) -> String {
        self.with(GREEN, text)
    }

    /// What wants a look.
    pub fn doubtful(self, text: &str) -> String {
        self.with(YELLOW, text)
    }

    /// What is no result.
    pub fn bad(self, text: &str) -> String {
        self.with(RED, text)
    }

    /// A remark as a line, with a word in front of a warning.
    pub fn remark(self, remark: &Remark) -> String {
        match remark.severity {
            Severity::Warning => format!("{}{}", self.doubtful(WARNING), remark.text),
            _ => remark.text.clone(),
        }
    }
}
