//! `fathom-selftest`: tries the gates of `fathom compare` on builds of HEAD whose differences are known.
//!
//! Equal builds (the same source built twice, and a change of the host that no stage uses) must raise no alarm, on a
//! quiet machine and on a loaded one. Slowdowns of known size, built into one stage at a time, must be found and their
//! stage named. Each trial is a comparison in a folder of its own, so a self-test that was cut short goes on where it
//! ended, and its findings are a function of those folders.

mod findings;
mod injections;
mod report;
mod selftest;
mod slowed;
mod trials;
mod workshop;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::anyhow;
use clap::Parser;
use fathom::record::comparison;
use fathom::tell;
use trials::Plan;

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
    #[command(flatten)]
    plan: Plan,
    /// Pairs of worker processes in each time gate
    #[arg(long, default_value_t = comparison::LAUNCHES)]
    launches: u32,
    /// Pairs of samples of each cell in each launch
    #[arg(long, default_value_t = comparison::PAIRS)]
    pairs: u32,
    /// Part of the adapter's name, or its number in `fathom list adapters`
    #[arg(long, value_name = "NAME|INDEX")]
    adapter: Option<String>,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(cli) {
        _ if INTERRUPT.load(Ordering::Relaxed) => ExitCode::from(INTERRUPTED),
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tell::note(format!("error: {error}"));
            ExitCode::from(COULD_NOT_RUN)
        }
    }
}

fn run(cli: Cli) -> anyhow::Result<()> {
    let handled = ctrlc::set_handler(|| {
        if INTERRUPT.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED.into());
        }
        tell::note("ending with what is measured so far; interrupt again to abort");
    });
    handled.map_err(|error| anyhow!("cannot watch for Ctrl-C: {error}"))?;
    selftest::run(&cli)?;
    for name in selftest::RESULTS {
        tell::done(cli.out.join(name).display());
    }
    Ok(())
}
