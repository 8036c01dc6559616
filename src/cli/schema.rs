//! `quadrille schema`: what case files may say.

use super::args::SchemaArgs;
use super::{Outcome, Result};
use crate::io::case::{case_reference, case_schema};
use crate::mechanics::case_laws;
use std::io::Write;

/// Runs the command.
pub(super) fn run(args: &SchemaArgs) -> Result<Outcome> {
    let laws = case_laws();
    let text = match args.reference {
        true => case_reference(&laws),
        false => format!("{:#}\n", case_schema(&laws)),
    };
    // Whoever reads it may stop reading.
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(Outcome::Fine),
    }
}
