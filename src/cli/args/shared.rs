//! Flags that several commands share.

use super::super::Result;
use super::words::{count, positive_seconds};
use crate::io::case::CaseFit;
use crate::report::Look;
use clap::Args;
use rayon::ThreadPool;
use std::path::PathBuf;

/// How many threads do the work.
#[derive(Debug, Clone, Copy, Default, Args)]
#[command(next_help_heading = "Machine")]
pub struct Threads {
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
}

impl Threads {
    pub fn pool(self) -> Result<ThreadPool> {
        crate::cli::pool(self.threads)
    }
}

/// Whether anything is said.
#[derive(Debug, Clone, Copy, Default, Args)]
#[command(next_help_heading = "Messages")]
pub struct Quiet {
    /// Only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

impl Quiet {
    /// Says something on stderr, unless only errors are wanted.
    pub fn say(self, what: std::fmt::Arguments<'_>) {
        if !self.quiet {
            eprintln!("{what}");
        }
    }
}

/// What figures are made for.
#[derive(Debug, Clone, Copy, Default, Args)]
#[command(next_help_heading = "Output")]
pub struct Drawn {
    /// What figures are made for: screen; paper (84 mm wide, letters of 8 pt, no title; notes in the SVG, warnings beside
    /// it); slide (large letters, no notes).
    #[arg(long, value_name = "screen|paper|slide", default_value = "screen")]
    style: Look,
}

impl Drawn {
    /// Draws all figures of this process so.
    pub fn choose(self) {
        self.style.choose();
    }
}

/// Where results go.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output")]
pub struct Results {
    /// Folder for the results; made when it is not there.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace the results of an earlier run in the output folder.
    #[arg(long)]
    pub overwrite: bool,
}

/// How far a fit may go; over what the case says.
#[derive(Debug, Clone, Copy, Default, Args)]
#[command(next_help_heading = "Fit")]
pub struct FitLimits {
    /// End the fit after this time at the best point so far: the result says so. Default: [fit] max_seconds, or no
    /// limit.
    #[arg(long, value_name = "SECONDS", value_parser = positive_seconds, allow_hyphen_values = true)]
    pub max_seconds: Option<f64>,
    /// End it after this many forward runs from one start. Default: [fit] max_evaluations, or 100.
    #[arg(long, value_name = "N", value_parser = count, allow_hyphen_values = true)]
    pub max_evaluations: Option<usize>,
}

impl FitLimits {
    /// Puts them over those of a case.
    pub fn over(self, fit: &mut CaseFit) {
        fit.max_seconds = self.max_seconds.or(fit.max_seconds);
        fit.max_evaluations = self.max_evaluations.or(fit.max_evaluations);
    }
}
