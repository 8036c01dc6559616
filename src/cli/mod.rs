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
mod kept;
mod lock;
mod metrology;
mod output;
mod paper;
mod plan;
mod probe;
mod progress;
mod quantities;
mod record;
mod reference;
mod restart;
mod run;
mod run_folder;
mod run_toml;
mod series;
mod shard;
mod simulate;
mod slurm;
mod status;
mod stop;
mod synth;
mod virtual_test;
mod watch;
mod zones;

use clap::Parser;
use clap::error::ErrorKind;
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

/// What a command came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// Everything asked for is there: exit status 0.
    Fine,
    /// It ran, but some frame did not converge: exit status 1.
    Incomplete,
    /// It was asked to stop before it was done: exit status 130.
    Stopped,
}

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
        args::Command::Bench(args) => bench::run(&args),
        args::Command::Simulate(args) => simulate::run(&args),
        args::Command::Identify(args) => identify::run(&args),
        args::Command::Sweep(args) => identify::run_sweep(&args),
        args::Command::Virtual(args) => virtual_test::run(&args),
        args::Command::Run(args) => run::run(&args),
        args::Command::Paper(args) => paper::run(&args),
    };
    match outcome {
        Ok(Outcome::Fine) => ExitCode::SUCCESS,
        Ok(Outcome::Incomplete) => ExitCode::from(1),
        Ok(Outcome::Stopped) => ExitCode::from(stop::STOPPED),
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

/// A count with its noun.
fn plural(n: usize, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
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

/// A path that holds from any folder.
fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

/// An error and its causes on one line.
fn chain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        // Many errors already repeat their cause.
        if !text.contains(&more) {
            text.push_str(": ");
            text.push_str(&more);
        }
        cause = error.source();
    }
    text
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
