//! The command line: arguments in, files and an exit status out.

mod args;
mod bench;
mod bench_series;
mod correlate;
mod demo;
mod devices;
mod export;
mod figures;
mod frames;
mod identify;
mod metrology;
mod paper;
mod paper_text;
mod probe;
mod progress;
mod run;
mod schema;
mod signals;
mod simulate;
mod slurm;
mod status;
mod synth;
mod virtual_test;
mod watch;

use crate::run::Outcome;
use crate::run::text::{absolute, chain, plural};
use args::{BenchArgs, BenchWhat};
use clap::Parser;
use clap::error::ErrorKind;
use std::error::Error;
use std::process::ExitCode;

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// Runs the command line and gives the exit status: 0 fine, 1 ran but not all converged, 2 could not run,
/// 130 stopped.
pub fn main() -> ExitCode {
    devices::quiet_drivers();
    let cli = match args::Cli::try_parse_from(args::joined(std::env::args_os())) {
        Ok(cli) => cli,
        // Help and version are what was asked for; clap prints them.
        Err(asked) if !asked.use_stderr() || asked.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            asked.exit()
        }
        Err(wrong) => {
            eprintln!("quadrille: {}", one_line(&wrong.render().to_string()));
            return ExitCode::from(2);
        }
    };
    let outcome = match cli.command {
        args::Command::Correlate(args) => correlate::run(&args),
        args::Command::Watch(args) => watch::run(&args),
        args::Command::Status(args) => status::run(&args),
        args::Command::Slurm(args) => slurm::run(&args),
        args::Command::Export(args) => export::run(&args),
        args::Command::Probe(args) => probe::run(&args),
        args::Command::Figures(args) => figures::run(&args),
        args::Command::Synth(args) => synth::run(&args),
        args::Command::Demo(args) => demo::run(&args),
        args::Command::Metrology(args) => metrology::run(&args),
        args::Command::Devices(args) => devices::run(&args),
        args::Command::Bench(BenchArgs { what: Some(BenchWhat::Series(args)), .. }) => bench_series::run(&args),
        args::Command::Bench(args) => bench::run(&args),
        args::Command::Simulate(args) => simulate::run(&args),
        args::Command::Identify(args) => identify::run(&args),
        args::Command::Sweep(args) => identify::run_sweep(&args),
        args::Command::Virtual(args) => virtual_test::run(&args),
        args::Command::Run(args) => run::run(&args),
        args::Command::Schema(args) => schema::run(&args),
        args::Command::Paper(args) => paper::run(&args),
    };
    match outcome {
        Ok(Outcome::Fine) => ExitCode::SUCCESS,
        Ok(Outcome::Incomplete) => ExitCode::from(1),
        Ok(Outcome::Stopped) => ExitCode::from(signals::STOPPED),
        Err(error) => {
            eprintln!("quadrille: {}", chain(error.as_ref()));
            ExitCode::from(2)
        }
    }
}

/// What clap says about wrong arguments, on one line: the fault and its tip, without the usage.
fn one_line(message: &str) -> String {
    let said = message.trim_start_matches("error: ").lines().map(str::trim);
    let said = said.take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more information"));
    let said: Vec<_> = said.filter(|line| !line.is_empty()).collect();
    format!("{}; more with --help", said.join(" ").replace(" tip: ", "; "))
}

/// The list with each item at its first place only.
fn without_doubles<T: Copy + PartialEq>(list: &[T]) -> Vec<T> {
    let mut kept: Vec<T> = Vec::with_capacity(list.len());
    for item in list {
        if !kept.contains(item) {
            kept.push(*item);
        }
    }
    kept
}

/// A pool of `threads` threads, or of one per core.
fn pool(threads: Option<usize>) -> Result<rayon::ThreadPool> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    match threads {
        Some(0) => Err("--threads is 0; give at least 1, or leave it out for all cores".into()),
        Some(n) if n > 1024 => Err(format!("--threads is {n}; this machine has {cores} cores").into()),
        _ => Ok(rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(cores)).build()?),
    }
}
