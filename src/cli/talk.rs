//! How much a command says.

use super::args::ProgressKind;

/// How much is said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Talk {
    Quiet,
    Normal,
    Verbose,
    /// One JSON object a line.
    Json,
}

impl Talk {
    /// What the flags of a command without --verbose ask for.
    pub fn of(kind: ProgressKind, quiet: bool) -> Self {
        match (quiet, kind) {
            (true, _) => Self::Quiet,
            (_, ProgressKind::Json) => Self::Json,
            _ => Self::Normal,
        }
    }
}
