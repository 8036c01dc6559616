//! `quadrille licences`: whose work the program contains.

use super::{Outcome, Result};
use std::io::Write;

/// Made by scripts/licences.py.
const THIRD_PARTY: &str = include_str!("third_party.txt");

/// Runs the command.
pub(super) fn run() -> Result<Outcome> {
    // Whoever reads it may stop reading.
    match std::io::stdout().write_all(THIRD_PARTY.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(Outcome::Fine),
    }
}
