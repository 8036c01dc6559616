//! `quadrille schema`: what case files may say.

use super::args::{Cli, SchemaArgs, command_reference, name_flags};
use super::{Outcome, Result};
use crate::io::case::{case_reference, case_schema};
use crate::mechanics::case_laws;
use clap::CommandFactory;
use std::io::Write;

/// Runs the command.
pub(super) fn run(args: &SchemaArgs) -> Result<Outcome> {
    let schema = || {
        let mut schema = case_schema(&case_laws());
        name_flags(&mut schema, &Cli::command());
        schema
    };
    let text = match args {
        SchemaArgs { commands: true, .. } => command_reference(),
        SchemaArgs { reference: true, .. } => case_reference(&schema()),
        _ => format!("{:#}\n", schema()),
    };
    // Whoever reads it may stop reading.
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(Outcome::Fine),
    }
}
