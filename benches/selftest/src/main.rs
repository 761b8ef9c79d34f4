//! `fathom-selftest`: tries the gates of `fathom compare` on builds of HEAD whose differences are known.
//!
//! Equal builds must raise no alarm, on a quiet machine and on a loaded one. A stage made slower must be found and named. Each
//! trial is a comparison in a folder of its own, so a self-test that was cut short goes on where it ended, and its findings
//! are a function of those folders.

mod findings;
mod patches;
mod selftest;
mod slowed;
mod trials;
mod workshop;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Parser;
use fathom::tell;

/// By convention 128 + SIGINT.
const INTERRUPTED: u8 = 130;
/// Bad input, or a trial that could not be made. Whether the gates did well, the findings tell and not the status.
const COULD_NOT_RUN: u8 = 2;

/// It ends with what is measured so far.
static INTERRUPT: AtomicBool = AtomicBool::new(false);

/// Try the gates of `fathom compare` on builds of HEAD whose differences are known; takes hours
#[derive(Parser)]
#[command(version)]
struct Cli {
    /// Folder of the trials; those that it holds are not made again
    #[arg(long, value_name = "DIR", default_value = "reports/out/self-test")]
    out: PathBuf,
    /// Only trials whose names hold this
    #[arg(long, value_name = "FILTER", default_value = "")]
    trials: String,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let handled = ctrlc::set_handler(|| {
        if INTERRUPT.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED.into());
        }
        tell::note("ending with what is measured so far; interrupt again to abort");
    });
    let run = handled.map_err(anyhow::Error::from).and_then(|()| selftest::run(&cli));
    match run {
        _ if INTERRUPT.load(Ordering::Relaxed) => ExitCode::from(INTERRUPTED),
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tell::note(format!("error: {error:#}"));
            ExitCode::from(COULD_NOT_RUN)
        }
    }
}
