//! The command line.

mod args;
mod devices;
mod paper;
mod paper_text;
mod series;

use args::Command;
use clap::Parser as _;
use std::error::Error;
use std::process::ExitCode;

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// How a command ended.
enum Outcome {
    /// As it should.
    Fine,
    /// Something did not converge.
    Incomplete,
}

/// Runs the command of the arguments; exit status 0 fine, 1 incomplete, 2 not run.
pub fn main() -> ExitCode {
    let outcome = match Command::parse() {
        Command::Devices(args) => devices::run(&args),
        Command::Series(args) => series::run(&args),
        Command::Paper(args) => paper::run(&args),
    };
    match outcome {
        Ok(Outcome::Fine) => ExitCode::SUCCESS,
        Ok(Outcome::Incomplete) => ExitCode::from(1),
        Err(error) => {
            eprintln!("testbed: {error}");
            let mut source = error.source();
            while let Some(cause) = source {
                eprintln!("  {cause}");
                source = cause.source();
            }
            ExitCode::from(2)
        }
    }
}

/// `n` and what there are so many of.
fn plural(n: usize, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

/// A pool of so many threads, or of one per core.
fn pool(threads: Option<usize>) -> Result<rayon::ThreadPool> {
    Ok(rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build()?)
}
