//! `fathom compare`: what it tells of stored comparisons, whole comparisons of builds that are scripts, and workers.
#![cfg(unix)]

mod builds;
mod folders;
mod gate;
mod script;
mod told;

use assert_cmd::Command;

/// The program, for which no job has a page.
fn fathom() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fathom"));
    command.env_remove("GITHUB_STEP_SUMMARY");
    command
}
