//! What `quadrille schema` takes.

use clap::Args;

/// Arguments of `quadrille schema`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille schema > case.schema.json\n\n\
    An editor that knows TOML (Taplo, Even Better TOML) completes and checks a case file beside it whose first line is\n  \
    #:schema ./case.schema.json")]
pub struct SchemaArgs {
    /// The reference of all keys instead, as Markdown: docs/case.md.
    #[arg(long)]
    pub reference: bool,
    /// The reference of all commands instead, as Markdown: docs/commands.md.
    #[arg(long, conflicts_with = "reference")]
    pub commands: bool,
    /// The codes of all remarks instead, as Markdown: docs/remarks.md.
    #[arg(long, conflicts_with_all = ["reference", "commands"])]
    pub remarks: bool,
}
