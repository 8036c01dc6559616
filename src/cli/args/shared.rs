//! Flags that several commands share.

use super::super::Result;
use clap::Args;
use rayon::ThreadPool;
use std::path::PathBuf;

/// How many threads do the work.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct Threads {
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
}

impl Threads {
    /// A pool of so many threads, or of one per core.
    pub fn pool(self) -> Result<ThreadPool> {
        super::super::pool(self.threads)
    }
}

/// Whether anything is said.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct Quiet {
    /// Only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Where results go.
#[derive(Debug, Args)]
pub struct Results {
    /// Folder for the results; made when it is not there.
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace the results of an earlier run in the output folder.
    #[arg(long)]
    pub overwrite: bool,
}
