//! The two ways in which the program speaks: messages on standard error, results on standard output.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stderr, stdout};

/// A line on standard error. Where it cannot be written (closed, full disk) the work goes on without it: what matters
/// is in files and in the exit status.
pub(crate) fn to_people(line: Arguments<'_>) {
    let mut text = printable(&line.to_string());
    text.push('\n');
    // Once for the whole line: lines of several processes in one log are not mixed.
    let _ = stderr().write_all(text.as_bytes());
}

/// `text` without signs that a terminal obeys, which names of files may hold: only the colours of our own are left.
fn printable(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for (at, sign) in text.char_indices() {
        let is_colour = || {
            let code = text[at..].strip_prefix("\x1b[").and_then(|rest| rest.split_once('m'));
            code.is_some_and(|(code, _)| code.len() < 8 && code.bytes().all(|c| c.is_ascii_digit() || c == b';'))
        };
        match sign {
            '\n' | '\t' => shown.push(sign),
            '\x1b' if is_colour() => shown.push(sign),
            _ if sign.is_control() => shown.extend(sign.escape_default()),
            _ => shown.push(sign),
        }
    }
    shown
}

/// A piece of a result on standard output. A reader that has had enough (`| head`) is no fault and the rest is not
/// said; a result that cannot be written otherwise ends the program with exit status 1, since it would be lost
/// unnoticed.
pub(crate) fn result(text: Arguments<'_>) {
    let mut out = stdout().lock();
    match out.write_fmt(text).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            to_people(format_args!("quadrille: standard output: {error}"));
            std::process::exit(1);
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::printable;

    #[test]
    fn a_terminal_obeys_no_name_of_a_file() {
        assert_eq!(printable("\x1b[31merror\x1b[0m: a\tb\n"), "\x1b[31merror\x1b[0m: a\tb\n");
        assert_eq!(printable("a\x1b]0;title\x07\x1b[2J.png\r"), "a\\u{1b}]0;title\\u{7}\\u{1b}[2J.png\\r");
        assert_eq!(printable("µ \u{9b}2J"), "µ \\u{9b}2J");
    }
}
