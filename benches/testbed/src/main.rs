//! `testbed`: what correlation costs on the devices of this machine, what a series costs from its files to its store, and
//! the tables and figures of the paper.

mod cli;

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: quadrille::cli::Allocator = quadrille::cli::Allocator;

fn main() -> ExitCode {
    cli::main()
}
