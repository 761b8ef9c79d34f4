//! `fathom-selftest`: tries the gates of `fathom compare` on builds of HEAD whose differences are known.
//!
//! Equal builds must raise no alarm, on a quiet machine and on a loaded one. A stage made slower must be found and named. Each
//! trial is a comparison in a folder of its own, so a self-test that was cut short goes on where it ended, and its findings
//! are a function of those folders.

mod effect;
mod faults;
mod findings;
mod mutants;
mod patches;
mod slowed;
mod trials;
mod workshop;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};
use fathom::compare::flow::{self, CompareOptions, Program};
use fathom::compare::store::Comparison;
use fathom::compare::worker_process::WorkerStart;
use fathom::harness::output::RECORDS;
use fathom::print;
use fathom::process::ProcessTree;
use fathom::record::comparison::GateSettings;
use itertools::Itertools;

use crate::mutants::{MutantArgs, WorkerArgs};
use crate::patches::Patch;
use crate::trials::{Trial, trials, tried};
use crate::workshop::Workshop;

/// It ends with what is measured so far.
static INTERRUPT: AtomicBool = AtomicBool::new(false);

/// Try the gates of `fathom compare` on builds of HEAD whose differences are known; takes hours
#[derive(Parser)]
struct SelftestCli {
    #[command(subcommand)]
    command: Option<SelftestCommand>,
    /// Folder of the trials; those that it holds are not made again
    #[arg(long, value_name = "DIR", default_value = "reports/out/self-test")]
    out: PathBuf,
    /// Only trials whose names hold this
    #[arg(long, value_name = "FILTER", default_value = "")]
    trials: String,
}

#[derive(Subcommand)]
enum SelftestCommand {
    /// Put faults into shaders, one at a time, and see which of them `fathom verify` finds
    Mutants(MutantArgs),
    #[command(hide = true)]
    Mutant(WorkerArgs),
}

fn main() -> Result<()> {
    let test = SelftestCli::parse();
    ctrlc::set_handler(|| INTERRUPT.store(true, Ordering::Relaxed))?;
    match &test.command {
        Some(SelftestCommand::Mutants(args)) => return mutants::run(args),
        Some(SelftestCommand::Mutant(args)) => return mutants::work(args),
        None => {}
    }
    std::fs::create_dir_all(&test.out)?;
    let all = trials(&Patch::all()?);
    let asked = all.iter().filter(|trial| trial.id.contains(&test.trials));
    let ended = make(&test, &[tried()].iter().chain(asked).collect_vec());
    let mut made = Vec::new();
    for trial in &all {
        made.extend(stored(&test, trial)?.map(|it| (trial.clone(), it)));
    }
    let path = test.out.join("self-test.md");
    std::fs::write(&path, findings::markdown(&made))?;
    print::status(path.display());
    ended
}

/// Makes the missing trials until it is interrupted or one fails.
fn make(test: &SelftestCli, asked: &[&Trial]) -> Result<()> {
    let workshop = Workshop::open(Path::new("."))?;
    for (number, trial) in (1..).zip(asked) {
        if INTERRUPT.load(Ordering::Relaxed) {
            break;
        }
        if stored(test, trial)?.is_none() {
            print::note(format!("trial {number} of {}: {}", asked.len(), trial.id));
            measure(test, &workshop, trial).with_context(|| format!("trial {}", trial.id))?;
        }
    }
    Ok(())
}

/// The trial's comparison, if it came to its end.
fn stored(test: &SelftestCli, trial: &Trial) -> Result<Option<Comparison>> {
    let folder = test.out.join(&trial.id);
    if !folder.join(RECORDS).is_file() {
        return Ok(None);
    }
    Ok(Some(Comparison::read(&folder)?).filter(Comparison::is_complete))
}

/// Compares a variant with its base.
fn measure(test: &SelftestCli, workshop: &Workshop, trial: &Trial) -> Result<()> {
    let program = |label: &str, path: &Path| Program {
        label: label.to_owned(),
        start: WorkerStart::new(path),
    };
    let folder = test.out.join(&trial.id);
    workshop.with(trial, stored(test, &tried())?.as_ref(), |[base, head]| {
        let _load = trial.loaded.then(|| busy(&base)).transpose()?;
        let (gates, seed) = (trial.gates.clone(), trial.seed);
        let options = CompareOptions {
            catalog: fathom::Catalog::builtin(),
            programs: [program("base", &base), program(&trial.id, &head)],
            cells_file: None,
            base_cells: None,
            filter: None,
            env_values: false,
            settings: GateSettings { gates, seed, all: true, ..GateSettings::default() },
            resume: folder.join(RECORDS).metadata().is_ok_and(|lines| lines.len() > 0),
            checkout: None,
        };
        let taken = flow::lock_output(Some(&folder), "", options.resume)?;
        flow::measure(&options, taken, &INTERRUPT, &|text| print::note(text)).map(drop)
    })
}

/// Other work on the machine: `fathom verify`, which renders and casts rays, over and over, until this is dropped. It keeps a core
/// busy: of two, the one that is left or the one that is measured on.
fn busy(program: &Path) -> std::io::Result<ProcessTree> {
    let mut command = Command::new("sh");
    command
        .args(["-c", "while true; do \"$0\" verify || sleep 0.1; done"])
        .arg(program)
        .env("LP_NUM_THREADS", "0")
        .env("RAYON_NUM_THREADS", "1")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    ProcessTree::spawn(&mut command)
}
