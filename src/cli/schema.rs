//! `quadrille schema`: what case files may say.

use super::args::{SchemaArgs, command_reference};
use super::{Outcome, Result};
use crate::io::case::{case_reference, case_schema};
use crate::mechanics::case_laws;
use crate::remark::remark_reference;
use std::io::Write;

/// Runs the command.
pub(super) fn run(args: &SchemaArgs) -> Result<Outcome> {
    let text = match args {
        SchemaArgs { commands: true, .. } => command_reference(),
        SchemaArgs { remarks: true, .. } => remark_reference(),
        SchemaArgs { reference: true, .. } => case_reference(&case_laws()),
        _ => format!("{:#}\n", case_schema(&case_laws())),
    };
    // Whoever reads it may stop reading.
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(Outcome::Fine),
    }
}
