//! What `quadrille completions` and `quadrille manual` take.

use clap::Args;
use clap_complete::Shell;
use std::path::PathBuf;

/// Arguments of `quadrille completions`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille completions bash > ~/.local/share/bash-completion/completions/quadrille")]
pub struct CompletionsArgs {
    /// The shell.
    #[arg(value_name = "bash|zsh|fish|elvish|powershell")]
    pub shell: Shell,
}

/// Arguments of `quadrille manual`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille manual --output ~/.local/share/man/man1")]
pub struct ManualArgs {
    /// Folder for the pages; made when it is not there. Pages of the same name are replaced.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
}
