//! What is said of arguments that cannot be understood: one line with the fault and what to type instead.

use crate::cli::args::Cli;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, CommandFactory};
use std::error::Error;
use std::ffi::OsString;
use std::num::{IntErrorKind, ParseFloatError, ParseIntError};

/// The fault of `error`, of the `arguments` that were typed.
pub(crate) fn in_words(error: &clap::Error, arguments: &[OsString]) -> String {
    let said = match error.kind() {
        ErrorKind::ValueValidation => of_value(error, arguments),
        ErrorKind::UnknownArgument => unknown(error, arguments),
        ErrorKind::InvalidSubcommand => find_moved(error),
        _ => None,
    };
    format!("{}; more with --help", said.unwrap_or_else(|| one_line(&error.render().to_string())))
}

/// Commands by the names that they once had, and where each is now.
const MOVED: [(&str, &str); 12] = [
    ("sweep", "identify --sweep"),
    ("tournament", "identify --tournament"),
    ("synth", "make images"),
    ("virtual", "make virtual-test"),
    ("specimen", "make specimen"),
    ("draw", "make page"),
    ("devices", "about devices"),
    ("schema", "about schema"),
    ("completions", "about completions"),
    ("manual", "about manual"),
    ("licences", "about licences"),
    ("licenses", "about licences"),
];

/// Commands that became a program in the sources of quadrille, and their names there.
const IN_THE_SOURCES: [(&str, &str); 2] = [("bench", "devices"), ("paper", "paper")];

/// A command that has another name now.
fn find_moved(error: &clap::Error) -> Option<String> {
    let given = text(error, ContextKind::InvalidSubcommand)?;
    let now_of = |list: &[(&str, &'static str)]| list.iter().find(|(before, _)| *before == given).map(|(_, now)| *now);
    if let Some(now) = now_of(&MOVED) {
        return Some(format!("{given} is now `quadrille {now}`"));
    }
    let now = now_of(&IN_THE_SOURCES)?;
    Some(format!("{given} is now `cargo run --release -p quadrille-testbed -- {now}` in its sources"))
}

/// What clap says, on one line: the fault and its tip, without the usage.
fn one_line(message: &str) -> String {
    let said = message.trim_start_matches("error: ").lines().map(str::trim);
    let said = said.take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more information"));
    let said: Vec<_> = said.filter(|line| !line.is_empty()).collect();
    said.join(" ").replace(" tip: ", "; ")
}

fn text(error: &clap::Error, kind: ContextKind) -> Option<&str> {
    match error.get(kind)? {
        ContextValue::String(text) => Some(text),
        _ => None,
    }
}

/// A value of the wrong kind.
fn of_value(error: &clap::Error, arguments: &[OsString]) -> Option<String> {
    let (argument, value) = (text(error, ContextKind::InvalidArg)?, text(error, ContextKind::InvalidValue)?);
    let flag = argument.split(' ').next().unwrap_or(argument);
    if let Some(words) = with_commas(flag, value, arguments) {
        return Some(words);
    }
    let cause = error.source()?;
    let whole = cause.downcast_ref::<ParseIntError>();
    if whole.is_none() && !cause.is::<ParseFloatError>() {
        return None;
    }
    let begin = format!("{flag} '{value}'");
    if let Some(words) = decimal_comma(value) {
        return Some(format!("{begin}: {words}"));
    }
    let number = value.trim().parse::<f64>().ok();
    Some(match (whole.map(|fault| fault.kind()), number) {
        (Some(IntErrorKind::Zero), _) => format!("{begin}: give 1 or more"),
        (Some(IntErrorKind::PosOverflow | IntErrorKind::NegOverflow), _) => format!("{begin}: the number is too large"),
        (Some(_), Some(number)) if number.is_finite() && number.fract() != 0.0 => {
            format!("{begin}: give a whole number, such as {}", number.round())
        }
        (Some(_), Some(number)) if number < 0.0 => format!("{begin}: give a whole number, 0 or larger"),
        (Some(_), _) => format!("{begin}: this is not a whole number"),
        (None, _) => format!("{begin}: this is not a number"),
    })
}

/// A decimal comma, and the same number with a point.
pub(crate) fn decimal_comma(value: &str) -> Option<String> {
    let with_point = value.trim().replacen(',', ".", 1);
    let fine = value.matches(',').count() == 1 && with_point.parse::<f64>().is_ok_and(f64::is_finite);
    fine.then(|| format!("numbers have a decimal point, no comma: {with_point}"))
}

/// Numbers that belong together, typed as words of their own: `--roi 60 60 340 400`.
fn with_commas(flag: &str, value: &str, arguments: &[OsString]) -> Option<String> {
    let (command, _) = command_of(Cli::command(), arguments);
    let known = command.get_arguments().find(|arg| arg.get_long().is_some_and(|long| flag == format!("--{long}")))?;
    let shape = known.get_value_names()?.first()?.to_string();
    let n = shape.matches(',').count() + 1;
    let numeric = |word: &str| word.trim_end_matches(',').parse::<f64>().is_ok();
    let words: Vec<String> = arguments.iter().map(|word| word.to_string_lossy().into_owned()).collect();
    let at = words.iter().zip(words.iter().skip(1)).position(|(a, b)| a == flag && b == value)?;
    let numbers: Vec<&str> =
        words[at + 1..].iter().take(n).map(String::as_str).take_while(|word| numeric(word)).collect();
    if n < 2 || numbers.len() < 2 {
        return None;
    }
    let joined = numbers.iter().map(|word| word.trim_end_matches(',')).collect::<Vec<_>>().join(",");
    Some(format!("{flag} takes its numbers as one word, with commas and no blanks: {flag} {joined}"))
}

/// The command of the arguments among those of `command`, and its whole name; of `bench series` the inner one.
pub(crate) fn command_of(mut command: Command, arguments: &[OsString]) -> (Command, String) {
    let mut name = command.get_name().to_owned();
    for word in arguments.iter().skip(1) {
        let Some(inner) = command.find_subcommand(word) else { break };
        name = format!("{name} {}", inner.get_name());
        command = inner.clone();
    }
    (command, name)
}

/// A flag that there is not.
fn unknown(error: &clap::Error, arguments: &[OsString]) -> Option<String> {
    let given = text(error, ContextKind::InvalidArg)?;
    if given.trim_end_matches(',').parse::<f64>().is_ok() {
        // One of several numbers behind a flag that takes them as one word.
        let words: Vec<String> = arguments.iter().map(|word| word.to_string_lossy().into_owned()).collect();
        let at = words.iter().position(|word| word == given)?;
        let flag = words[..at].iter().rposition(|word| word.starts_with("--"))?;
        return with_commas(&words[flag], &words[flag + 1], arguments);
    }
    let letter = given.strip_prefix('-').filter(|rest| rest.chars().count() == 1 && *rest != "-")?;
    let (command, _) = command_of(Cli::command(), arguments);
    let longs = command.get_arguments().filter(|arg| !arg.is_hide_set()).filter_map(|arg| arg.get_long());
    let near: Vec<String> = longs.filter(|long| long.starts_with(letter)).map(|long| format!("--{long}")).collect();
    match near.as_slice() {
        [] => Some(format!("there is no flag {given}")),
        [first, ..] => Some(format!("there is no flag {given}; did you mean {first}?")),
    }
}
