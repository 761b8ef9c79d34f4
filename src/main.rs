//! The `fathom` command.

use std::process::ExitCode;

/// Of the build: with `git describe`'s `-dirty` where files of the checkout were changed. It stands in the program alone, as each
/// commit compiles again what names it.
const REVISION: &str = git_version::git_version!(
    args = ["--always", "--dirty=-dirty", "--abbrev=40", "--exclude=*"],
    fallback = ""
);

fn main() -> ExitCode {
    let catalog = fathom::Catalog::builtin().with_revision(REVISION);
    fathom::cli::main(&catalog.with_host_code(env!("FATHOM_HOST_CODE")))
}
