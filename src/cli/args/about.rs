//! What `quadrille about` takes.

use clap::{Args, Subcommand};
use clap_complete::Shell;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples:\n  \
    quadrille about devices\n  \
    quadrille about schema > case.schema.json\n  \
    quadrille about completions bash > ~/.local/share/bash-completion/completions/quadrille\n  \
    quadrille about manual --output ~/.local/share/man/man1\n\n\
    An editor that knows TOML (Taplo, Even Better TOML) completes and checks a case file beside case.schema.json\n\
    whose first line is\n  \
    #:schema ./case.schema.json")]
pub struct AboutArgs {
    #[command(subcommand)]
    pub what: About,
}

/// What `quadrille about` tells.
#[derive(Debug, Subcommand)]
pub enum About {
    /// List the devices that can do the pixel work, and which of them would be taken.
    Devices(DevicesArgs),
    /// Write the JSON schema of case files, with which editors complete and check them.
    Schema,
    /// Write the reference of all keys of case files, as Markdown: docs/case.md.
    Case,
    /// Write the reference of all commands, as Markdown: docs/commands.md.
    Commands,
    /// Write what each remark means and what to do about it, by its code, as Markdown: docs/remarks.md.
    Remarks,
    /// Write what a shell needs to complete commands and options.
    Completions {
        /// The shell.
        #[arg(value_name = "bash|zsh|fish|elvish|powershell")]
        shell: Shell,
    },
    /// Write the pages of `man`, one for each command.
    Manual {
        /// Folder for the pages; made when it is not there. Pages of the same name are replaced.
        #[arg(short, long, value_name = "DIR")]
        output: PathBuf,
    },
    /// Write the licences of quadrille and of the work of others that it contains.
    #[command(alias = "licenses")]
    Licences,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    What is there:\n    \
    quadrille about devices\n  \
    Correlate on the second graphics adapter:\n    \
    quadrille correlate --device 1 --output out ref.tif 'frames/*.tif'\n  \
    Whether the graphics devices compute what the CPU does (exit status 1 where one does not):\n    \
    quadrille about devices --check")]
pub struct DevicesArgs {
    /// Take small images through every kernel of each graphics device and compare with the CPU. The same is done by
    /// itself whenever one is used.
    #[arg(long)]
    pub check: bool,
    /// Print as JSON.
    #[arg(long)]
    pub json: bool,
}
