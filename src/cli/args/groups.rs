//! The options of a command in groups, and the short help: one screen.

use super::keys::with_defaults;
use crate::cli::talk::{WIDTH, wrapped};
use clap::{Arg, ArgAction, Command};

/// Headings of options that are the same matter in every command, and their ids, where the option itself names none.
const USUAL: [(&str, &str); 6] = [
    ("Input", "case page pattern run settle shots stills timeout"),
    ("Quantities", "extensometer extensometer.width_px line line.step_px opening.zones point region.roi remove_rigid"),
    ("Fit", "laws sweep tournament max_seconds max_evaluations"),
    ("Output", "format frames json magnify output overwrite range resume scale split strain strain_window to"),
    ("Machine", "device trust_device"),
    ("Messages", "color progress"),
];

/// Options above which the rare ones are left out of the short help.
const MANY: usize = 18;
/// Column at which the short help says what an option is.
const TEXT_AT: usize = 28;

/// `command` with the options of all its commands in groups, and with the defaults of those that are keys of a case.
pub fn grouped(command: Command) -> Command {
    with_defaults(in_groups(command))
}

fn in_groups(command: Command) -> Command {
    let command = command.mut_args(|arg| match usual_heading(&arg) {
        Some(heading) => arg.help_heading(heading),
        None => arg,
    });
    let names: Vec<String> = command.get_subcommands().map(|inner| inner.get_name().to_owned()).collect();
    names.into_iter().fold(command, |command, name| command.mut_subcommand(name, in_groups))
}

fn usual_heading(arg: &Arg) -> Option<&'static str> {
    let id = arg.get_id().as_str();
    // Positional arguments have a place of their own.
    let is_without = !arg.is_positional() && arg.get_help_heading().is_none();
    USUAL.iter().find(|(_, ids)| is_without && ids.split(' ').any(|usual| usual == id)).map(|(heading, _)| *heading)
}

/// Headings of `arguments` in the order that they come in, those without first.
pub(super) fn headings<'a>(arguments: &[&'a Arg]) -> Vec<Option<&'a str>> {
    let mut headings = vec![None];
    for heading in arguments.iter().map(|arg| arg.get_help_heading()) {
        if !headings.contains(&heading) {
            headings.push(heading);
        }
    }
    headings
}

/// What `-h` says of `command`, whose whole name is `name`: a line or two for each option.
pub fn short_help(command: &Command, name: &str) -> String {
    let mut command = command.clone();
    command.build();
    let mut text = String::new();
    let mut add = |line: &str| {
        text.push_str(line.trim_end());
        text.push('\n');
    };
    if let Some(about) = command.get_about() {
        add(&wrapped(&about.to_string(), 0));
    }
    let positional: Vec<&Arg> = command.get_positionals().collect();
    let required = command.get_arguments().filter(|arg| arg.is_required_set() && !arg.is_positional());
    let required: String = required.map(|arg| format!(" {}", spec(arg))).collect();
    let places: String = positional.iter().map(|arg| format!(" {}", place(arg))).collect();
    let inner = if command.has_subcommands() { " [COMMAND]" } else { "" };
    add("");
    add(&wrapped(&format!("Usage: {name}{inner}{required} [OPTIONS]{places}"), 7));
    let options: Vec<&Arg> = command.get_arguments().filter(|arg| !arg.is_positional() && !arg.is_hide_set()).collect();
    let many = options.len() > MANY;
    for arg in positional {
        add(&if many { brief(&place(arg), arg) } else { entry(&place(arg), arg) });
    }
    let commands: Vec<&Command> = command.get_subcommands().filter(|inner| inner.get_name() != "help").collect();
    if !commands.is_empty() {
        add("\nCommands:");
    }
    let width = commands.iter().map(|inner| inner.get_name().len()).max().unwrap_or_default();
    for inner in commands {
        let about = inner.get_about().map(ToString::to_string).unwrap_or_default();
        add(&wrapped(&format!("  {:<width$} {}", inner.get_name(), first_sentence(&about)), width + 3));
    }
    // What few need is in the long help alone, for the commands where the short one would be longer than a screen.
    let is_rare = |arg: &Arg| arg.is_hide_short_help_set() || matches!(arg.get_action(), ArgAction::Version);
    let shown: Vec<&Arg> = options.into_iter().filter(|arg| !(many && is_rare(arg))).collect();
    for heading in headings(&shown) {
        let of_group: Vec<_> = shown.iter().filter(|arg| arg.get_help_heading() == heading).collect();
        if !of_group.is_empty() {
            add(&format!("{}:", heading.unwrap_or("Options")));
        }
        for arg in of_group {
            add(&if many { brief(&spec(arg), arg) } else { entry(&spec(arg), arg) });
        }
    }
    add(&format!("All options, in full and with examples: {name} --help"));
    text
}

/// An option as it is typed.
fn spec(arg: &Arg) -> String {
    let long = arg.get_long().map(|long| format!("--{long}")).unwrap_or_default();
    let short = arg.get_short().filter(|_| arg.get_long() != Some("version"));
    let short = short.map(|short| format!("-{short}, ")).unwrap_or_default();
    let takes = arg.get_action().takes_values();
    let value = arg.get_value_names().filter(|_| takes).map(|names| names.iter().map(|n| format!(" {n}")).collect());
    let value: String = value.unwrap_or_default();
    format!("{short}{long}{value}")
}

fn place(arg: &Arg) -> String {
    let name = arg.get_value_names().and_then(<[_]>::first).map_or(arg.get_id().to_string(), ToString::to_string);
    let more = if arg.get_num_args().is_some_and(|n| n.max_values() > 1) { "..." } else { "" };
    if arg.is_required_set() { format!("<{name}>{more}") } else { format!("[{name}]{more}") }
}

/// What an option is, beside how it is typed; below it where that is long.
fn entry(spec: &str, arg: &Arg) -> String {
    let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
    let help = first_sentence(&help);
    let begin = format!("  {spec}");
    if begin.chars().count() + 2 <= TEXT_AT {
        wrapped(&format!("{begin:TEXT_AT$}{help}"), TEXT_AT)
    } else if begin.chars().count() + 2 + help.chars().count() <= WIDTH {
        format!("{begin}  {help}")
    } else {
        format!("{begin}\n{}", wrapped(&format!("{:TEXT_AT$}{help}", ""), TEXT_AT))
    }
}

/// The same on one line: as much of the first sentence as there is room for.
fn brief(spec: &str, arg: &Arg) -> String {
    // Of choices the words tell, of a form the long help.
    let spec = match spec.split_once(' ') {
        Some((flag, form)) if spec.chars().count() + 4 > TEXT_AT || form.contains('|') && flag.starts_with("--") => {
            format!("{flag} ...")
        }
        _ => spec.to_owned(),
    };
    let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
    let (sentence, room) = (first_sentence(&help), WIDTH - TEXT_AT);
    let clause = sentence.find([',', ';', ':', '(']).filter(|_| sentence.chars().count() > room);
    let words = fitted(sentence[..clause.unwrap_or(sentence.len())].trim_end(), room);
    format!("{:TEXT_AT$}{words}", format!("  {spec}"))
}

/// As many of the words as there is room for, and a sign that there are more.
fn fitted(text: &str, room: usize) -> String {
    if text.chars().count() <= room {
        return text.to_owned();
    }
    let begin: String = text.chars().take(room - 3).collect();
    let whole = begin.rsplit_once(' ').map_or(&*begin, |(whole, _)| whole);
    format!("{whole} ...")
}

/// The first sentence, without its point; one in brackets or after a colon belongs to it.
fn first_sentence(text: &str) -> &str {
    let end = text.find(". ").or_else(|| text.strip_suffix('.').map(str::len)).unwrap_or(text.len());
    &text[..end]
}
