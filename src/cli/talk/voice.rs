//! The two ways in which the program speaks: messages on standard error, results on standard output.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stderr, stdout};

/// A line on standard error. Where it cannot be written (closed, full disk) the work goes on without it: what matters
/// is in files and in the exit status.
pub(crate) fn to_people(line: Arguments<'_>) {
    let mut text = line.to_string();
    text.push('\n');
    // Once for the whole line: lines of several processes in one log are not mixed.
    let _ = stderr().write_all(text.as_bytes());
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
