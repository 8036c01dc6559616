//! The program `quadrille`; everything is in the library.

use quadrille::cli::Blocks;
use std::process::ExitCode;

#[global_allocator]
static MEMORY: Blocks = Blocks::new();

fn main() -> ExitCode {
    quadrille::cli::main()
}
