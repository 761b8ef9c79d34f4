//! `fathom run`: measures batches of cells in the order of [`schedule`](super::schedule), writes a record after every cell and a report
//! from time to time. The time budget covers all of it, set-up included.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use super::catalog::Catalog;
use super::cell_progress::{CellProgress, ComputedFigures, Done};
use super::executor::{self, CellExecutor, RunTimes, Session};
use super::plan::{self, GIVEN, PlannedCell, PlannedExperiment, Request};
use super::progress::Progress;
use super::reports::{MakeReport, Reports, RunOutput};
use super::sample::{self, Settings};
use super::schedule::{Batch, CellCosts, CellState, ClaimUnit, MAX_VISITS, Next, Schedule};
use super::sweep::SOURCE;
use super::{ceilings, memory};
use fathom_base::folder::Dir;
use fathom_base::visits::{MIN_SPAN_S, MIN_VISITS, VISIT_S};
use fathom_base::{print, private, quiet};
use fathom_clock::Samples;
use fathom_experiments::{CellPlan, Experiment};
use fathom_gpu as gpu;
use fathom_gpu::{Audit, ClockPlan, Gpu, GpuError, Pacer};
use fathom_record as record;
use fathom_record::calendar;
use fathom_record::command::{resuming, run_options, split_options};
use fathom_record::output::Recording;
use fathom_record::{
    Build, Cell, Conditions, Definition, Earlier, End, FolderLock, Note, NoteKind, Outcome,
    OutcomeCounts, Part, PassKind, Profile, Record, RecordError, Run, SCHEMA, SetUp, ShaderChecks,
};

/// Memory of the cells that are prepared at the same time. On a software driver it is the process's own,
/// which is to stay below 2 GiB.
const SOFTWARE_GROUP_BYTES: u64 = 512 << 20;
pub const GPU_GROUP_BYTES: u64 = 2 << 30;

/// Least budget of a run that measures the adapter's limits, which takes 6 s on llvmpipe.
const MIN_BUDGET_OF_CEILINGS_S: f64 = 60.0;
/// Of a budget that is proposed: what was foreseen varies.
const BUDGET_RESERVE: f64 = 1.2;
/// Between two looks whether a run that waits was interrupted, seconds.
const WAIT_S: f64 = 0.1;
/// What a default budget has for set-up beside the time of its cells.
const SET_UP_S: f64 = 30.0;
/// What it has for them at least: visits that span less than a minute settle nothing.
const MIN_MEASURING_S: f64 = MIN_SPAN_S + VISIT_S;

/// What to run and how. `None` means the profile's own value.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    pub catalog: Catalog,
    pub gpu: gpu::Options,
    pub request: Request,
    /// By default that of the run to resume, else quick on a software adapter and paper on a GPU.
    pub profile: Option<Profile>,
    /// Time for the whole command, seconds.
    pub budget_s: Option<f64>,
    /// To each cell at most; an interval takes four.
    pub visits: Option<u32>,
    pub out: Option<PathBuf>,
    pub resume: bool,
    /// Seed of the order of cells and frames.
    pub seed: Option<u64>,
    /// The adapter's limits are not measured.
    pub no_ceilings: bool,
    /// Cores that work beside the adapter: by default none beside a software driver, and else all but one.
    pub workers: Option<usize>,
    /// The command line, for the record.
    pub command: Vec<String>,
}

/// What came of a run.
#[derive(Debug)]
pub struct Summary {
    pub out: PathBuf,
    /// Of the folder, which reports are written to.
    pub lock: FolderLock,
    pub counts: OutcomeCounts,
    /// Why the first skipped cell was.
    pub skip_reason: Option<String>,
    /// Cells of an earlier run that were not measured again.
    pub kept: usize,
    pub end: End,
}

/// Measures what `options` ask for and writes records, since `start`. When `interrupted` is set, what has been
/// measured so far is written and the run ends.
pub fn run(
    options: &RunOptions,
    start: Instant,
    report: MakeReport,
    interrupted: &AtomicBool,
) -> Result<Summary> {
    spread_references();
    let experiments = options.request.load(&options.catalog)?;
    let asked = asked(&options.request, &experiments);
    let resumed = options.resume.then(|| Recording::resume(options.out.as_deref())).transpose()?;
    let mut spent = RunTimes::default();
    let now = spent.since(start, SetUp::Scenes);
    let gpu = Gpu::open(&options.gpu)?;
    let now = spent.since(now, SetUp::Device);
    let profile = profile(options, resumed.as_ref(), &gpu);
    let part = options.request.part;
    if let Some(held) = &resumed {
        check_same_request(held, &options.command, &asked, &experiments)?;
    }
    let in_time = || match options
        .budget_s
        .filter(|budget_s| start.elapsed().as_secs_f64() >= *budget_s)
    {
        None => Ok(()),
        Some(budget_s) => bail!(
            "the time budget of {budget_s} s was over before a cell could be begun: give a longer --budget"
        ),
    };
    let (request, catalog) = (&options.request, &options.catalog);
    let mut planned = plan::plan(experiments, request, profile, &gpu.capacity, catalog, &in_time)?;
    in_time()?;
    let held = match resumed {
        Some(held) => held,
        None => Recording::create(options.out.as_deref(), &gpu.adapter.title(), profile)?,
    };
    for of in planned.iter().map(|of| &of.experiment).filter(|_| !options.resume) {
        let Some(name) = own_file(of).filter(|name| asked.contains(name)) else { continue };
        let folder = Dir::make(&held.output.folder);
        let written = folder.and_then(|folder| folder.write_own(&name, of.text.as_bytes()));
        written.with_context(|| format!("cannot write {name}"))?;
    }
    let now = spent.since(now, SetUp::Scenes);
    let audit = gpu::audit_all(&gpu)?;
    let seed = options.seed.unwrap_or_else(|| u64::from(rand::random::<u32>()));
    let mut header = header(options, &gpu, &audit, profile, seed);
    (header.shard, header.experiments) = (part, Some(asked));
    header.loop_turns = in_time().is_ok().then(|| gpu::measure_loop_turns(&gpu)).transpose()?;
    let now = spent.since(now, SetUp::Audit);
    let plan = clock_plan(&mut header, audit.plan, &held.before);
    let earlier = record::earlier(&held.before, &header);
    let finished = finished(&planned, &earlier);
    plan::drop_finished(&mut planned, &earlier);
    let crashed = fail_crashed_cells(&mut planned, &held.before, &header, &earlier);
    let progress: Vec<CellProgress> =
        planned.iter().map(|planned| CellProgress::new(planned, &held.before, &earlier)).collect();
    let schedule = schedule(&planned, &progress, options.visits.unwrap_or(MAX_VISITS) as usize);
    let budget_s =
        options.budget_s.unwrap_or_else(|| default_budget_s(profile, &planned, &schedule));
    let now = spent.since(now, SetUp::Scenes);
    if !options.no_ceilings {
        let is_short = budget_s < MIN_BUDGET_OF_CEILINGS_S || in_time().is_err();
        measure_limits(&gpu, plan, &mut header, &held.before, is_short)?;
    }
    let pacer = Pacer::new(&gpu, plan)?;
    spent.since(now, SetUp::Ceilings);
    let mut measurement = Measurement {
        group_bytes: if gpu.adapter.software { SOFTWARE_GROUP_BYTES } else { GPU_GROUP_BYTES },
        seed,
        round: next_round(&held.before).max(part.map_or(0, Part::first_round)),
        session: Session::new(
            gpu,
            options.gpu.clone(),
            (plan, pacer),
            header.ceilings.clone(),
            options.workers,
            spent,
        )?,
        output: RunOutput {
            start,
            records: held.before.clone(),
            folder: held,
            header,
            progress: Progress::new(schedule.all().count(), start, budget_s),
            reports: Reports::new(report, budget_s),
        },
        planned: &planned,
        finished,
        progress,
        schedule,
        interrupted,
        is_budget_told: false,
    };
    measurement.begin()?;
    measurement.output.finish_all(crashed)?;
    measurement.is_budget_told = options.budget_s.is_none();
    measurement.measure()?;
    measurement.end()
}

/// Resume keys of the planned cells that an earlier run has finished.
fn finished(
    planned: &[PlannedExperiment],
    earlier: &BTreeMap<String, Earlier<'_>>,
) -> BTreeSet<String> {
    let keys = planned.iter().flat_map(|planned| &planned.cells).map(|cell| &cell.resume_key);
    keys.filter(|key| earlier.get(*key).is_some_and(Earlier::is_finished)).cloned().collect()
}

/// Puts the adapter's limits into the header, or why they were not measured. A fault that leaves the device does not keep it from
/// the cells.
fn measure_limits(
    gpu: &Gpu,
    plan: ClockPlan,
    header: &mut Run,
    before: &[Record],
    is_short: bool,
) -> Result<()> {
    let measured = (!is_short).then(|| ceilings::load_or_measure(gpu, plan, header, before));
    let reason = match measured.transpose() {
        Ok(Some(ceilings)) => {
            header.ceilings = ceilings;
            return Ok(());
        }
        Ok(None) => "the time budget is too short".to_owned(),
        Err(GpuError::Device(error)) if gpu.loss_reason().is_none() => error.to_string(),
        Err(error) => return Err(error.into()),
    };
    let text = format!("the adapter's limits were not measured: {reason}");
    header.notes.push(Note::new(NoteKind::NoCeilings, text));
    Ok(())
}

/// Marks cells that crashed two processes as failed: takes them out of the plan and gives their records. Cells with samples did not crash.
fn fail_crashed_cells(
    planned: &mut [PlannedExperiment],
    before: &[Record],
    header: &Run,
    earlier: &BTreeMap<String, Earlier<'_>>,
) -> Vec<Cell> {
    let crashed = record::crashed_cells(before);
    let has_crashed = |cell: &PlannedCell| {
        !earlier.contains_key(&cell.resume_key)
            && !crashed.is_empty()
            && crashed.contains(&executor::begin_record(header, cell).id)
    };
    let reason = "two processes ended while they built it or rendered its first frame";
    let failed = |cell: PlannedCell| cell.record(Outcome::Failed { reason: reason.to_owned() });
    let of = |planned: &mut PlannedExperiment| -> Vec<Cell> {
        planned.cells.extract_if(.., |cell| has_crashed(cell)).map(failed).collect()
    };
    planned.iter_mut().flat_map(of).collect()
}

/// Of a run that goes on with what is known.
pub fn schedule(
    planned: &[PlannedExperiment],
    known: &[CellProgress],
    max_visits: usize,
) -> Schedule {
    let state = |(index, cell): (usize, &PlannedCell), known: &CellProgress| {
        let samples = known.samples.get(&index);
        CellState {
            pipeline: cell.plan.pipeline.clone(),
            declared_s: cell.declared_s,
            untimed: cell.plan.errors_only,
            recorded: cell.skip.is_some() || known.findings.contains_key(&index),
            is_excluded: cell.skip.is_some(),
            visits: samples.map_or(0, Samples::count_visits),
            visited_s: f64::NEG_INFINITY,
            half_width: samples.map_or(0.0, Samples::relative_half_width),
            costs: CellCosts::default(),
        }
    };
    let states = planned.iter().zip(known).map(|(planned, known)| {
        planned.cells.iter().enumerate().map(|cell| state(cell, known)).collect()
    });
    let units = planned.iter().enumerate().flat_map(|(experiment, planned)| {
        let plans: Vec<CellPlan> = planned.cells.iter().map(|cell| cell.plan.clone()).collect();
        let units = planned.experiment.units(&plans).into_iter();
        let unit = |cells: Vec<usize>| {
            let claims = planned.experiment.claims_on(&plans, &cells);
            ClaimUnit { experiment, cells, claims, is_promised: false }
        };
        units.map(unit).collect::<Vec<_>>()
    });
    let (cells, units) = (states.collect(), units.collect());
    let first = plan::first_cells(planned);
    let sweeps = plan::sweeps(planned);
    Schedule { cells, units, first, sweeps, max_visits }
}

/// A resumed run has the experiments, settings and part that it was begun with: figures of several would stand beside each other.
fn check_same_request(
    held: &Recording,
    command: &[String],
    asked: &Vec<String>,
    experiments: &[Experiment],
) -> Result<()> {
    const SETTINGS: [(&str, bool); 2] = [("--set", true), ("--shard", true)];
    let (records, folder) = (&held.before, held.output.folder.to_string_lossy());
    let Some(run) = records.iter().rev().find_map(Record::try_as_run_ref) else { return Ok(()) };
    let settings = |words: &[String]| split_options(&run_options(words), &SETTINGS).0;
    let is_asked = run.experiments.as_ref().map_or(!asked.is_empty(), |before| before == asked);
    let mut before = records.iter().filter_map(Record::try_as_experiment_ref);
    // Where a path begins depends on where the command ran, and its last part does not.
    let named = |of: &Experiment| {
        let scene = Path::new(&of.scene).file_name().unwrap_or_default().display().to_string();
        Experiment { scene, text: String::new(), about: String::new(), ..of.clone() }
    };
    let is_same = |old: &Definition| {
        let parsed = Experiment::parse(&old.id, &old.toml).map(|old| named(&old)).ok();
        experiments.iter().all(|of| of.id != old.id || parsed.as_ref() == Some(&named(of)))
    };
    if is_asked && settings(command) == settings(&run.command) && before.all(is_same) {
        return Ok(());
    }
    let command =
        resuming(run, &folder).map(|command| format!("go on with it by `{command}`, or "));
    bail!(
        "{folder} holds cells of another experiment, --set or --shard: {}choose another folder with --out",
        command.unwrap_or_default()
    )
}

/// Without the folders of paths, which may be private.
fn definition(experiment: &Experiment) -> Definition {
    Definition { id: experiment.id.clone(), toml: private::redact(&experiment.text) }
}

/// The file in the run's folder of an experiment that is not built in.
fn own_file(of: &Experiment) -> Option<String> {
    let is_builtin = Experiment::builtin_text(&of.id).as_ref() == Some(&of.text);
    let name = if of.source == SOURCE { GIVEN.to_owned() } else { format!("{}.toml", of.id) };
    (!is_builtin).then_some(name)
}

/// See [`Run::experiments`].
fn asked(request: &Request, experiments: &[Experiment]) -> Vec<String> {
    let is_all = request.given.is_none() && request.experiments.is_empty();
    let asked = experiments.iter().filter(|_| !is_all);
    asked.map(|of| own_file(of).unwrap_or_else(|| of.id.clone())).collect()
}

/// A round that no sample of these records has.
fn next_round(before: &[Record]) -> u32 {
    let cells = before.iter().filter_map(Record::try_as_cell_ref);
    let rounds = cells.filter_map(|cell| cell.measured()).flat_map(|cell| &cell.frame.rounds);
    rounds.max().map_or(0, |last| last + 1)
}

/// References are computed by all cores, though the driver has one.
fn spread_references() {
    let threads = quiet::cores_before().len();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    // A pool that is there already stays.
    let _ = pool.start_handler(|_| quiet::use_all_cores()).build_global();
}

/// The audit's plan, but by the clocks of the latest earlier run whose samples are gone on with: samples by different clocks do not go
/// together, and what one audit found sound, the next may not on a busy machine. The header says by which.
fn clock_plan(header: &mut Run, found: ClockPlan, before: &[Record]) -> ClockPlan {
    let mut runs = before.iter().rev().filter_map(Record::try_as_run_ref);
    let clocks = runs.find(|run| run.is_compatible(header)).map(|run| run.clocks.clone());
    let clocks = clocks.unwrap_or_default().into_iter();
    let plan = clocks.fold(found, |plan, (kind, clock)| plan.with(kind, clock));
    header.clocks = PassKind::TIMED.map(|kind| (kind, plan.clock(kind))).into();
    if !plan.has_same_clocks(&found) {
        let text = "passes are timed by the clocks that the audit of the resumed run chose";
        header.notes.push(Note::new(NoteKind::OtherClocks, text));
    }
    plan
}

fn profile(options: &RunOptions, resumed: Option<&Recording>, gpu: &Gpu) -> Profile {
    let before = resumed.map_or(&[][..], |held| &held.before);
    let resumed = before.iter().rev().find_map(Record::try_as_run_ref).map(|run| run.profile);
    let default = if gpu.adapter.software { Profile::Quick } else { Profile::Paper };
    options.profile.or(resumed).unwrap_or(default)
}

fn header(options: &RunOptions, gpu: &Gpu, audit: &Audit, profile: Profile, seed: u64) -> Run {
    let order = format!("cells and frames in an order drawn from the seed {seed}");
    let of_adapter = gpu.notes.iter().map(|text| Note::new(NoteKind::Adapter, text));
    Run {
        schema: SCHEMA,
        fathom_version: env!("CARGO_PKG_VERSION").to_owned(),
        build: Some(Build { program: options.catalog.digest().ok(), ..options.catalog.build() }),
        started_at: calendar::now(),
        profile,
        command: options.command.clone(),
        adapter: record::Adapter {
            host_threads: quiet::cores_before().len().max(1),
            ..gpu.adapter.clone()
        },
        conditions: Conditions::detect(),
        shader_checks: if gpu.unchecked { ShaderChecks::Unchecked } else { ShaderChecks::Checked },
        audit: audit.rows.clone(),
        submit_cost_ns: PassKind::TIMED.map(|kind| (kind, audit.plan.submit_cost.ns(kind))).into(),
        notes: of_adapter.chain([Note::new(NoteKind::Order, order)]).collect(),
        ..Run::default()
    }
}

/// For all cells that lack visits, each as many times as its experiment's weight. Cells that are not timed take no time.
fn default_budget_s(profile: Profile, planned: &[PlannedExperiment], schedule: &Schedule) -> f64 {
    let (per_cell_s, max_s): (f64, f64) = match profile {
        Profile::Quick => (6.0, 240.0),
        Profile::Paper => (20.0, 1_800.0),
    };
    let weights = planned.iter().zip(&schedule.cells).map(|(planned, states)| {
        let due = states.iter().filter(|state| {
            !state.is_excluded
                && !state.untimed
                && (!state.recorded || state.visits < schedule.max_visits)
        });
        planned.experiment.weight * due.count() as f64
    });
    (SET_UP_S + (weights.sum::<f64>() * per_cell_s).max(MIN_MEASURING_S)).min(max_s)
}

struct Measurement<'a> {
    session: Session,
    output: RunOutput,
    group_bytes: u64,
    seed: u64,
    planned: &'a [PlannedExperiment],
    /// Resume keys of the cells that an earlier run has finished.
    finished: BTreeSet<String>,
    /// Of each experiment.
    progress: Vec<CellProgress>,
    schedule: Schedule,
    /// Number of the next round of samples.
    round: u32,
    interrupted: &'a AtomicBool,
    /// Whether the budget suffices was said, or needs not be.
    is_budget_told: bool,
}

impl Measurement<'_> {
    /// Says once that a budget that was asked for does not give every cell an interval: before the first cell, as soon as the
    /// foreseen steps alone take longer.
    fn check_budget(&mut self) {
        let (used_s, budget_s) = (self.output.now_s(), self.output.reports.budget_s);
        let needed_s = used_s + self.schedule.needed_s();
        if self.is_budget_told || needed_s <= budget_s {
            return;
        }
        self.is_budget_told = true;
        let minutes = (BUDGET_RESERVE * needed_s / 60.0).ceil();
        let visits = MIN_VISITS.min(self.schedule.max_visits);
        print::note(format!(
            "a budget of {budget_s:.0} s is too short for {visits} visits to every cell, which take about {needed_s:.0} s (an interval \
             takes {MIN_VISITS} visits): give --budget {minutes:.0}m"
        ));
    }

    /// Writes the header, and says what of an earlier run was damaged and what is gone on with.
    fn begin(&mut self) -> Result<()> {
        let header = Record::Run(Box::new(self.output.header.clone()));
        self.output.write(header)?;
        self.output.folder.damage.iter().for_each(print::note);
        let cells = self.planned.iter().flat_map(|planned| &planned.cells);
        let recorded = cells.zip(self.schedule.all()).filter(|(_, state)| state.recorded);
        let names =
            recorded.map(|(cell, _)| (cell.plan.experiment.clone(), cell.plan.cell.clone()));
        self.output.progress.finished.extend(names);
        let samples = self.progress.iter().flat_map(|known| known.samples.values());
        let pairs: Vec<usize> = samples.map(Samples::pairs).filter(|pairs| *pairs > 0).collect();
        if !pairs.is_empty() {
            let (all, cells) = (pairs.iter().sum::<usize>(), pairs.len());
            print::note(format!("continuing from {all} pairs of frames of {cells} cells"));
        }
        Ok(())
    }

    fn measure(&mut self) -> Result<()> {
        let planned = self.planned;
        planned.iter().try_for_each(|planned| self.define(planned))?;
        for planned in planned {
            self.skip(planned)?;
        }
        (0..planned.len()).for_each(|experiment| self.look(experiment));
        self.check_budget();
        let mut outcome = Outcome::OverBudget;
        while !self.interrupted.load(Ordering::Relaxed) {
            self.collect(Duration::ZERO)?;
            let deadline_s = self.output.deadline_s() - self.session.beside.backlog_s();
            let now_s = self.output.now_s();
            let batch = match self.schedule.next(now_s, deadline_s - now_s) {
                Next::Visit(batch) => batch,
                Next::Wait(wait_s) => {
                    self.report_if_due(false);
                    self.output.progress.tick();
                    std::thread::sleep(Duration::from_secs_f64(wait_s.min(WAIT_S)));
                    continue;
                }
                Next::End => break,
            };
            if self.report_if_due(batch.is_first) {
                continue;
            }
            self.schedule.begin(&batch);
            let before = (self.round, self.output.records.len());
            self.sample(&batch, deadline_s)?;
            self.look(batch.experiment);
            self.output.progress.visits = self.schedule.visits();
            self.check_budget();
            if let Some(lost) = self.session.gpu.loss_reason()
                && let Err(why) = self.session.reopen()
            {
                let reason = format!("device lost ({lost}) and not recovered: {why}");
                outcome = Outcome::Failed { reason };
                break;
            }
            if before == (self.round, self.output.records.len()) {
                break;
            }
        }
        let is_over = |of: &Self| {
            of.interrupted.load(Ordering::Relaxed)
                || of.output.now_s() >= of.output.deadline_s()
                || of.session.beside.is_idle()
        };
        while !is_over(self) {
            self.collect(Duration::from_secs_f64(WAIT_S))?;
        }
        self.output.reports.end();
        self.output.progress.end();
        if !self.interrupted.load(Ordering::Relaxed) {
            self.record_unfinished(outcome)?;
        }
        Ok(())
    }

    /// Takes what is done beside, or is done soon enough after the last.
    fn collect(&mut self, within: Duration) -> Result<()> {
        let mut experiments = BTreeSet::new();
        while let Some(done) = self.session.beside.next(within) {
            match done {
                Done::Figures(computed) => {
                    experiments.insert(computed.place.0);
                    self.complete(*computed)?;
                }
                Done::Report(took) => self.output.reports.made(took),
            }
        }
        experiments.into_iter().for_each(|number| self.look(number));
        Ok(())
    }

    /// Writes the record of a cell whose figures are known now.
    fn complete(&mut self, computed: ComputedFigures) -> Result<()> {
        let (number, cell) = computed.place;
        let planned = &self.planned[number].cells[cell];
        let Some(measured) = self.progress[number].complete(computed, &planned.plan.cell) else {
            return Ok(());
        };
        let outcome = match self.session.add_shares(measured) {
            Ok(()) => Outcome::Measured(Box::new(measured.clone())),
            Err(reason) => Outcome::Failed { reason },
        };
        self.schedule.cells[number][cell].is_excluded = matches!(outcome, Outcome::Failed { .. });
        Ok(self.output.finish(planned.record(outcome))?)
    }

    /// The first report comes after the first visits, unless it would take too much of the budget.
    fn report_if_due(&mut self, is_next_first: bool) -> bool {
        let is_first = !is_next_first && self.output.reports.may_begin();
        let is_due = is_first || self.output.reports.is_due();
        if is_due {
            self.output.report(&self.schedule, &mut self.session.beside);
        }
        is_due
    }

    /// Records an experiment's text, once. Merging needs those of all experiments, to tell which cells are missing.
    fn define(&mut self, planned: &PlannedExperiment) -> Result<(), RecordError> {
        let definition = Record::Experiment(definition(&planned.experiment));
        let is_needed = !planned.cells.is_empty() || self.output.header.shard.is_some();
        if is_needed && !self.output.folder.before.contains(&definition) {
            self.output.write(definition)?;
        }
        Ok(())
    }

    /// Records the cells that are skipped.
    fn skip(&mut self, planned: &PlannedExperiment) -> Result<(), RecordError> {
        let skipped = planned.cells.iter().filter_map(|cell| {
            let reason = cell.skip.clone()?;
            Some(cell.record(Outcome::Skipped { reason }))
        });
        self.output.finish_all(skipped.collect())
    }

    fn sample(&mut self, batch: &Batch, deadline_s: f64) -> Result<()> {
        let settings = Settings {
            deadline_s,
            at_least_one: !self.schedule.has_measured(),
            group_bytes: self.group_bytes,
            seed: self.seed,
            first_round: self.round,
        };
        let mut executor = CellExecutor::new(
            &mut self.session,
            &mut self.output,
            batch.experiment,
            &self.planned[batch.experiment],
            &mut self.progress[batch.experiment],
            &mut self.schedule,
        );
        self.round = sample::sample(&mut executor, &batch.cells, &settings, self.interrupted)?;
        self.session.gpu.keep_pipelines();
        Ok(())
    }

    /// Tells how many claims of an experiment are settled so far. Nothing is planned by it.
    fn look(&mut self, number: usize) {
        let (start, experiment) = (Instant::now(), &self.planned[number].experiment);
        let records: Vec<&Cell> = self.progress[number].records.values().collect();
        let settled = experiment.settled(&records, self.session.gpu.adapter.software);
        self.output.progress.set_settled(number, settled, experiment.claim.len());
        self.session.times.since(start, SetUp::Reports);
    }

    /// Records the cells that the budget or a lost device left. Those of which there are samples have a record.
    fn record_unfinished(&mut self, left: Outcome) -> Result<(), RecordError> {
        let cells = self.planned.iter().flat_map(|planned| &planned.cells);
        let states = cells.zip(self.schedule.all());
        let states = states.filter(|(_, state)| !state.recorded && state.visits == 0);
        self.output.finish_all(states.map(|(cell, _)| cell.record(left.clone())).collect())
    }

    fn end(mut self) -> Result<Summary> {
        let spent = &mut self.session.times;
        *spent.set_up_s.entry(SetUp::Reports).or_default() += self.output.reports.spent_s;
        let parts_s = spent.set_up_s.clone();
        let set_up_s = parts_s.values().sum();
        let end = End {
            measuring_wall_s: self.output.now_s() - set_up_s,
            measured_gpu_s: spent.frames_ns * 1e-9,
            set_up_s,
            set_up_parts_s: parts_s,
            peak_memory_bytes: memory::peak_bytes(),
            interrupted: self.interrupted.load(Ordering::Relaxed),
        };
        self.output.write(Record::End(end.clone()))?;
        let Recording { output, writer, lock, .. } = self.output.folder;
        let records = writer.compact()?;
        let is_header = |record: &Record| record.try_as_run_ref().is_some();
        let since = records.iter().rposition(is_header).unwrap_or(0);
        let cells = records[since..].iter().filter_map(Record::try_as_cell_ref);
        let measured = cells.clone().map(|cell| cell.resume_key()).collect();
        let kept = self.finished.difference(&measured).count();
        let skip_reason = cells.clone().find_map(|cell| match &cell.outcome {
            Outcome::Skipped { reason } => Some(reason.clone()),
            _ => None,
        });
        let counts = OutcomeCounts::count(cells.map(|cell| &**cell));
        Ok(Summary { out: output.folder, lock, counts, skip_reason, kept, end })
    }
}

#[cfg(test)]
mod tests;
