//! The program `quadrille`; everything is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    quadrille::cli::main()
}
