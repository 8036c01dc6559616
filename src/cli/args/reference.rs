//! The reference of all commands, as Markdown: docs/commands.md.

use super::groups::headings;
use super::{Cli, grouped};
use clap::{Arg, Command, CommandFactory};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Options that every command has: told once, at the top.
const EVERYWHERE: [&str; 3] = ["help", "version", "color"];

const HEAD: &str = "# Commands

Every command with its options, as `quadrille COMMAND --help` shows them. This page is made by `quadrille about commands`; a test
compares the two. Lists of files may be quoted globs (`'frames/*.tif'`). The same can be said in a case file: [case files](case.md).
";

/// Every command with its options.
pub fn command_reference() -> String {
    let mut command = grouped(Cli::command());
    command.build();
    let mut text = format!("{HEAD}\n| command | what it does |\n| --- | --- |\n");
    let (mut sections, mut known) = (String::new(), Known::new());
    for inner in inner(&command) {
        let name = format!("quadrille {}", inner.get_name());
        let about = inner.get_about().map(ToString::to_string).unwrap_or_default();
        let _ = writeln!(text, "| [`{name}`](#{}) | {} |", name.replace(' ', "-"), cell(&about));
        section(&mut sections, &mut known, inner, &name);
    }
    text.push_str("\nEvery command takes these as well:\n\n");
    let all: Vec<&Arg> = command.get_arguments().filter(|arg| EVERYWHERE.contains(&arg.get_id().as_str())).collect();
    table(&mut text, &all);
    text + &sections
}

/// The commands of `command`, in the order of its help.
fn inner(command: &Command) -> impl Iterator<Item = &Command> {
    command.get_subcommands().filter(|inner| inner.get_name() != "help" && !inner.is_hide_set())
}

/// Rows of options, and the first command that has each.
type Known = BTreeMap<String, String>;

fn section(text: &mut String, known: &mut Known, command: &Command, name: &str) {
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let _ = write!(text, "\n## `{name}`\n\n{}\n", point(&about));
    let (outer, _) = name.rsplit_once(' ').unwrap_or_default();
    let aliases: Vec<String> = command.get_visible_aliases().map(|alias| format!("`{outer} {alias}`")).collect();
    if !aliases.is_empty() {
        let _ = write!(text, "\nAlso {}.\n", aliases.join(", "));
    }
    let shown = |arg: &&Arg| !arg.is_hide_set() && !EVERYWHERE.contains(&arg.get_id().as_str());
    let arguments: Vec<&Arg> = command.get_arguments().filter(shown).collect();
    // An option that an earlier command has with the same words is named, not described again.
    let mut earlier: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut arguments = arguments;
    arguments.retain(|arg| match known.get(&row(arg)) {
        Some(first) if !arg.is_positional() => {
            earlier.entry(first.clone()).or_default().push(format!("`{}`", spelled(arg)));
            false
        }
        _ => {
            known.insert(row(arg), name.to_owned());
            true
        }
    });
    for heading in headings(&arguments) {
        let of: Vec<&Arg> = arguments.iter().copied().filter(|arg| arg.get_help_heading() == heading).collect();
        if let (Some(heading), false) = (heading, of.is_empty()) {
            let _ = write!(text, "\n**{heading}**\n");
        }
        if !of.is_empty() {
            text.push('\n');
            table(text, &of);
        }
    }
    for (first, options) in earlier {
        let _ = write!(text, "\nAs of [`{first}`](#{}): {}.\n", first.replace(' ', "-"), options.join(", "));
    }
    if let Some(after) = command.get_after_help() {
        let _ = write!(text, "\n```text\n{}\n```\n", after.to_string().trim_end());
    }
    for inner in inner(command) {
        section(text, known, inner, &format!("{name} {}", inner.get_name()));
    }
}

fn table(text: &mut String, arguments: &[&Arg]) {
    text.push_str("| option | value | what it is |\n| --- | --- | --- |\n");
    arguments.iter().for_each(|arg| text.push_str(&row(arg)));
}

/// The row of an option: how it is spelled, what it takes, what it is.
fn row(arg: &Arg) -> String {
    let takes = arg.get_action().takes_values();
    let names =
        || arg.get_value_names().unwrap_or_default().iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
    let (option, value) = match (arg.is_positional(), takes) {
        (true, _) => (names(), String::new()),
        (false, true) => (spelled(arg), names()),
        (false, false) => (spelled(arg), String::new()),
    };
    let code = |word: String| if word.is_empty() { word } else { format!("`{}`", cell(&word)) };
    format!("| {} | {} | {} |\n", code(option), code(value), cell(&describe(arg, takes)))
}

/// `-q, --quiet`.
fn spelled(arg: &Arg) -> String {
    let short = arg.get_short().map(|short| format!("-{short}"));
    let long = arg.get_long().map(|long| format!("--{long}"));
    short.into_iter().chain(long).collect::<Vec<_>>().join(", ")
}

/// What an argument is: its help, whether it has to be there, its choices, its default, its variable.
fn describe(arg: &Arg, takes: bool) -> String {
    let mut said = vec![point(&arg.get_help().map(ToString::to_string).unwrap_or_default())];
    if arg.is_required_set() {
        said.push("Required.".to_owned());
    }
    let choices = if takes { arg.get_possible_values() } else { Vec::new() };
    for choice in choices.iter().filter(|choice| !choice.is_hide_set()) {
        let help = choice.get_help().map(ToString::to_string).unwrap_or_default();
        said.push(if help.is_empty() {
            format!("`{}`.", choice.get_name())
        } else {
            format!("`{}`: {}", choice.get_name(), point(&help))
        });
    }
    let default: Vec<String> =
        arg.get_default_values().iter().map(|value| value.to_string_lossy().into_owned()).collect();
    if takes && !default.is_empty() && !arg.is_hide_default_value_set() {
        said.push(format!("Default `{}`.", default.join(",")));
    }
    if let Some(variable) = arg.get_env() {
        said.push(format!("The environment variable `{}` says the same.", variable.to_string_lossy()));
    }
    said.retain(|part| !part.is_empty());
    said.join(" ")
}

/// With a point at its end.
fn point(text: &str) -> String {
    let text = text.trim();
    if text.is_empty() || text.ends_with(['.', ':', '!', '?']) { text.to_owned() } else { format!("{text}.") }
}

/// As it stands in a cell of a table.
fn cell(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}
