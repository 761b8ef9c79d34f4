//! The trials: which are missing, how each is built and measured, and where its findings go.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;

use anyhow::{anyhow, bail};
use fathom::compare::flow::{self, CompareOptions, Program};
use fathom::compare::launch::WorkerStart;
use fathom::compare::store::StoredComparison;
use fathom::harness::output::RECORDS;
use fathom::process::ProcessTree;
use fathom::record::comparison::GateSettings;
use fathom::{gpu, tell};

use crate::findings::findings;
use crate::injections::{Injection, unfit};
use crate::report;
use crate::trials::{Trial, trials};
use crate::workshop::Workshop;
use crate::{Cli, INTERRUPT};

/// Names of the results in the self-test's folder.
pub const RESULTS: [&str; 2] = ["self-test.json", "self-test.md"];

/// Makes the missing trials until it is interrupted or one fails, and writes what all of them show.
pub fn run(test: &Cli) -> anyhow::Result<()> {
    let out = test.out.display();
    std::fs::create_dir_all(&test.out)
        .map_err(|error| anyhow!("cannot write to {out}: {error}"))?;
    let injections = Injection::all().map_err(unfit)?;
    let mut missing = Vec::new();
    for trial in trials(test.plan, &injections) {
        if trial.id.contains(&test.trials) && !is_made(test, &trial)? {
            missing.push(trial);
        }
    }
    let ended = make(test, &missing, &injections);
    write(test, &injections)?;
    ended
}

fn make(test: &Cli, missing: &[Trial], injections: &[Injection]) -> anyhow::Result<()> {
    let workshop = Workshop::open(Path::new("."))?;
    for (number, trial) in (1..).zip(missing) {
        if INTERRUPT.load(Ordering::Relaxed) {
            break;
        }
        tell::note(format!("trial {number} of {}: {}", missing.len(), trial.id));
        match measure(test, &workshop, trial, injections) {
            // Whoever interrupts needs no reason.
            Err(_) if INTERRUPT.load(Ordering::Relaxed) => break,
            made => made?,
        }
    }
    Ok(())
}

/// Findings from the stored trials alone, written beside them.
fn write(test: &Cli, injections: &[Injection]) -> anyhow::Result<()> {
    let mut made = Vec::new();
    for trial in trials(test.plan, injections) {
        let folder = test.out.join(&trial.id);
        if folder.join(RECORDS).is_file() {
            let comparison = StoredComparison::read(&folder)?;
            if comparison.came_to_its_end() {
                made.push((trial, comparison));
            }
        }
    }
    let found = findings(injections, &made);
    let json = serde_json::to_string(&found).unwrap_or_default() + "\n";
    let texts = [json, report::markdown(&found)];
    for (name, text) in RESULTS.iter().zip(texts) {
        let path = test.out.join(name);
        let written = std::fs::write(&path, text);
        written.map_err(|error| anyhow!("cannot write {}: {error}", path.display()))?;
    }
    Ok(())
}

/// Trials of other settings are no part of the same findings. Of its gates a trial may have had fewer, where one could not be run.
fn is_made(test: &Cli, trial: &Trial) -> anyhow::Result<bool> {
    let folder = test.out.join(&trial.id);
    let Ok(stored) = StoredComparison::read(&folder) else {
        return Ok(false);
    };
    let wanted = settings_of(test, trial);
    let found = GateSettings { gates: wanted.gates.clone(), ..stored.header.settings.clone() };
    if found != wanted {
        let folder = folder.display();
        bail!("{folder} was measured with other settings: choose another folder with --out");
    }
    Ok(stored.came_to_its_end())
}

fn settings_of(test: &Cli, trial: &Trial) -> GateSettings {
    GateSettings {
        gates: trial.gates.clone(),
        launches: test.launches,
        pairs: test.pairs,
        seed: trial.seed,
        ..GateSettings::default()
    }
}

/// Compares a variant with its base.
fn measure(
    test: &Cli,
    workshop: &Workshop,
    trial: &Trial,
    injections: &[Injection],
) -> anyhow::Result<()> {
    let gpu = gpu::Options { adapter: test.adapter.clone(), ..gpu::Options::default() };
    let program = |label: String, path: &Path| Program {
        label,
        start: WorkerStart { gpu: gpu.clone(), ..WorkerStart::new(path) },
    };
    let folder = test.out.join(&trial.id);
    workshop.with(&trial.variant, injections, |[base, head]| {
        let load = if trial.loaded { Some(busy(&base)?) } else { None };
        let options = CompareOptions {
            catalog: fathom::Catalog::builtin(),
            programs: [
                program("base".to_owned(), &base),
                program(trial.variant.to_string(), &head),
            ],
            cells_file: None,
            filter: None,
            env_values: false,
            settings: settings_of(test, trial),
            resume: folder.join(RECORDS).metadata().is_ok_and(|lines| lines.len() > 0),
            out: Some(folder),
            checkout: None,
        };
        let measured = flow::measure(&options, &INTERRUPT, &|text| tell::note(text));
        drop(load);
        measured.map(drop).map_err(|error| anyhow!("trial {}: {error}", trial.id))
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

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use clap::Parser;
    use fathom::compare::store;
    use fathom::harness::output::{FolderKind, Taken};
    use fathom::record::comparison::{Compared, ComparisonEnd, ComparisonHeader, Gate};

    use super::*;

    fn self_test(out: &Path, pairs: &str) -> Cli {
        Cli::parse_from([
            OsStr::new("selftest"),
            "--pairs".as_ref(),
            pairs.as_ref(),
            "--out".as_ref(),
            out.as_ref(),
        ])
    }

    #[test]
    fn a_stored_trial_counts_if_it_ended_and_is_refused_if_its_settings_differ() {
        let folder = tempfile::tempdir().unwrap();
        let test = self_test(folder.path(), "16");
        let injections = Injection::all().unwrap();
        let trial = trials(test.plan, &injections).pop().unwrap();
        assert!(!is_made(&test, &trial).unwrap());

        // A gate that could not be run.
        let settings = GateSettings { gates: vec![Gate::Exact], ..settings_of(&test, &trial) };
        let header = ComparisonHeader { settings, ..ComparisonHeader::default() };
        let taken = Taken::free(&folder.path().join(&trial.id)).unwrap();
        let mut held = taken.open(FolderKind::Comparison).unwrap();
        store::write(&mut held, vec![Compared::Header(Box::new(header))]).unwrap();
        assert!(!is_made(&test, &trial).unwrap());
        let end = ComparisonEnd { wall_s: 1.0, interrupted: false };
        store::write(&mut held, vec![Compared::End(end)]).unwrap();
        assert!(is_made(&test, &trial).unwrap());

        let other = self_test(folder.path(), "12");
        let error = is_made(&other, &trial).unwrap_err().to_string();
        assert!(error.contains("measured with other settings"), "{error}");
    }
}
