//! `fathom fleet`: from the command line to the shards of a batch system, the merged run and the exit status.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::Parser;

use super::commands::{
    INTERRUPT, INTERRUPTED, Outcome, SOMETHING_FAILED, request, watch_interrupts,
};
use super::{COULD_NOT_RUN, Cli, Command, RunArgs, merge};
use crate::fleet::{self, Followed};
use crate::harness::catalog::Catalog;
use crate::record::output;
use crate::tell;

/// Name of the folder of the merged run within the fleet's.
const MERGED: &str = "merged";

pub fn fleet(catalog: &Catalog, mut options: fleet::Options) -> Outcome {
    check_run(catalog, &options.command)?;
    options.out = std::path::absolute(&options.out).context("there is no current folder")?;
    let program = std::env::current_exe().context("cannot tell where this program lies")?;
    watch_interrupts()?;
    let followed = fleet::run(&options, &program, &INTERRUPT)?;
    ended(&followed, &options.out)
}

/// The arguments of `run` are tried here before any task is.
fn check_run(catalog: &Catalog, command: &[String]) -> anyhow::Result<()> {
    let words = std::iter::once("fathom").chain(command.iter().map(String::as_str));
    let parsed = Cli::try_parse_from(words).map_err(|error| {
        let told = error.to_string();
        let first = told.lines().next().unwrap_or_default();
        anyhow::anyhow!("after `--`: {}", first.trim_start_matches("error: "))
    })?;
    let Command::Run(args) = parsed.command else {
        anyhow::bail!("after `--` comes `run` with its arguments");
    };
    let RunArgs { shard, out, resume, .. } = &args;
    let own = [("--shard", shard.is_some()), ("--out", out.is_some()), ("--resume", *resume)];
    if let Some((option, _)) = own.iter().find(|(_, is_given)| *is_given) {
        anyhow::bail!("{option} is not for the run: `fathom fleet` sets it for each shard");
    }
    request(args).load(catalog)?;
    Ok(())
}

/// Merges what was measured and says what was not.
fn ended(followed: &Followed, out: &Path) -> Outcome {
    followed.failed.iter().for_each(tell::note);
    if followed.folders.is_empty() {
        let status = if followed.interrupted { INTERRUPTED } else { COULD_NOT_RUN };
        super::fail(&format!("no shard measured anything; what they said is in {}", out.display()));
        return Ok(ExitCode::from(status));
    }
    let place: PathBuf = output::unused(&out.join(MERGED))?;
    let merged = merge::join(&followed.folders, &place)?;
    Ok(ExitCode::from(if followed.interrupted {
        INTERRUPTED
    } else if !followed.failed.is_empty() {
        COULD_NOT_RUN
    } else if merged.iter().all(merge::is_whole) {
        return Ok(ExitCode::SUCCESS);
    } else {
        SOMETHING_FAILED
    }))
}
