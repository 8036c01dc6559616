//! `quadrille about`: what the program tells of itself.

pub(crate) mod devices;

use crate::cli::args::{About, AboutArgs, Cli, command_reference, grouped, name_flags};
use crate::cli::{Outcome, Result, plural};
use crate::io::case::{case_reference, case_schema};
use crate::mechanics::case_laws;
use crate::remark::remark_reference;
use clap::{Command, CommandFactory};
use std::io::Write;
use std::path::Path;

/// The program and the beginning of the names of its pages.
const NAME: &str = "quadrille";

/// Made by scripts/licences.py.
const THIRD_PARTY: &str = include_str!("../third_party.txt");

pub(crate) fn run(args: &AboutArgs) -> Result<Outcome> {
    let schema = || {
        let mut schema = case_schema(&case_laws());
        name_flags(&mut schema, &Cli::command());
        schema
    };
    let text = match &args.what {
        About::Devices(args) => return devices::run(args),
        About::Manual { output } => return manual(output),
        About::Schema => format!("{:#}\n", schema()).into_bytes(),
        About::Case => case_reference(&schema()).into_bytes(),
        About::Commands => command_reference().into_bytes(),
        About::Remarks => remark_reference().into_bytes(),
        About::Licences => THIRD_PARTY.as_bytes().to_vec(),
        About::Completions { shell } => {
            let mut text = Vec::new();
            clap_complete::generate(*shell, &mut Cli::command(), NAME, &mut text);
            text
        }
    };
    // Whoever reads it may stop reading.
    match std::io::stdout().write_all(&text) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(Outcome::Fine),
    }
}

/// Writes the pages of `man`, one for each command.
fn manual(folder: &Path) -> Result<Outcome> {
    let wrong = |error: std::io::Error| format!("{}: cannot be written: {error}", folder.display());
    std::fs::create_dir_all(folder).map_err(wrong)?;
    let mut command = grouped(Cli::command());
    command.build();
    let mut pages = Vec::new();
    add_pages(&mut pages, NAME, &command);
    for (name, command) in &pages {
        let mut text = Vec::new();
        clap_mangen::Man::new(command.clone()).title(name.to_uppercase()).render(&mut text)?;
        std::fs::write(folder.join(format!("{name}.1")), text).map_err(wrong)?;
    }
    eprintln!("{} in {}", plural(pages.len(), "page"), folder.display());
    Ok(Outcome::Fine)
}

/// The page of `command`, and those of the commands in it, as `quadrille-make-images`.
fn add_pages(pages: &mut Vec<(String, Command)>, name: &str, command: &Command) {
    pages.push((name.to_owned(), command.clone()));
    for inner in command.get_subcommands().filter(|inner| !inner.is_hide_set() && inner.get_name() != "help") {
        add_pages(pages, &format!("{name}-{}", inner.get_name()), inner);
    }
}
