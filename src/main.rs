//! The `fathom` command: parses the command line and dispatches.

mod cli;

use std::process::ExitCode;

use cli::{Command, commands, compare};

fn main() -> ExitCode {
    quiet_driver_layers();
    let command = match cli::parse() {
        Ok(command) => command,
        Err(status) => return status,
    };
    let result = match command {
        Command::Run(args) => commands::run(args),
        Command::List(args) => commands::list(args),
        Command::Audit(args) => commands::audit(args),
        Command::Verify(args) => commands::verify(args),
        Command::Fetch(args) => commands::fetch(args),
        Command::Render(args) => commands::render(args),
        Command::Dump(args) => commands::dump(args),
        Command::Query(args) => commands::query(args),
        Command::Report(args) => commands::report(args),
        Command::Compare(args) => compare::compare(*args),
        Command::Worker(args) => commands::worker(args),
    };
    cli::exit_status(result)
}

/// Keeps Mesa's device-select layer out of the run: it looks for a Wayland display, complains on standard error where
/// there is none, and may reorder the adapters.
fn quiet_driver_layers() {
    // SAFETY: no other thread runs yet.
    unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
}
