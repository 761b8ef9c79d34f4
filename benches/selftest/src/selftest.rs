//! The trials: which are missing, how each is built and measured, and where its findings go.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;

use anyhow::{Context, Result};
use fathom::compare::flow::{self, CompareOptions, Program};
use fathom::compare::launch::WorkerStart;
use fathom::compare::store::StoredComparison;
use fathom::harness::output::RECORDS;
use fathom::process::ProcessTree;
use fathom::record::comparison::GateSettings;
use fathom::tell;
use itertools::Itertools;

use crate::findings;
use crate::patches::Patch;
use crate::trials::{Trial, trials, tried};
use crate::workshop::Workshop;
use crate::{Cli, INTERRUPT};

/// Makes the missing trials until it is interrupted or one fails, and writes what all of them show.
pub fn run(test: &Cli) -> Result<()> {
    std::fs::create_dir_all(&test.out)
        .with_context(|| format!("cannot write to {}", test.out.display()))?;
    let all = trials(&Patch::all()?);
    let asked = all.iter().filter(|trial| trial.id.contains(&test.trials));
    let ended = make(test, &[tried()].iter().chain(asked).collect_vec());
    let stored = all.iter().map(|trial| Ok(stored(test, trial)?.map(|it| (trial.clone(), it))));
    let made: Vec<_> = stored.filter_map(Result::transpose).try_collect()?;
    let path = test.out.join("self-test.md");
    std::fs::write(&path, findings::markdown(&made))
        .with_context(|| format!("cannot write {}", path.display()))?;
    tell::done(path.display());
    ended
}

fn make(test: &Cli, asked: &[&Trial]) -> Result<()> {
    let workshop = Workshop::open(Path::new("."))?;
    for (number, trial) in (1..).zip(asked) {
        if INTERRUPT.load(Ordering::Relaxed) {
            break;
        }
        if stored(test, trial)?.is_none() {
            tell::note(format!("trial {number} of {}: {}", asked.len(), trial.id));
            measure(test, &workshop, trial).with_context(|| format!("trial {}", trial.id))?;
        }
    }
    Ok(())
}

/// The trial's comparison, if it came to its end.
fn stored(test: &Cli, trial: &Trial) -> Result<Option<StoredComparison>> {
    let folder = test.out.join(&trial.id);
    if !folder.join(RECORDS).is_file() {
        return Ok(None);
    }
    Ok(Some(StoredComparison::read(&folder)?).filter(StoredComparison::came_to_its_end))
}

/// Compares a variant with its base.
fn measure(test: &Cli, workshop: &Workshop, trial: &Trial) -> Result<()> {
    let program = |label: &str, path: &Path| Program {
        label: label.to_owned(),
        start: WorkerStart::new(path),
    };
    let folder = test.out.join(&trial.id);
    workshop.with(trial, stored(test, &tried())?.as_ref(), |[base, head]| {
        let load = if trial.loaded { Some(busy(&base)?) } else { None };
        let options = CompareOptions {
            catalog: fathom::Catalog::builtin(),
            programs: [program("base", &base), program(&trial.id, &head)],
            cells_file: None,
            filter: None,
            env_values: false,
            settings: GateSettings {
                gates: trial.gates.clone(),
                seed: trial.seed,
                ..GateSettings::default()
            },
            resume: folder.join(RECORDS).metadata().is_ok_and(|lines| lines.len() > 0),
            out: Some(folder),
            checkout: None,
        };
        let measured = flow::measure(&options, &INTERRUPT, &|text| tell::note(text));
        drop(load);
        measured.map(drop)
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
