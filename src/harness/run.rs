//! `fathom run`: experiments in turn, a record after every cell. Reports are made of the records by whoever wants them.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Result, bail, ensure};

use super::catalog::Catalog;
use super::executor::{self, CellExecutor, Output, Session, Spent};
use super::journal::Journal;
use super::outcome::Counts;
use super::plan::{self, PlannedExperiment, Request};
use super::progress::Progress;
use super::sample::{self, Settings};
use super::{ceilings, memory, shard};
use fathom_base::{quiet, tell};
use fathom_experiments::Experiment;
use fathom_gpu as gpu;
use fathom_gpu::{Audit, ClockPlan, Gpu};
use fathom_record as record;
use fathom_record::calendar;
use fathom_record::output::Held;
use fathom_record::{
    Conditions, Definition, End, Note, NoteKind, Outcome, Part, PassKind, Profile, Record,
    RecordError, Run, SCHEMA, SampleLine, SetUp, ShaderChecks, Shard,
};

/// Memory of the cells that are prepared at the same time. On a software driver it is the process's own,
/// which is to stay below 2 GiB.
const SOFTWARE_GROUP_BYTES: u64 = 512 << 20;
const GPU_GROUP_BYTES: u64 = 2 << 30;

/// What to run and how. `None` means the profile's own value.
#[derive(Clone, Debug, Default)]
pub struct Options {
    pub catalog: Catalog,
    pub gpu: gpu::Options,
    pub request: Request,
    /// By default that of the run to resume, else quick on a software adapter and paper on a GPU.
    pub profile: Option<Profile>,
    /// Time for all cells together, seconds.
    pub budget_s: Option<f64>,
    /// Half the width of the frame time's 95 % interval over its median.
    pub precision: Option<f64>,
    pub out: Option<PathBuf>,
    pub resume: bool,
    /// Seed of the order of cells and frames.
    pub seed: Option<u64>,
    /// The adapter's limits are not measured.
    pub no_ceilings: bool,
    /// The command line, for the record.
    pub command: Vec<String>,
}

/// What came of a run.
#[derive(Clone, Debug)]
pub struct Summary {
    pub out: PathBuf,
    pub counts: Counts,
    /// Why the first skipped cell was.
    pub skip_reason: Option<String>,
    /// Cells of an earlier run that were not measured again.
    pub kept: usize,
    pub end: End,
}

/// Measures what `options` ask for and writes records. When `interrupted` is set, what has been
/// measured so far is written and the run ends.
pub fn run(options: &Options, interrupted: &AtomicBool) -> Result<Summary> {
    let start = Instant::now();
    check(options)?;
    spread_references();
    let experiments = options.request.load(&options.catalog)?;
    let resumed = options.resume.then(|| Held::resume(options.out.as_deref())).transpose()?;
    let mut spent = Spent::default();
    let now = spent.since(start, SetUp::Scenes);
    let gpu = Gpu::open(&options.gpu)?;
    let now = spent.since(now, SetUp::Device);
    let profile = profile(options, resumed.as_ref(), &gpu);
    let part = options.request.part;
    let shard = part.map(|part| shard::of(part, &experiments, &options.request, profile));
    let shard = shard.transpose()?;
    if let Some(held) = &resumed {
        same_shard(held, shard.as_ref())?;
    }
    let mut planned =
        plan::plan(experiments, &options.request, profile, &gpu.capacity, &options.catalog)?;
    let held = match resumed {
        Some(held) => held,
        None => Held::create(options.out.as_deref(), &gpu.adapter.name, profile)?,
    };
    let now = spent.since(now, SetUp::Scenes);
    let audit = gpu::audit_all(&gpu)?;
    spent.since(now, SetUp::Audit);
    let seed = options.seed.unwrap_or_else(|| u64::from(rand::random::<u32>()));
    let mut header = Run { shard, ..header(options, &gpu, &audit, profile, seed) };
    header.loop_turns = Some(gpu::loop_turns(&gpu)?);
    let finished = record::finished(&held.before, &header);
    let kept = plan::drop_finished(&mut planned, &finished);
    let (mut journal, damage) = Journal::open(&held.output.samples())?;
    journal.settle(finished.iter().map(|key| SampleLine::id(&header, key)));
    let ids = ids(&planned, &header);
    let plan = clock_plan(&mut header, audit.plan, &mut journal, &ids);
    let now = Instant::now();
    if !options.no_ceilings {
        header.ceilings = ceilings::of_run(&gpu, plan, &header, &held.before)?;
    }
    spent.since(now, SetUp::Ceilings);
    let settings = settings(options, profile, &planned, seed, gpu.adapter.software);
    let total = planned.iter().map(|experiment| experiment.cells.len()).sum();
    let progress = Progress::new(total, settings.budget_s);
    let mut measurement = Measurement {
        settings,
        session: Session::new(gpu, options.gpu.clone(), (plan, header.ceilings.clone()), spent)?,
        round: next_round(&held.before, &journal).max(part.map_or(0, Part::first_round)),
        output: Output { held, header, journal, progress },
        interrupted,
    };
    measurement.begin(&damage, &ids)?;
    measurement.measure(&planned)?;
    measurement.end(start, kept)
}

/// A folder is gone on with as the part of the run that it was begun as.
fn same_shard(held: &Held, asked: Option<&Shard>) -> Result<()> {
    let told = |shard: Option<&Shard>| match shard {
        Some(shard) => format!("shard {} of the plan {}", shard.part, shard.plan),
        None => "a whole run".to_owned(),
    };
    let asked = told(asked);
    let runs = held.before.iter().filter_map(Record::try_as_run_ref);
    if let Some(holds) = runs.map(|run| told(run.shard.as_ref())).find(|holds| *holds != asked) {
        let folder = held.output.folder.display();
        bail!("{folder} holds {holds}, and not {asked}: resume it with the command that began it");
    }
    Ok(())
}

/// A round that no sample of these records or samples has.
fn next_round(before: &[Record], journal: &Journal) -> u32 {
    let cells = before.iter().filter_map(Record::try_as_cell_ref);
    let rounds = cells.filter_map(|cell| cell.measured()).flat_map(|cell| &cell.frame.rounds);
    let last = rounds.copied().max().max(journal.last_round());
    last.map_or(0, |last| last + 1)
}

/// References are computed by all cores, though the driver has one.
fn spread_references() {
    let threads = quiet::cores_before().len();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    // A pool that is there already stays.
    let _ = pool.start_handler(|_| quiet::spread()).build_global();
}

/// What the journal calls the cells that are due.
fn ids(planned: &[PlannedExperiment], header: &Run) -> Vec<String> {
    let cells = planned.iter().flat_map(|experiment| &experiment.cells);
    cells.map(|cell| executor::name(header, cell).id).collect()
}

/// The audit's plan, but by the clocks of the samples that are gone on with. The header says by which, and where they are not those
/// that this run's audit found.
fn clock_plan(
    header: &mut Run,
    found: ClockPlan,
    journal: &mut Journal,
    ids: &[String],
) -> ClockPlan {
    let clocks = PassKind::TIMED.map(|kind| (kind, found.clock(kind)));
    let chosen = journal.choose_clocks(ids, clocks.into());
    let plan = chosen.iter().fold(found, |plan, (kind, clock)| plan.with(*kind, *clock));
    header.clocks = PassKind::TIMED.map(|kind| (kind, plan.clock(kind))).into();
    if !plan.has_clocks_of(&found) {
        let text = "passes are timed by the clocks that the audit of the resumed run chose";
        header.notes.push(Note::new(NoteKind::OtherClocks, text));
    }
    plan
}

fn check(options: &Options) -> Result<()> {
    let given = [("--budget", options.budget_s), ("--precision", options.precision)];
    for (name, value) in given {
        let value = value.unwrap_or(1.0);
        ensure!(value.is_finite() && value > 0.0, "{name} must be a positive number, not {value}");
    }
    Ok(())
}

fn profile(options: &Options, resumed: Option<&Held>, gpu: &Gpu) -> Profile {
    let before = resumed.map_or(&[][..], |held| &held.before);
    let resumed = before.iter().rev().find_map(Record::try_as_run_ref).map(|run| run.profile);
    let default = if gpu.adapter.software { Profile::Quick } else { Profile::Paper };
    options.profile.or(resumed).unwrap_or(default)
}

fn header(options: &Options, gpu: &Gpu, audit: &Audit, profile: Profile, seed: u64) -> Run {
    let order = format!("cells and frames in an order drawn from the seed {seed}");
    let of_adapter = gpu.notes.iter().map(|text| Note::new(NoteKind::Adapter, text));
    Run {
        schema: SCHEMA,
        fathom_version: env!("CARGO_PKG_VERSION").to_owned(),
        build: Some(options.catalog.build()),
        started_at: calendar::now(),
        profile,
        precision: Some(options.precision.unwrap_or(profile.precision())),
        command: options.command.clone(),
        adapter: record::Adapter {
            host_threads: quiet::cores_before().len().max(1),
            ..gpu.adapter.clone()
        },
        conditions: Conditions::here(),
        clocks: record::Clocks::new(),
        shader_checks: if gpu.unchecked { ShaderChecks::Unchecked } else { ShaderChecks::Checked },
        audit: audit.rows.clone(),
        submit_cost_ns: PassKind::TIMED.map(|kind| (kind, audit.plan.submit_cost.of(kind))).into(),
        loop_turns: None,
        ceilings: Vec::new(),
        shard: None,
        notes: of_adapter.chain([Note::new(NoteKind::Order, order)]).collect(),
    }
}

fn settings(
    options: &Options,
    profile: Profile,
    planned: &[PlannedExperiment],
    seed: u64,
    software: bool,
) -> Settings {
    let (per_cell_s, most_s): (f64, f64) = match profile {
        // All experiments within eight minutes, set-up included.
        Profile::Quick => (6.0, 500.0),
        Profile::Paper => (20.0, 1_800.0),
    };
    let cells: f64 = planned.iter().map(weight).sum();
    Settings {
        precision: options.precision.unwrap_or(profile.precision()),
        budget_s: options.budget_s.unwrap_or((cells * per_cell_s).min(most_s)),
        first_round: 0,
        group_bytes: if software { SOFTWARE_GROUP_BYTES } else { GPU_GROUP_BYTES },
        seed,
    }
}

/// Cells that are timed, each as many times as its experiment's weight.
fn weight(planned: &PlannedExperiment) -> f64 {
    let cells = planned.cells.iter();
    let timed = cells.filter(|cell| cell.skip.is_none() && !cell.plan.errors_only).count();
    planned.experiment.weight * timed as f64
}

struct Measurement<'a> {
    session: Session,
    output: Output,
    settings: Settings,
    /// Number of the next round of samples.
    round: u32,
    interrupted: &'a AtomicBool,
}

impl Measurement<'_> {
    /// Writes the header, and says what of an earlier run was damaged and what is gone on with.
    fn begin(&mut self, damage: &[String], ids: &[String]) -> Result<()> {
        let Output { held, header, journal, .. } = &mut self.output;
        held.writer.write(&Record::Run(Box::new(header.clone())))?;
        held.notices.iter().chain(damage).for_each(tell::note);
        let (pairs, cells) = journal.earlier_pairs(ids);
        if pairs > 0 {
            tell::note(format!("continuing from {pairs} pairs of frames of {cells} cells"));
        }
        Ok(())
    }

    fn measure(&mut self, planned: &[PlannedExperiment]) -> Result<()> {
        let start = Instant::now();
        let is_shard = self.output.header.shard.is_some();
        if is_shard {
            // Merging needs all of them, to tell which cells are missing.
            planned.iter().try_for_each(|planned| self.define(&planned.experiment))?;
        }
        let mut weight_left: f64 = planned.iter().map(weight).sum();
        for (index, planned) in planned.iter().enumerate() {
            if planned.cells.is_empty() {
                continue;
            }
            if self.interrupted.load(Ordering::Relaxed) {
                break;
            }
            if !is_shard {
                self.define(&planned.experiment)?;
            }
            let left_s = self.settings.budget_s - start.elapsed().as_secs_f64();
            let settings = Settings {
                budget_s: (left_s * weight(planned) / weight_left.max(1e-9)).max(0.0),
                seed: self.settings.seed.wrapping_add(index as u64),
                first_round: self.round,
                ..self.settings
            };
            self.cells(planned, &settings)?;
            self.session.gpu.forget_pipelines();
            weight_left -= weight(planned);
        }
        self.output.progress.end();
        Ok(())
    }

    /// Records an experiment's text before its first cell, once.
    fn define(&mut self, experiment: &Experiment) -> Result<(), RecordError> {
        let definition = Record::Experiment(Definition {
            id: experiment.id.clone(),
            toml: experiment.text.clone(),
        });
        if self.output.held.before.contains(&definition) {
            return Ok(());
        }
        self.output.held.writer.write(&definition)
    }

    /// Records the cells that are skipped, and samples the others.
    fn cells(&mut self, planned: &PlannedExperiment, settings: &Settings) -> Result<()> {
        let mut due = Vec::new();
        for (index, cell) in planned.cells.iter().enumerate() {
            match cell.skip.clone() {
                None => due.push(index),
                Some(reason) => self.output.finish(&cell.record(Outcome::Skipped { reason }))?,
            }
        }
        let (session, output) = (&mut self.session, &mut self.output);
        let mut executor = CellExecutor::new(session, output, planned, settings.precision);
        self.round = sample::sample(&mut executor, &due, settings, self.interrupted)?;
        Ok(())
    }

    fn end(self, start: Instant, kept: usize) -> Result<Summary> {
        let parts_s = self.session.spent.set_up_s.clone();
        let set_up_s = parts_s.values().sum();
        let end = End {
            measuring_wall_s: start.elapsed().as_secs_f64() - set_up_s,
            measured_gpu_s: self.session.spent.frames_ns * 1e-9,
            set_up_s,
            set_up_parts_s: parts_s,
            peak_memory_bytes: memory::peak_bytes(),
            interrupted: self.interrupted.load(Ordering::Relaxed),
        };
        let Output { mut held, journal, .. } = self.output;
        held.writer.write(&Record::End(end.clone()))?;
        journal.end()?;
        let records = record::read(&held.output.records())?.records;
        Ok(summary(held.output.folder, &records, end, kept))
    }
}

/// Counts the cells after the last header.
fn summary(out: PathBuf, records: &[Record], end: End, kept: usize) -> Summary {
    let since = records.iter().rposition(|record| record.try_as_run_ref().is_some()).unwrap_or(0);
    let cells = || records[since..].iter().filter_map(Record::try_as_cell_ref).map(Box::as_ref);
    let skip_reason = cells().find_map(|cell| match &cell.outcome {
        Outcome::Skipped { reason } => Some(reason.clone()),
        _ => None,
    });
    Summary { out, counts: Counts::of(cells()), skip_reason, kept, end }
}
