//! `fathom compare`: from the command line to the folder of a comparison, its tables and the exit status.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use crate::compare::build::{self, ProgramCopy, Revision};
use crate::compare::cells::Gates;
use crate::compare::environment::{self, Environment};
use crate::compare::flow::{self, CompareOptions, Program};
use crate::compare::settings;
use crate::compare::worker_process::WorkerStart;
use crate::harness::catalog::Catalog;
use crate::judge::files::RunFile;
use crate::judge::store::Comparison;
use crate::judge::verdict::Verdicts;
use crate::record::FolderLock;
use crate::record::comparison::{CellId, Gate, GateSettings, Side};
use crate::record::output::Recording;
use crate::report::changes::RunChanges;
use crate::report::comparison;
use crate::{exporters, folder, print, private};
use anyhow::{Context, ensure};
use tempfile::TempDir;

use super::commands::{ExitResult, INTERRUPT, INTERRUPTED, gpu_options, watch_interrupts};
use super::compare_args::CompareArgs;

/// Label of a side that a command of the shell starts. Its text may hold secrets.
const COMMAND: &str = "command";
/// Where GitHub Actions takes Markdown for a job's page.
const STEP_SUMMARY: &str = "GITHUB_STEP_SUMMARY";

pub fn compare(catalog: &Catalog, args: CompareArgs) -> ExitResult {
    if let Some(folder) = &args.replay {
        return print_report(folder, &args.format, false);
    }
    if let [base, head] = args.records.as_slice() {
        return two_runs([base, head], &args.gates);
    }
    let held = match builds(catalog, &args) {
        Err(error) if INTERRUPT.load(Ordering::Relaxed) => {
            super::fail(&error.to_string());
            return Ok(ExitCode::from(INTERRUPTED));
        }
        held => held?,
    };
    let status = print_report(&held.output.folder, &args.format, true)?;
    let interrupted = INTERRUPT.load(Ordering::Relaxed);
    Ok(if interrupted { ExitCode::from(INTERRUPTED) } else { status })
}

fn gate_settings(args: &CompareArgs) -> GateSettings {
    let mut gates = args.gates.clone();
    gates.sort();
    gates.dedup();
    let begun = || {
        let folder = args.out.as_ref().filter(|_| args.resume)?;
        settings::load(folder).ok()?.get("seed")?.as_u64()
    };
    GateSettings {
        threshold: args.threshold,
        instruction_threshold: args.instruction_threshold,
        launches: args.launches,
        pairs: args.pairs,
        // A seed that JSON readers of every kind keep exactly.
        seed: args.seed.or_else(begun).unwrap_or_else(|| u64::from(rand::random::<u32>())),
        gates,
        all: args.all,
        ..GateSettings::default()
    }
}

fn builds(catalog: &Catalog, args: &CompareArgs) -> anyhow::Result<Recording> {
    watch_interrupts()?;
    // A wrong selection is told before minutes are spent on building.
    Gates::load(args.cells_file.as_deref(), catalog.gates)?.filtered(args.cells.as_deref())?;
    let environments = [
        environment::parse(Side::Base, &args.base_env)?,
        environment::parse(Side::Head, &args.head_env)?,
    ];
    let folder = std::env::current_dir().context("there is no current folder")?;
    let revision = base_revision(catalog, args, &folder)?;
    let is_named = revision.is_some() || args.base_bin.is_some() || args.base_cmd.is_some();
    ensure!(
        is_named || environments.iter().any(|given| !given.is_empty()),
        "nothing to compare with: give --base REV, --base-bin PATH, an environment, or two files of records"
    );
    let [of_base, of_head] = environments;
    let base_cells = base_cells(args, &folder, revision.as_ref())?;
    // The head of a pull request is meant to be what is checked out.
    let is_checkout = revision.is_some() && args.head_bin.is_none();
    let locked = flow::lock_output(args.out.as_deref(), "compare", args.resume)?;
    exporters::check_folder(
        locked.folder(),
        &exporters::comparison_files(&Verdicts::judge(&Comparison::default())),
    )?;
    // The head first: a build of the base must not swap what is measured.
    let head = WorkerSource::new(&args.head_bin, &args.head_cmd)?;
    let head = PreparedSide::new(catalog, args, head, of_head)?;
    let base = match revision {
        Some(revision) => WorkerSource::Revision(&folder, revision),
        None => WorkerSource::new(&args.base_bin, &args.base_cmd)?,
    };
    let base = PreparedSide::new(catalog, args, base, of_base)?;
    let options = CompareOptions {
        catalog: catalog.clone(),
        programs: [base.program.clone(), head.program.clone()],
        cells_file: args.cells_file.clone(),
        base_cells,
        filter: args.cells.clone(),
        env_values: args.env_values,
        settings: gate_settings(args),
        resume: args.resume,
        checkout: is_checkout.then(|| build::checkout(&folder)).flatten(),
    };
    flow::measure(&options, locked, &INTERRUPT, &|text| print::note(text))
}

/// The revision that the command line names: where it and the head part, unless it is asked for exactly.
fn base_revision(
    catalog: &Catalog,
    args: &CompareArgs,
    folder: &Path,
) -> anyhow::Result<Option<Revision>> {
    let Some(named) = args.base.as_ref().or(args.base_exact.as_ref()) else { return Ok(None) };
    let repository = build::repository(folder)?;
    let commit = build::commit(&repository, named)?;
    if args.base_exact.is_some() {
        return Ok(Some(Revision { label: named.clone(), commit }));
    }
    let built_of = catalog.build().commit.filter(|_| args.head_bin.is_none());
    let head = built_of.and_then(|commit| build::commit(&repository, &commit).ok());
    let head = head.map_or_else(|| build::commit(&repository, "HEAD"), Ok)?;
    let common = build::merge_base(&repository, [&commit, &head])?;
    let is_same = common == commit;
    let label = if is_same { named.clone() } else { format!("merge base of {named}") };
    Ok(Some(Revision { label, commit: common }))
}

/// The cells of the base's own file, where one is given or the revision has it.
fn base_cells(
    args: &CompareArgs,
    folder: &Path,
    revision: Option<&Revision>,
) -> anyhow::Result<Option<Vec<CellId>>> {
    if let Some(file) = &args.base_cells_file {
        return Ok(Some(Gates::load(Some(file), ("", ""))?.cells()));
    }
    let stored = args.cells_file.as_ref().zip(revision).and_then(|(file, revision)| {
        let text = build::file_at(folder, &revision.commit, file)?;
        Gates::parse("base", &text).ok()
    });
    Ok(stored.map(|gates| gates.cells()))
}

enum WorkerSource<'a> {
    /// Of the repository around a folder.
    Revision(&'a Path, Revision),
    Program(PathBuf),
    /// Of the shell: any program that speaks the worker protocol.
    Command(&'a str),
}

impl<'a> WorkerSource<'a> {
    /// This program, unless another or a command is named.
    fn new(program: &Option<PathBuf>, command: &'a Option<String>) -> anyhow::Result<Self> {
        Ok(match (program, command) {
            (_, Some(text)) => Self::Command(text),
            (Some(path), None) => Self::Program(path.clone()),
            (None, None) => Self::Program(
                std::env::current_exe().context("cannot tell where this program lies")?,
            ),
        })
    }
}

/// A side with what must stay until the end.
struct PreparedSide {
    program: Program,
    _aside: Option<ProgramCopy>,
    _shader_cache: Option<TempDir>,
}

impl PreparedSide {
    fn new(
        catalog: &Catalog,
        args: &CompareArgs,
        ran: WorkerSource<'_>,
        environment: Environment,
    ) -> anyhow::Result<Self> {
        let (label, commit, aside) = match ran {
            WorkerSource::Command(text) => {
                let start = WorkerStart { environment, ..WorkerStart::from_command(text) };
                let program = Program { label: COMMAND.to_owned(), start };
                return Ok(Self { program, _aside: None, _shader_cache: None });
            }
            WorkerSource::Program(path) => (private::path(&path), None, build::set_aside(&path)?),
            WorkerSource::Revision(folder, revision) => {
                print::note(format!("building {} ({})", revision.label, revision.commit));
                let mut progress = |line: &str| print::note(line);
                let target = catalog.program;
                let built = build::revision(folder, target, &revision, &INTERRUPT, &mut progress)?;
                (revision.label, Some(revision.commit), built)
            }
        };
        let shader_cache = environment::shader_cache(&environment)?;
        let start = WorkerStart {
            gpu: gpu_options(catalog, &args.adapter),
            environment,
            commit,
            shader_cache: shader_cache.as_ref().map(|folder| folder.path().to_owned()),
            ..WorkerStart::new(&aside.path)
        };
        let program = Program { label, start };
        Ok(Self { program, _aside: Some(aside), _shader_cache: shader_cache })
    }
}

/// Prints what changed from one run to another, each a folder or its file of records.
fn two_runs(paths: [&PathBuf; 2], gates: &[Gate]) -> ExitResult {
    let [base, head] = [RunFile::read(paths[0])?, RunFile::read(paths[1])?];
    let changes = RunChanges::from_files([&base, &head], gates)?;
    let status = changes.status as u8;
    print::answer(changes.into_text());
    Ok(ExitCode::from(status))
}

/// Prints one of the tables of a folder, and writes all of them.
fn print_report(folder: &Path, format: &str, fresh: bool) -> ExitResult {
    let comparison = Comparison::read(folder)?;
    let _lock = (!fresh).then(|| FolderLock::take(folder)).transpose()?;
    let verdicts = Verdicts::judge(&comparison);
    if let Some(format) = exporters::OF_COMPARISONS.iter().find(|known| known.name == format) {
        print::answer((format.export)(&verdicts));
    }
    write(folder, &verdicts, fresh)
}

/// Writes the tables of a folder. A fresh comparison also goes to the job's page, if there is one.
fn write(folder: &Path, verdicts: &Verdicts<'_>, fresh: bool) -> ExitResult {
    exporters::write_artifacts(folder, exporters::comparison_files(verdicts))?;
    if fresh && let Some(page) = std::env::var_os(STEP_SUMMARY).filter(|page| !page.is_empty()) {
        append(Path::new(&page), &comparison::markdown(verdicts))?;
    }
    print::note(folder.display());
    Ok(ExitCode::from(verdicts.status as u8))
}

fn append(page: &Path, text: &str) -> anyhow::Result<()> {
    let file = folder::open_parent(page).and_then(|(folder, name)| folder.append(name));
    file.and_then(|mut file| file.write_all(text.as_bytes()))
        .with_context(|| format!("cannot add to {STEP_SUMMARY} ({})", page.display()))
}
