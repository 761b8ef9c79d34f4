//! `fathom compare`: from the command line to the folder of a comparison, its tables and the exit status.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use crate::compare::build::{self, BuiltProgram, SetAside};
use crate::compare::cells::Gates;
use crate::compare::driver::{self, GivenEnvironment};
use crate::compare::flow::{self, CompareOptions, Program};
use crate::compare::launch::{Waiting, WorkerStart};
use crate::compare::{settings, tables};
use crate::gates::changes::Changes;
use crate::gates::files::RunFile;
use crate::gates::store::StoredComparison;
use crate::gates::verdict::{Status, Verdicts};
use crate::harness::catalog::Catalog;
use crate::record::comparison::{Gate, GateSettings, Side};
use crate::{exporters, folder, private, tell};
use anyhow::Context;

use super::commands::{INTERRUPT, INTERRUPTED, Outcome, gpu_options, watch_interrupts};
use super::compare_args::CompareArgs;

/// The format that is printed where none is asked for.
pub const TEXT: &str = "text";
/// Where GitHub Actions takes Markdown for a job's page.
const STEP_SUMMARY: &str = "GITHUB_STEP_SUMMARY";

pub fn compare(catalog: &Catalog, args: CompareArgs) -> Outcome {
    if let Some(folder) = &args.replay {
        return tell(folder, &args.format, false);
    }
    if let [base, head] = args.records.as_slice() {
        return two_runs([base, head], &args.gates);
    }
    let folder = match builds(catalog, &args) {
        Err(error) if INTERRUPT.load(Ordering::Relaxed) => {
            super::fail(&error.to_string());
            return Ok(ExitCode::from(INTERRUPTED));
        }
        folder => folder?,
    };
    let status = tell(&folder, &args.format, true)?;
    let interrupted = INTERRUPT.load(Ordering::Relaxed);
    Ok(if interrupted { ExitCode::from(INTERRUPTED) } else { status })
}

fn gate_settings(args: &CompareArgs) -> GateSettings {
    let mut gates = args.gates.clone();
    gates.sort();
    gates.dedup();
    let begun = || {
        let folder = args.out.as_ref().filter(|_| args.resume)?;
        settings::stored(folder).ok()?.get("seed")?.as_u64()
    };
    GateSettings {
        threshold: args.threshold,
        instruction_threshold: args.instruction_threshold,
        launches: args.launches,
        pairs: args.pairs,
        // A seed that JSON readers of every kind keep exactly.
        seed: args.seed.or_else(begun).unwrap_or_else(|| u64::from(rand::random::<u32>())),
        gates,
        ..GateSettings::default()
    }
}

fn base_place(catalog: &Catalog, revision: &str) -> anyhow::Result<build::Place> {
    let folder = std::env::current_dir().context("there is no current folder")?;
    build::Place::of(&folder, catalog.program, revision)
}

fn gates(catalog: &Catalog, args: &CompareArgs) -> anyhow::Result<Gates> {
    let gates = Gates::load(args.cells_file.as_deref(), catalog.gates)?;
    args.cells.as_deref().map_or(Ok(gates.clone()), |filter| gates.filtered(filter))
}

fn builds(catalog: &Catalog, args: &CompareArgs) -> anyhow::Result<PathBuf> {
    watch_interrupts()?;
    // A wrong selection is told before minutes are spent on building, and so is a revision that there is not.
    gates(catalog, args)?;
    if let Some(revision) = &args.base {
        base_place(catalog, revision)?;
    }
    if let Some(folder) = &args.out {
        flow::taken(folder, args.resume)?;
    }
    if let (Some(base), Some(head)) = (&args.base_cmd, &args.head_cmd) {
        return commands(catalog, args, [base, head]);
    }
    let this = || std::env::current_exe().context("cannot tell where this program lies");
    let gpu = gpu_options(catalog, &args.adapter);
    let environments = [
        driver::environment(Side::Base, &args.base_env, args.base_driver.as_deref())?,
        driver::environment(Side::Head, &args.head_env, args.head_driver.as_deref())?,
    ];
    let is_named = args.base.is_some() || args.base_bin.is_some();
    if !is_named && environments.iter().all(GivenEnvironment::is_empty) {
        anyhow::bail!(
            "nothing to compare with: give --base REV, --base-bin PATH, environments or drivers, or two files of records"
        );
    }
    let head = args.head_bin.clone().map_or_else(this, Ok)?;
    let head_label = private::path(&head);
    // A build meanwhile must not swap what is measured.
    let head = build::set_aside(&head)?;
    let flags = [&INTERRUPT];
    let waiting = Waiting { interrupted: &flags, ..Waiting::PLAINLY };
    let this = this()?;
    let starts = environments.map(|environment| WorkerStart {
        gpu: gpu.clone(),
        environment,
        ..WorkerStart::new(&this)
    });
    for (side, start) in Side::BOTH.into_iter().zip(&starts) {
        driver::try_driver(side, start, &waiting)?;
    }
    let (base, base_label, commit) = match (&args.base, &args.base_bin) {
        (Some(revision), _) => {
            let BuiltProgram { path, commit } = built(catalog, revision)?;
            (path, revision.clone(), Some(commit))
        }
        (None, path) => {
            let path = path.clone().unwrap_or(this);
            let label = private::path(&path);
            (path, label, None)
        }
    };
    let base = build::set_aside(&base)?;
    let cache = |start: &WorkerStart| driver::shader_cache(&start.environment);
    let caches = [cache(&starts[0])?, cache(&starts[1])?];
    let program = |side: Side, aside: &SetAside, label| {
        let shader_cache = caches[side as usize].as_ref().map(|folder| folder.path().to_owned());
        let (program, commit) = (aside.path.clone(), commit.clone().filter(|_| side == Side::Base));
        let own = starts[side as usize].clone();
        Program { label, start: WorkerStart { program, shader_cache, commit, ..own } }
    };
    let programs = [program(Side::Base, &base, base_label), program(Side::Head, &head, head_label)];
    // The head of a pull request is meant to be what is checked out.
    let is_checkout = args.base.is_some() && args.head_bin.is_none();
    let folder = std::env::current_dir().context("there is no current folder")?;
    let checkout = is_checkout.then(|| build::checkout(&folder)).flatten();
    let options = CompareOptions { checkout, ..options(catalog, args, programs) };
    flow::measure(&options, &INTERRUPT, &|text| tell::note(text))
}

/// A comparison of two programs that speak the worker protocol.
fn commands(catalog: &Catalog, args: &CompareArgs, texts: [&String; 2]) -> anyhow::Result<PathBuf> {
    let environments = [
        driver::environment(Side::Base, &args.base_env, None)?,
        driver::environment(Side::Head, &args.head_env, None)?,
    ];
    let [base, head] = texts
        .map(|text| Program { label: private::words(text), start: WorkerStart::of_command(text) });
    let [of_base, of_head] = environments;
    let given = |program: Program, environment| Program {
        start: WorkerStart { environment, ..program.start },
        ..program
    };
    let programs = [given(base, of_base), given(head, of_head)];
    flow::measure(&options(catalog, args, programs), &INTERRUPT, &|text| tell::note(text))
}

fn options(catalog: &Catalog, args: &CompareArgs, programs: [Program; 2]) -> CompareOptions {
    CompareOptions {
        catalog: catalog.clone(),
        programs,
        cells_file: args.cells_file.clone(),
        filter: args.cells.clone(),
        env_values: args.env_values,
        settings: gate_settings(args),
        out: args.out.clone(),
        resume: args.resume,
        checkout: None,
    }
}

fn built(catalog: &Catalog, revision: &str) -> anyhow::Result<BuiltProgram> {
    tell::note(format!("building {revision}"));
    let folder = std::env::current_dir().context("there is no current folder")?;
    let mut progress = |line: &str| tell::note(line);
    build::revision(&folder, catalog.program, revision, &INTERRUPT, &mut progress)
}

/// Two files of records: what changed.
fn two_runs(files: [&PathBuf; 2], gates: &[Gate]) -> Outcome {
    let [base, head] = [RunFile::read(files[0])?, RunFile::read(files[1])?];
    let changes = Changes::of_files([&base, &head])?;
    let status = match changes.status {
        Status::TimesNotJudged if !gates.contains(&Gate::Time) => Status::NoRegression,
        status => status,
    };
    let headline = format!("{status} (status {}): {}", status as u8, changes.headline);
    tell::answer(Changes { headline, ..changes }.text());
    Ok(ExitCode::from(status as u8))
}

/// Prints one of the tables of a folder, and writes all of them.
fn tell(folder: &Path, format: &str, fresh: bool) -> Outcome {
    let comparison = StoredComparison::read(folder)?;
    let verdicts = Verdicts::of(&comparison);
    if let Some(format) = exporters::OF_COMPARISONS.iter().find(|known| known.name == format) {
        tell::answer((format.export)(&verdicts));
    }
    write(folder, &verdicts, fresh)
}

/// Writes the tables of a folder. A fresh comparison also goes to the job's page, if there is one.
fn write(folder: &Path, verdicts: &Verdicts<'_>, fresh: bool) -> Outcome {
    exporters::put(folder, exporters::of_comparison(verdicts))?;
    if fresh && let Some(page) = std::env::var_os(STEP_SUMMARY).filter(|page| !page.is_empty()) {
        append(Path::new(&page), &tables::markdown(verdicts))?;
    }
    tell::note(folder.display());
    Ok(ExitCode::from(verdicts.status as u8))
}

fn append(page: &Path, text: &str) -> anyhow::Result<()> {
    let file = folder::of(page).and_then(|(folder, name)| folder.append(name));
    file.and_then(|mut file| file.write_all(text.as_bytes()))
        .with_context(|| format!("cannot add to {STEP_SUMMARY} ({})", page.display()))
}
