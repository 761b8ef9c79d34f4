//! What each subcommand does with the library, and what it prints.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use crate::compare::worker;
use crate::folder;
use crate::gpu::{self, Audit, Gpu};
use crate::harness::assets::{self, AssetStatus};
use crate::harness::catalog::Catalog;
use crate::harness::figures::{self, PaperFigure};
use crate::harness::plan::{GIVEN, Request};
use crate::harness::render::RenderedFrame;
use crate::harness::run::{self, RunOptions, Summary};
use crate::harness::subject::Subjects;
use crate::harness::{ceilings, dump as dumping, picture, sheet, verify as verifying};
use crate::record::output::{OutputFolder, RECORDS};
use crate::record::{Clock, FolderLock, OutcomeCounts, PassKind, Record, RecordFile, RunProgress};
use crate::report::charts::png::Rasterizer;
use crate::report::{self, Artifact, Report};
use crate::verify::{SkippedCase, Verified};
use crate::{exporters, print, private, quiet, record, text};
use anyhow::{Context, ensure};
use itertools::Itertools as _;
use serde::Serialize;
use serde_json::{Value, json};

use super::{AdapterArgs, AnswerArgs, DumpArgs, MeasureArgs, RenderArgs, RunArgs, WorkerArgs};

/// Default folder of published figures.
const FIGURES_FOLDER: &str = "figures";
/// A cell, a check or a figure failed.
pub const SOMETHING_FAILED: u8 = 1;
/// By convention 128 + SIGINT.
pub const INTERRUPTED: u8 = 130;

pub static INTERRUPT: AtomicBool = AtomicBool::new(false);

pub type ExitResult = anyhow::Result<ExitCode>;

pub fn run(catalog: &Catalog, args: RunArgs) -> ExitResult {
    let start = Instant::now();
    let options = RunOptions {
        resume: args.resume,
        seed: args.seed,
        no_ceilings: args.no_ceilings,
        ..shared_options(catalog, &args.measured)?
    };
    watch_interrupts()?;
    measure(args.measured.png, &RunOptions { request: request(args), ..options }, start)
}

/// The options that a run and a sweep share. On a software adapter the process begins again on one core.
pub fn shared_options(catalog: &Catalog, args: &MeasureArgs) -> anyhow::Result<RunOptions> {
    let gpu = gpu_options(catalog, &args.adapter);
    on_one_core(&gpu)?;
    Ok(RunOptions {
        catalog: catalog.clone(),
        gpu,
        profile: args.profile,
        budget_s: args.budget.map(|budget| budget.as_secs_f64()),
        visits: args.visits,
        out: args.out.clone(),
        command: private::command(),
        ..RunOptions::default()
    })
}

/// Begins the process again on one core where the adapter is a software driver.
fn on_one_core(options: &gpu::Options) -> anyhow::Result<()> {
    if Gpu::choose(options)?.software {
        quiet::begin_again();
    }
    Ok(())
}

/// Measures what is asked for, writes records and reports, and prints what came out in short: of sweeps their tables.
pub fn measure(png: bool, options: &RunOptions, start: Instant) -> ExitResult {
    // A system without fonts is told before minutes are measured.
    let png = png.then(Rasterizer::new).transpose()?;
    let given = options.request.given.iter();
    let given = given.map(|given| Artifact::new(GIVEN, given.text.clone()));
    let files = report::report_files(&[], None).into_iter().chain(given).collect_vec();
    options.out.iter().try_for_each(|folder| exporters::check_folder(folder, &files))?;
    let has_tables = AtomicBool::new(false);
    let report = move |folder: &Path, records: &[Record], standing: RunProgress| {
        let view = Report { standing: Some(standing), ..Report::new(records, Some(folder)) };
        if let Err(error) = exporters::write_view(folder, &view) {
            print::note(format!("error: no report yet: {error}"));
        }
        if !has_tables.swap(true, Ordering::Relaxed) {
            print_sizes(&view);
        }
    };
    let summary = run::run(options, start, Arc::new(report), &INTERRUPT)?;
    let output = OutputFolder { folder: summary.out.clone() };
    let reading = record::read(&output.records())?;
    let view = Report::new(&reading.records, Some(&output.folder));
    let in_short = report::terminal_summary(&view);
    print_sizes(&view);
    let name = output.folder.to_string_lossy();
    let resuming = view.run().and_then(|run| record::command::resuming(run, &name));
    drop(view);
    let files = exporters::write(&output.folder, reading, png.as_ref())?;
    in_short.iter().for_each(print::status);
    print_summary(&summary, &resuming.unwrap_or_default());
    print_pages(&files);
    let OutcomeCounts { measured, skipped, failed, over_budget } = summary.counts;
    let nothing = measured + failed + summary.kept == 0;
    Ok(match &summary.skip_reason {
        _ if summary.end.interrupted => ExitCode::from(INTERRUPTED),
        _ if failed > 0 => ExitCode::from(SOMETHING_FAILED),
        _ if nothing && over_budget > 0 => super::fail(&format!(
            "no cell was measured ({skipped} skipped, {over_budget} not run): give a longer --budget"
        )),
        Some(reason) if nothing => super::fail(&format!("every cell was skipped; {reason}")),
        _ => ExitCode::SUCCESS,
    })
}

pub fn exit_code(well: bool) -> ExitResult {
    Ok(if well { ExitCode::SUCCESS } else { ExitCode::from(SOMETHING_FAILED) })
}

pub fn list_files(paths: impl IntoIterator<Item = PathBuf>) -> ExitResult {
    paths.into_iter().for_each(|path| print::status(path.display()));
    Ok(ExitCode::SUCCESS)
}

/// Writes files into a folder, under their own names.
pub fn write_into(folder: &Path, files: Vec<Artifact>) -> ExitResult {
    let _lock = FolderLock::take(folder)?;
    list_files(exporters::write_artifacts(folder, files)?)
}

/// What a run is asked to measure.
pub fn request(args: RunArgs) -> Request {
    // Values of axes name cells, in records and on pages.
    let shown = |(name, values): (String, Vec<String>)| {
        (name, values.iter().map(|value| private::relative(value)).collect())
    };
    Request {
        experiments: args.experiments,
        given: None,
        axes: args.axis.into_iter().map(shown).collect(),
        sets: args.set,
        cells: args.cell,
        part: args.shard,
    }
}

/// What each size of a sweep costs; nothing where there is no sweep.
fn print_sizes(view: &Report<'_>) {
    let parts = report::sizes::parts(view, &|_, _| None);
    if !parts.is_empty() {
        print::answer(report::document::terminal(&parts));
    }
}

/// The files that a person opens first.
fn print_pages(files: &[PathBuf]) {
    let is_first = |path: &&PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str());
        name.is_some_and(|name| [report::PAGE.file, report::SUMMARY.file].contains(&name))
    };
    files.iter().filter(is_first).for_each(|path| print::status(path.display()));
}

/// From now on a first interrupt sets [`INTERRUPT`], and a second one ends the process.
pub fn watch_interrupts() -> anyhow::Result<()> {
    ctrlc::set_handler(|| {
        if INTERRUPT.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED.into());
        }
        print::note("ending with what is measured so far; interrupt again to abort");
    })
    .context("cannot watch for Ctrl-C")
}

fn print_summary(summary: &Summary, resuming: &str) {
    let Summary {
        counts: OutcomeCounts { measured, skipped, failed, over_budget }, kept, end, ..
    } = summary;
    print::status(format!(
        "{measured} cells measured, {skipped} skipped, {failed} failed, {kept} kept from before"
    ));
    if *over_budget > 0 {
        print::status(format!(
            "{over_budget} cells not run or not finished; `{resuming}` goes on with them"
        ));
    }
    print::status(format!(
        "{:.1} s of set-up, {:.1} s of measuring; frames took {:.1} s, {:.0} % of the time",
        end.set_up_s,
        end.measuring_wall_s,
        end.measured_gpu_s,
        100.0 * end.measured_share()
    ));
    if let Some(bytes) = end.peak_memory_bytes {
        print::status(format!("{:.2} GiB of memory at most", bytes as f64 / f64::from(1 << 30)));
    }
}

/// The clocks that `run` would use here.
pub fn audit(catalog: &Catalog, args: &AnswerArgs) -> ExitResult {
    let options = gpu_options(catalog, &args.adapter);
    on_one_core(&options)?;
    let gpu = Gpu::open(&options)?;
    let of_run = gpu::audit_all(&gpu)?;
    let by_cpu = PassKind::TIMED.iter().any(|kind| of_run.plan.clock(*kind) == Clock::ProcessCpu);
    let loop_limit = gpu::measure_loop_turns(&gpu)?;
    if args.json {
        let mut answer = audit_json(&of_run);
        answer["adapter"] = json!(gpu.adapter);
        answer["loop_turns"] = json!(loop_limit);
        return print_json(&answer);
    }
    let cores = quiet::allowed_cores();
    let pinned =
        if by_cpu { format!(" on core {}", cores.iter().join(", ")) } else { String::new() };
    print::answer(format!("{} ({})", gpu.adapter.title(), gpu.adapter.driver_info));
    print::answer(format!("\nClocks of `fathom run`{pinned}:\n{}", gpu::audit_table(&of_run)));
    print::answer(gpu::describe_loop_turns(loop_limit));
    Ok(ExitCode::SUCCESS)
}

fn audit_json(audit: &Audit) -> Value {
    let cost = audit.plan.submit_cost;
    json!({
        "clocks": record::Clocks::from(PassKind::TIMED.map(|kind| (kind, audit.plan.clock(kind)))),
        "audit": audit.rows,
        "submit_cost_ns": BTreeMap::from(PassKind::TIMED.map(|kind| (kind, cost.ns(kind)))),
    })
}

pub fn print_json(answer: &impl Serialize) -> ExitResult {
    print::answer(serde_json::to_string_pretty(answer)?);
    Ok(ExitCode::SUCCESS)
}

pub fn ceilings(catalog: &Catalog, args: &AnswerArgs) -> ExitResult {
    let options = gpu_options(catalog, &args.adapter);
    on_one_core(&options)?;
    let gpu = Gpu::open(&options)?;
    let answer = ceilings::measure_all(&gpu, gpu::audit_all(&gpu)?.plan)?;
    if args.json {
        print_json(&answer)?;
    } else {
        print::answer(format!("{}\n{answer}", text::line(&answer.adapter)));
    }
    exit_code(answer.unsound.is_empty())
}

pub fn verify(catalog: &Catalog, filter: Option<&str>, args: &AnswerArgs) -> ExitResult {
    let gpu = Gpu::open(&gpu_options(catalog, &args.adapter))?;
    let cases = catalog.cases();
    let Verified { checks, skipped } =
        verifying::verify(&gpu, &cases, filter, |ended| print::note(ended))?;
    if let (true, Some(SkippedCase { reason, .. })) = (checks.is_empty(), skipped.first()) {
        anyhow::bail!("every check was skipped; {reason}");
    }
    let all_sound = checks.iter().all(verifying::Check::is_sound);
    if args.json {
        print_json(&json!({
            "adapter": gpu.adapter, "all_sound": all_sound, "checks": checks, "skipped": skipped
        }))?;
    } else {
        print::answer(verifying::CheckTable(&checks));
        for SkippedCase { stage, what, reason } in skipped {
            print::answer(format!("skipped {stage} {what}: {reason}"));
        }
    }
    exit_code(all_sound)
}

pub fn fetch(names: &[String]) -> ExitResult {
    let mut failed = false;
    for result in assets::fetch(names) {
        match result {
            Ok(AssetStatus { asset, origin, .. }) => {
                print::status(format!("{}: {origin} ({})", asset.name, asset.about));
            }
            Err(error) => {
                super::fail(&error);
                failed = true;
            }
        }
    }
    Ok(if failed { ExitCode::from(super::COULD_NOT_RUN) } else { ExitCode::SUCCESS })
}

pub fn render(catalog: &Catalog, args: RenderArgs) -> ExitResult {
    match (&args.figure, &args.scene) {
        (Some(name), _) => render_figures(catalog, &args, name),
        (None, Some(scene)) => render_scene(catalog, &args, scene),
        (None, None) => anyhow::bail!("give a scene, or --figure NAME"),
    }
}

fn render_scene(catalog: &Catalog, args: &RenderArgs, scene: &str) -> ExitResult {
    let gpu = Gpu::open(&gpu_options(catalog, &args.adapter))?;
    let mut subjects = Subjects::new(catalog).with_capacity(&gpu.capacity);
    let subject = subjects.subject(&args.pipeline, scene, &args.set)?;
    let path = args.output.clone().unwrap_or_else(|| {
        let stem = Path::new(scene).file_stem().unwrap_or_default();
        PathBuf::from(stem).with_extension("png")
    });
    let frame = RenderedFrame::new(&gpu, &subject, args.samples.unwrap_or(1))?;
    picture::write_to(&frame.image(&gpu)?, &path)?;
    list_files([path])
}

/// The panels of each figure, and a page of all of them. A figure that cannot be rendered does not keep the others from it.
fn render_figures(catalog: &Catalog, args: &RenderArgs, name: &str) -> ExitResult {
    let (figures, several) = PaperFigure::find(&catalog.figures, name)?;
    let folder = args.output.clone().unwrap_or_else(|| PathBuf::from(FIGURES_FOLDER));
    let _lock = FolderLock::take(&folder)?;
    let mut gpu = Gpu::open(&gpu_options(catalog, &args.adapter))?;
    gpu.capacity = gpu.capacity.for_figures();
    let (mut sections, mut failed) = (Vec::new(), false);
    for figure in &figures {
        let mut subjects = Subjects::new(catalog).with_capacity(&gpu.capacity);
        match figure.render(&gpu, &mut subjects, &args.set, args.samples) {
            Ok(panels) => {
                for (panel, number) in panels.iter().zip(0..) {
                    let path = figures::panel_file(&folder, figure, number);
                    picture::write_to(&panel.picture, &path)?;
                    print::status(path.display());
                }
                sections.push(sheet::section(figure, &panels));
            }
            Err(error) if several => {
                print::error(error);
                failed = true;
            }
            Err(error) => return Err(error),
        }
    }
    let page = format!("{name}.html");
    folder::write(&folder.join(&page), sheet::page(name, &sections).as_bytes())?;
    print::status(folder.join(page).display());
    exit_code(!failed)
}

pub fn dump(catalog: &Catalog, args: DumpArgs) -> ExitResult {
    let gpu = Gpu::open(&gpu_options(catalog, &args.adapter))?;
    let mut subjects = Subjects::new(catalog).with_capacity(&gpu.capacity);
    let subject = subjects.subject(&args.pipeline, &args.scene, &args.set)?;
    let _lock = FolderLock::take(&args.output)?;
    let dumped = dumping::dump(&gpu, &subject, &args.stage, &args.output);
    let runs_it = |name: &&str| {
        let stages = catalog.stages_of(name).unwrap_or_default();
        stages.iter().any(|stage| stage.name == args.stage)
    };
    list_files(dumped.map_err(|error| {
        if runs_it(&&*args.pipeline) {
            return error;
        }
        match catalog.kinds.iter().map(|kind| kind.name).filter(runs_it).join(", ") {
            names if names.is_empty() => error,
            names => anyhow::anyhow!("{error}; with --pipeline it is run by {names}"),
        }
    })?)
}

/// Of one folder all its files, beside its records. Of several, or into another folder, one page.
pub fn report(folders: Vec<PathBuf>, out: Option<PathBuf>, png: bool) -> ExitResult {
    if let ([folder], None) = (folders.as_slice(), &out) {
        return list_files(report_of(folder, png)?);
    }
    anyhow::ensure!(!png, "--png is for the plots of one folder, without --out");
    let out = out.context(
        "several folders make one page: say with --out where to write it; `fathom compare OLD NEW` prints what changed between two runs",
    )?;
    write_into(&out, vec![exporters::ReportFolders::read(&folders)?.page()])
}

/// The sound records of a folder; the others are named. `hint` ends with the name of the file that should be there.
pub fn sound(output: &OutputFolder, hint: &str) -> anyhow::Result<RecordFile> {
    let reading =
        record::read_good(&output.records()).with_context(|| format!("{hint} {RECORDS}"))?;
    reading.damaged.notice(&output.records()).into_iter().for_each(print::note);
    Ok(reading)
}

fn report_of(folder: &Path, png: bool) -> anyhow::Result<Vec<PathBuf>> {
    let output = OutputFolder { folder: folder.to_owned() };
    let reading = sound(&output, "a run's folder holds its records in")?;
    let _lock = FolderLock::take(folder)?;
    let png = png.then(Rasterizer::new).transpose()?;
    exporters::write(&output.folder, reading, png.as_ref())
}

pub fn worker(catalog: &Catalog, WorkerArgs { set, adapter }: WorkerArgs) -> ExitResult {
    let fields: Vec<_> = catalog.kinds.iter().flat_map(|kind| (kind.fields)()).collect();
    for (path, _) in &set {
        let hint = text::did_you_mean(path, fields.iter().map(|field| &*field.path));
        ensure!(fields.iter().any(|field| field.path == *path), "no pipeline has `{path}`{hint}");
    }
    let (input, output) = (std::io::stdin().lock(), std::io::stdout().lock());
    worker::serve(&gpu_options(catalog, &adapter), catalog, &set, input, output)?;
    Ok(ExitCode::SUCCESS)
}

pub fn gpu_options(catalog: &Catalog, args: &AdapterArgs) -> gpu::Options {
    gpu::Options { shaders: Some(catalog.shaders.clone()), ..args.options() }
}
