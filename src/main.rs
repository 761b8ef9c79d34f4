//! The `fathom` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    fathom::cli::main(&fathom::Catalog::builtin())
}
