//! The program `quadrille`; everything is in the library.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: quadrille::cli::Allocator = quadrille::cli::Allocator;

fn main() -> ExitCode {
    quadrille::cli::main()
}
