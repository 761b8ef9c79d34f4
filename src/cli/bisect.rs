//! `fathom bisect`: from the command line to the revision.

use std::process::ExitCode;
use std::sync::atomic::Ordering;

use crate::compare::bisect::{self, BisectOptions};
use crate::compare::candidates::{BuildMethod, SearchSpace};
use crate::compare::cells::Gates;
use crate::compare::flow;
use crate::harness::catalog::Catalog;
use crate::judge::verdict::Status;
use crate::print;
use crate::record::comparison::{Gate, GateSettings};
use anyhow::Context;

use super::COULD_NOT_RUN;
use super::commands::{ExitResult, INTERRUPT, INTERRUPTED, gpu_options, watch_interrupts};
use super::compare_args::BisectArgs;

/// Gates of a search for which none are named.
const GATES: [Gate; 2] = [Gate::Instructions, Gate::Time];
/// The ends do not differ.
const NOTHING_TO_FIND: u8 = 1;
/// Several revisions could not be told apart, or the ends are too noisy.
const UNDECIDED: u8 = 3;

pub fn bisect(catalog: &Catalog, args: &BisectArgs) -> ExitResult {
    let searched = searched(args)?;
    watch_interrupts()?;
    // A wrong selection is told before minutes are spent on building.
    Gates::load(args.cells_file.as_deref(), catalog.gates)?.filtered(args.cells.as_deref())?;
    let options = BisectOptions {
        catalog: catalog.clone(),
        folder: std::env::current_dir().context("there is no current folder")?,
        searched,
        cells_file: args.cells_file.clone(),
        filter: args.cells.clone(),
        gpu: gpu_options(catalog, &args.answer.adapter),
        settings: GateSettings {
            launches: args.launches,
            gates: if args.gates.is_empty() { GATES.to_vec() } else { args.gates.clone() },
            seed: args.seed,
            threshold: args.threshold,
            all: true,
            ..GateSettings::default()
        },
        batch: args.batch,
        max_launches: args.max_launches,
        resume: args.resume,
    };
    let out = flow::lock_output(args.out.as_deref(), "bisect", false)?;
    let found = bisect::bisect(&options, &out, &INTERRUPT, &|line| print::note(line));
    if INTERRUPT.load(Ordering::Relaxed) {
        if let Err(error) = found {
            super::fail(&error.to_string());
        }
        return Ok(ExitCode::from(INTERRUPTED));
    }
    let found = found?;
    print::answer(if args.answer.json {
        serde_json::to_string_pretty(&found.json())?
    } else {
        found.text()
    });
    print::note(out.folder().display());
    Ok(match (&found.answer, found.ends) {
        (Some(answer), _) if answer.is_certain() => ExitCode::SUCCESS,
        (Some(_), _) | (None, Status::Inconclusive) => ExitCode::from(UNDECIDED),
        (None, Status::NoRegression) => ExitCode::from(NOTHING_TO_FIND),
        (None, _) => ExitCode::from(COULD_NOT_RUN),
    })
}

/// What is searched among; the command line has one of these.
fn searched(args: &BisectArgs) -> anyhow::Result<SearchSpace> {
    let build = args.build_cmd.as_deref().unwrap_or(":").to_owned();
    let commands = |run| BuildMethod::Commands { build, run };
    let by = args.cmd.clone().map_or(BuildMethod::Cargo, commands);
    if let Some(list) = args.candidates.clone() {
        return Ok(SearchSpace::Lines { list, by });
    }
    let good = args.good.clone().context("give --good REV or --candidates FILE")?;
    Ok(SearchSpace::Revisions { good, bad: args.bad.clone(), by })
}
