//! `quadrille completions` and `quadrille manual`: what a shell and `man` want to know of the commands.

use super::args::{Cli, CompletionsArgs, ManualArgs, grouped};
use super::{Outcome, Result, plural};
use clap::CommandFactory;

/// The program and the beginning of the names of its pages.
const NAME: &str = "quadrille";

/// Writes the completions for a shell to standard output.
pub(super) fn completions(args: &CompletionsArgs) -> Result<Outcome> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), NAME, &mut text);
    print!("{}", String::from_utf8(text)?);
    Ok(Outcome::Fine)
}

/// Writes the pages of `man`, one for each command.
pub(super) fn manual(args: &ManualArgs) -> Result<Outcome> {
    let folder = &args.output;
    let wrong = |error: std::io::Error| format!("{}: cannot be written: {error}", folder.display());
    std::fs::create_dir_all(folder).map_err(wrong)?;
    let mut command = grouped(Cli::command());
    command.build();
    let mut pages = vec![(NAME.to_owned(), command.clone())];
    let visible = command.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "help");
    pages.extend(visible.map(|command| (format!("{NAME}-{}", command.get_name()), command.clone())));
    for (name, command) in &pages {
        let mut text = Vec::new();
        clap_mangen::Man::new(command.clone()).title(name.to_uppercase()).render(&mut text)?;
        std::fs::write(folder.join(format!("{name}.1")), text).map_err(wrong)?;
    }
    eprintln!("{} in {}", plural(pages.len(), "page"), folder.display());
    Ok(Outcome::Fine)
}
