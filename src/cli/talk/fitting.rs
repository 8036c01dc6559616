//! What a user sees of a fit while it runs, on stderr.

use crate::cli::talk::Talk;
use crate::identify::FitProgress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Map, Value, json};
use std::io::IsTerminal;
use std::time::Instant;

/// Progress of a fit: one line that changes on a terminal, else a plain line now and then.
pub(crate) struct Fitting {
    talk: Talk,
    bar: ProgressBar,
    last: Instant,
    /// The last point that the minimiser tried, in words.
    tried: String,
}

impl Fitting {
    pub fn new(talk: Talk) -> Self {
        let bar = ProgressBar::new_spinner();
        if matches!(talk, Talk::Quiet | Talk::Json) || !std::io::stderr().is_terminal() {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        bar.set_style(
            ProgressStyle::with_template("{spinner} {wide_msg}").unwrap_or_else(|_| ProgressStyle::default_spinner()),
        );
        Self { talk, bar, last: Instant::now(), tried: String::new() }
    }

    /// Shows where the fit is.
    pub fn take(&mut self, at: &FitProgress) {
        if at.instant.is_none() {
            self.tried = describe(at);
        }
        let due = self.last.elapsed() >= self.talk.every();
        if !self.bar.is_hidden() {
            self.bar.set_message(self.line(at));
            self.bar.tick();
        } else if due && self.talk == Talk::Json {
            eprintln!("{}", record(at));
        } else if due && self.talk != Talk::Quiet {
            eprintln!("{}", self.line(at));
        }
        if due {
            self.last = Instant::now();
        }
    }

    /// Does something while the line is away.
    pub fn suspend<T>(&self, something: impl FnOnce() -> T) -> T {
        self.bar.suspend(something)
    }

    pub fn done(&self) {
        self.bar.finish_and_clear();
    }

    fn line(&self, at: &FitProgress) -> String {
        let runs = if at.evaluation == 0 { String::new() } else { format!(" {} forward runs,", at.evaluation) };
        let instant = at.instant.map_or(String::new(), |k| format!(" one at instant {k} of {},", at.n_instants));
        let tried = if self.tried.is_empty() { String::new() } else { format!("; {}", self.tried) };
        format!("{}:{runs}{instant} {:.0} s{tried}", at.doing, at.seconds)
    }
}

/// What was tried last.
fn describe(at: &FitProgress) -> String {
    let values: Vec<String> = at.parameters.iter().map(|(name, value)| format!("{name} {value:.4}")).collect();
    let omega = at.omega.map_or("no solution".to_owned(), |omega| format!("omega {omega:.4e}"));
    format!("{omega} at {}", values.join(", "))
}

fn record(at: &FitProgress) -> Value {
    let parameters: Map<String, Value> = at.parameters.iter().map(|(name, v)| ((*name).to_owned(), json!(v))).collect();
    json!({ "fit": {
        "doing": at.doing,
        "evaluation": at.evaluation,
        "instant": at.instant,
        "omega": at.omega,
        "parameters": parameters,
        "seconds": at.seconds,
    }})
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_what_is_done_how_long_and_what_was_tried_last() {
        let mut fitting = Fitting::new(Talk::Normal);
        let tried = FitProgress {
            doing: "fit",
            evaluation: 3,
            omega: Some(28426.87),
            parameters: vec![("phi_n", 0.98952)],
            seconds: 4.2,
            ..FitProgress::default()
        };
        fitting.take(&tried);
        let next = FitProgress { instant: Some(7), n_instants: 19, omega: None, parameters: Vec::new(), ..tried };
        let line = fitting.line(&next);
        assert_eq!(line, "fit: 3 forward runs, one at instant 7 of 19, 4 s; omega 2.8427e4 at phi_n 0.9895");
        assert_eq!(record(&next)["fit"]["instant"], 7);
    }
}
