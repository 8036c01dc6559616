//! The command line: arguments in, files and an exit status out.

// What is said must not end what is done: std's macros panic where nobody can listen (a closed pipe, a full disk).
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::cli::talk::voice::to_people(format_args!($($text)*)) };
}
macro_rules! println {
    () => { $crate::cli::talk::voice::result(format_args!("\n")) };
    ($($text:tt)*) => { $crate::cli::talk::voice::result(format_args!("{}\n", format_args!($($text)*))) };
}
macro_rules! print {
    ($($text:tt)*) => { $crate::cli::talk::voice::result(format_args!($($text)*)) };
}

mod about;
mod allocator;
mod args;
mod identify;
mod look;
mod make;
mod measure;
mod signals;
mod studio;
mod talk;

use crate::report::Look;
use crate::run::words::{absolute, chain, file_name, plural};
use crate::run::{Outcome, write_file};
pub(crate) use about::devices;
pub use allocator::Allocator;
use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches};
use std::error::Error;
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;
use talk::{Paint, wrong_words};

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// Runs the command line and gives the exit status: 0 fine, 1 ran but not all converged, 2 could not run,
/// 130 stopped.
pub fn main() -> ExitCode {
    // Here and not below: they are no business of a process that is another program, and its threads may run.
    allocator::keep_memory();
    devices::quiet_drivers();
    ExitCode::from(main_of(std::env::args_os()))
}

/// The same with these words, the first of which names the program; of a process that is another program. Help and
/// version end it.
pub fn main_of(words: impl IntoIterator<Item = OsString>) -> u8 {
    signals::end_where_memory_ends();
    let arguments = args::join_every(words);
    let command = args::grouped(args::Cli::command());
    let parsed = command.clone().try_get_matches_from(&arguments);
    let cli = match parsed.and_then(|matches| args::Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(asked) if asked.kind() == ErrorKind::DisplayHelp && arguments.iter().any(|word| word == "-h") => {
            let (command, name) = wrong_words::command_of(command, &arguments);
            print!("{}", args::short_help(&command, &name));
            return 0;
        }
        // Help and version are what was asked for; clap prints them.
        Err(asked) if !asked.use_stderr() || asked.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            asked.exit()
        }
        Err(wrong) => {
            eprintln!("quadrille: {}", wrong_words::in_words(&wrong, &arguments));
            return 2;
        }
    };
    // A process may run several commands: none draws for what the one before was asked to.
    Look::Screen.choose();
    let paint = Paint::of(cli.color);
    let outcome = match cli.command {
        args::Command::Correlate(args) => measure::correlate::run(&args, paint),
        args::Command::Watch(args) => measure::watch::run(&args, paint),
        args::Command::Calibrate(args) => measure::calibrate::run(&args, paint),
        args::Command::Status(args) => measure::status::run(&args, Paint::of_stdout(cli.color)),
        args::Command::Slurm(args) => measure::slurm::run(&args),
        args::Command::Export(args) => look::export::run(&args),
        args::Command::Compare(args) => look::compare::run(&args),
        args::Command::Import(args) => look::import::run(&args),
        args::Command::Probe(args) => look::probe::run(&args),
        args::Command::Figures(args) => look::figures::run(&args),
        args::Command::View(args) => look::view::run(&args),
        args::Command::Studio(args) => studio::run(&args),
        args::Command::Demo(args) => make::demo::run(&args, paint),
        args::Command::Metrology(args) => measure::metrology::run(&args),
        args::Command::Simulate(args) => identify::simulate::run(&args, paint),
        args::Command::Identify(args) => identify::fit::run(&args, paint),
        args::Command::Run(args) => identify::case::run(&args, paint),
        args::Command::Reduce(args) => identify::reduce::run(&args, paint),
        args::Command::Make(args) => run_make(&args),
        args::Command::About(args) => about::run(&args),
    };
    match outcome {
        Ok(Outcome::Fine) => 0,
        Ok(Outcome::Incomplete) => 1,
        Ok(Outcome::Stopped) => signals::STOPPED,
        Err(error) => {
            eprintln!("quadrille: {}", chain(error.as_ref()));
            2
        }
    }
}

fn run_make(args: &args::MakeArgs) -> Result<Outcome> {
    match &args.what {
        args::Make::Images(args) => make::images::run(args),
        args::Make::VirtualTest(args) => make::virtual_test::run(args),
        args::Make::Specimen(args) => make::specimen::run(args),
        args::Make::Page(args) => make::page::run(args),
    }
}

/// Whether `line`, the name of the program and its arguments, is a command line of quadrille. Nothing is run.
///
/// # Errors
/// What the program says of one that is not.
pub fn check_line(line: impl IntoIterator<Item = OsString>) -> std::result::Result<(), String> {
    let arguments = args::join_every(line);
    match args::grouped(args::Cli::command()).try_get_matches_from(&arguments) {
        Err(wrong) if wrong.use_stderr() => Err(wrong_words::in_words(&wrong, &arguments)),
        _ => Ok(()),
    }
}

/// Writes a file where none of that name is, or `overwrite` allows it.
fn write_new(path: &Path, content: &str, overwrite: bool) -> Result<()> {
    if path.exists() && !overwrite {
        return Err(format!("{}: is there already; replace it with --overwrite", path.display()).into());
    }
    Ok(write_file(path, content)?)
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
        _ => {
            let threads = || rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(cores));
            // The store asks for those of the whole process, which would be made then, and end the program where the
            // system gives none. In a process that has them from before (Python) they stay.
            if let Err(error) = threads().build_global()
                && error.source().is_some()
            {
                return Err(error.into());
            }
            Ok(threads().build()?)
        }
    }
}
