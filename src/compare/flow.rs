//! A comparison from its options to its stored lines: which builds, which gates, in which order.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use sha2::{Digest, Sha256};
use thiserror::Error;

use super::bench::Processes;
use super::cells::{CellsError, Gates};
use super::instructions;
use super::launch::{Quiet, Waiting, WorkerFault, WorkerStart, allowed_cores};
use super::protocol::{GateConfiguration, Greeting};
use super::rounds::{self, Before, RoleFault, Schedule};
use super::store::{self, StoreError, StoredComparison};
use super::survey::{self, SurveyedBuild};
use super::time;
use crate::gpu;
use crate::harness::calendar;
use crate::harness::catalog::Catalog;
use crate::harness::output::{DEFAULT_FOLDER, Held, Kind, OutputError, Taken, unused};
use crate::record::RecordError;
use crate::record::comparison::{
    CellId, Compared, ComparedBuild, ComparisonEnd, ComparisonHeader, Fault, Gate, GateSettings,
    Side, Skip,
};

#[derive(Debug, Error)]
pub enum CompareError {
    #[error(transparent)]
    Cells(#[from] CellsError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Folder(#[from] OutputError),
    #[error(transparent)]
    Records(#[from] RecordError),
    #[error("{} cannot be read: {source}", path.display())]
    Program { path: PathBuf, source: std::io::Error },
    #[error("the {} build: {fault}", .side.name())]
    Worker { side: Side, fault: WorkerFault },
    #[error("the sides run on different adapters: the base on {base}, the head on {head}")]
    Adapters { base: String, head: String },
    #[error(
        "{} was begun with another {what}: resume it with the same, or choose another folder with --out",
        folder.display()
    )]
    OtherComparison { folder: PathBuf, what: &'static str },
}

/// A build to compare.
#[derive(Clone, Debug)]
pub struct Program {
    pub path: PathBuf,
    /// What to call it: the revision it was built from, or its path.
    pub label: String,
}

#[derive(Clone, Debug)]
pub struct CompareOptions {
    pub catalog: Catalog,
    pub gpu: gpu::Options,
    pub base: Program,
    pub head: Program,
    /// The gates' configurations; the built-in ones without.
    pub cells_file: Option<PathBuf>,
    /// Only cells whose names contain this.
    pub filter: Option<String>,
    /// Of the gates, those asked for.
    pub settings: GateSettings,
    pub out: Option<PathBuf>,
    /// Go on with the comparison in `out`.
    pub resume: bool,
}

/// Measures what `options` ask for and gives the folder with its lines. `tell` is told of each step.
pub fn measure(
    options: &CompareOptions,
    interrupted: &AtomicBool,
    tell: &dyn Fn(&str),
) -> Result<PathBuf, CompareError> {
    let start = Instant::now();
    let mut gates = Gates::load(options.cells_file.as_deref(), options.catalog.gates)?;
    if let Some(filter) = &options.filter {
        gates = gates.filtered(filter)?;
    }
    let folder = match &options.out {
        Some(folder) => folder.clone(),
        None => fresh()?,
    };
    let taken = taken(&folder, options.resume)?;
    let flags = [interrupted];
    let waiting = Waiting { interrupted: &flags, tell };
    let mut parties =
        [start_party(options, Side::Base, waiting)?, start_party(options, Side::Head, waiting)?];
    let greetings = greeted(&mut parties)?;
    let header = header(options, &gates, &greetings)?;
    let mut held = taken.open(Kind::Comparison)?;
    let before = if options.resume {
        resumed(&mut held, &header, tell)?
    } else {
        StoredComparison::new(header.clone())
    };
    let mut measurement = ComparisonRun { options, held, interrupted, waiting, tell, before };
    if !options.resume {
        measurement.write(vec![Compared::Header(Box::new(header))])?;
    }
    let common = measurement.exact(&mut parties, &gates.configurations)?;
    drop(parties);
    measurement.instructions(&common)?;
    measurement.time(&gates.control, &common)?;
    let wall_s = start.elapsed().as_secs_f64();
    let interrupted = interrupted.load(Ordering::Relaxed);
    measurement.write(vec![Compared::End(ComparisonEnd { wall_s, interrupted })])?;
    Ok(folder)
}

/// The folder to write to, if it is free, or to resume from.
fn taken(folder: &Path, resume: bool) -> Result<Taken, OutputError> {
    if resume { Taken::measured(folder, Kind::Comparison) } else { Taken::free(folder) }
}

/// Finds out whether a folder can be written to, or resumed from, before minutes are spent on building.
pub fn try_folder(folder: &Path, resume: bool) -> Result<(), OutputError> {
    taken(folder, resume).map(drop)
}

/// A new folder for a comparison that is told none.
pub fn fresh() -> Result<PathBuf, OutputError> {
    let name = format!("compare-{}", calendar::compact(jiff::Timestamp::now()));
    unused(&Path::new(DEFAULT_FOLDER).join(name))
}

fn start_of(options: &CompareOptions, side: Side) -> WorkerStart {
    let program = match side {
        Side::Base => &options.base,
        Side::Head => &options.head,
    };
    let mut start = WorkerStart::new(&program.path);
    start.name = side.name();
    start.gpu = options.gpu.clone();
    start
}

/// The worker of a side's survey. Both run at once, each on a core of its own where there are two.
fn start_party<'a>(
    options: &CompareOptions,
    side: Side,
    waiting: Waiting<'a>,
) -> Result<SurveyedBuild<'a>, CompareError> {
    let mut start = start_of(options, side);
    let cores = allowed_cores();
    start.quiet = Some(Quiet {
        core: cores.get(side as usize % cores.len().max(1)).copied(),
        ..Quiet::default()
    });
    SurveyedBuild::new(side, start, waiting).map_err(|fault| CompareError::Worker { side, fault })
}

fn greeted(parties: &mut [SurveyedBuild<'_>; 2]) -> Result<[Greeting; 2], CompareError> {
    let [base, head] = parties;
    let greet = |party: &mut SurveyedBuild<'_>| {
        let side = party.side;
        let greeting = party.greeted();
        greeting.map_err(|fault| CompareError::Worker { side, fault })
    };
    let [base, head] = [greet(base)?, greet(head)?];
    let named = |greeting: &Greeting| {
        let adapter = &greeting.adapter;
        format!("{} ({})", adapter.name, adapter.driver_info)
    };
    if named(&base) != named(&head) {
        return Err(CompareError::Adapters { base: named(&base), head: named(&head) });
    }
    Ok([base, head])
}

fn header(
    options: &CompareOptions,
    gates: &Gates,
    greetings: &[Greeting; 2],
) -> Result<ComparisonHeader, CompareError> {
    let build = |program: &Program, greeting: &Greeting| {
        Ok::<ComparedBuild, CompareError>(ComparedBuild {
            label: program.label.clone(),
            version: greeting.fathom_version.clone(),
            protocol: Some(greeting.protocol),
            digest: digest(&program.path)
                .map_err(|source| CompareError::Program { path: program.path.clone(), source })?,
        })
    };
    let [base, head] = greetings;
    let mut settings = options.settings.clone();
    let mut skipped = Vec::new();
    settings.gates.retain(|gate| {
        let reason = obstacle(*gate, greetings);
        let possible = reason.is_none();
        skipped.extend(reason.map(|reason| Skip { gate: *gate, reason }));
        possible
    });
    let mut notes = base.notes.clone();
    notes.extend(head.notes.iter().filter(|note| !base.notes.contains(note)).cloned());
    Ok(ComparisonHeader {
        base: build(&options.base, base)?,
        head: build(&options.head, head)?,
        adapter: head.adapter.clone(),
        settings,
        cells: gates.cells(),
        skipped,
        notes,
        ..ComparisonHeader::default()
    })
}

/// Why a gate cannot be run with these workers here.
fn obstacle(gate: Gate, greetings: &[Greeting; 2]) -> Option<String> {
    for (side, greeting) in Side::BOTH.into_iter().zip(greetings) {
        if !greeting.parts.iter().any(|part| part == gate.name()) {
            return Some(format!("the {} build knows no such gate", side.name()));
        }
    }
    match gate {
        Gate::Instructions => instructions::obstacle(greetings[1].adapter.software),
        Gate::Exact | Gate::Time => None,
    }
}

/// SHA-256 of a file, in hexadecimal.
pub fn digest(path: &Path) -> Result<String, std::io::Error> {
    let sum = Sha256::digest(std::fs::read(path)?);
    Ok(sum.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The folder's comparison, if it is this one.
fn resumed(
    held: &mut Held,
    now: &ComparisonHeader,
    tell: &dyn Fn(&str),
) -> Result<StoredComparison, CompareError> {
    held.notices.iter().for_each(|notice| tell(notice));
    let folder = held.output.folder.clone();
    let before = StoredComparison::from_records(std::mem::take(&mut held.before));
    let before = before.ok_or_else(|| OutputError::NoHeader { path: folder.clone() })?;
    let then = &before.header;
    let same = [
        ("base", then.base.digest == now.base.digest),
        ("head", then.head.digest == now.head.digest),
        ("adapter", then.adapter == now.adapter),
        ("selection of cells", then.cells == now.cells),
        ("kind of measurement", !then.settings.unpaired),
    ];
    match same.iter().find(|(_, same)| !same) {
        Some((what, _)) => Err(CompareError::OtherComparison { folder, what }),
        None => Ok(before),
    }
}

/// A comparison under way.
struct ComparisonRun<'a> {
    options: &'a CompareOptions,
    held: Held,
    interrupted: &'a AtomicBool,
    waiting: Waiting<'a>,
    tell: &'a dyn Fn(&str),
    /// What was measured before this process, if anything. Its settings hold.
    before: StoredComparison,
}

impl ComparisonRun<'_> {
    fn wants(&self, gate: Gate) -> bool {
        let asked = self.before.header.settings.gates.contains(&gate);
        asked && !self.is_interrupted()
    }

    fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    fn write(&mut self, lines: Vec<Compared>) -> Result<(), RecordError> {
        store::write(&mut self.held, lines)
    }

    /// Stores what was found out, unless that was interrupted: then what looks like a fault is the interruption's.
    fn keep(&mut self, lines: Vec<Compared>) -> Result<(), RecordError> {
        if self.is_interrupted() { Ok(()) } else { self.write(lines) }
    }

    /// What both sides have of the configurations, with its exact figures if they are wanted and not known.
    fn exact(
        &mut self,
        parties: &mut [SurveyedBuild<'_>; 2],
        configurations: &[GateConfiguration],
    ) -> Result<Vec<GateConfiguration>, CompareError> {
        let counting = self.wants(Gate::Exact);
        (self.tell)(if counting {
            "exact gate: work, counters, bytes and errors of both builds"
        } else {
            "preparing both builds"
        });
        let mut common = Vec::new();
        for configuration in configurations {
            if self.is_interrupted() {
                break;
            }
            let (known, faults) = survey::prepare(parties, configuration);
            self.keep(faults)?;
            let lacks = |cell: CellId| !self.before.has_exact(&cell);
            if counting && known.cells().any(lacks) {
                self.keep(survey::exact(parties, &known))?;
            }
            common.push(known);
        }
        common.retain(|configuration| !configuration.stages.is_empty());
        let checked = |side| self.before.checks.iter().any(|check| check.side == side);
        if self.wants(Gate::Exact) && !Side::BOTH.into_iter().all(checked) {
            self.keep(survey::checks(parties, stages_of(&common)))?;
        }
        Ok(common)
    }

    fn instructions(&mut self, common: &[GateConfiguration]) -> Result<(), CompareError> {
        if !self.wants(Gate::Instructions) {
            return Ok(());
        }
        (self.tell)("instruction gate: every stage under callgrind");
        let start = |side| start_of(self.options, side);
        let before = &self.before;
        Ok(instructions::run(&mut self.held, before, common, &start, self.interrupted)?)
    }

    fn time(&mut self, control: &CellId, common: &[GateConfiguration]) -> Result<(), CompareError> {
        if !self.wants(Gate::Time) {
            return Ok(());
        }
        let cells: Vec<CellId> = common.iter().flat_map(GateConfiguration::cells).collect();
        let settings = self.before.header.settings.clone();
        let sides = Side::BOTH.map(|side| start_of(self.options, side));
        let [base, head] = sides;
        let seed = settings.seed;
        let mut bench = match Processes::new(base, head, common, seed, self.waiting) {
            Ok(bench) => bench,
            Err(_) if self.is_interrupted() => return Ok(()),
            Err(cause) => return self.no_time(&cause),
        };
        let schedule = Schedule {
            control: if cells.contains(control) {
                Some(control.clone())
            } else {
                cells.first().cloned()
            },
            cells,
            launches: settings.launches,
            pairs: settings.pairs,
            seed: settings.seed,
            second: false,
        };
        self.launches(&schedule, &mut bench)?;
        let so_far = StoredComparison::read(&self.held.output.folder)?;
        let open = time::open(&so_far);
        if open.is_empty() || !self.wants(Gate::Time) {
            return Ok(());
        }
        self.before = so_far;
        self.launches(&schedule.again(open), &mut bench)
    }

    /// One of the two measurements of the time gate.
    fn launches(
        &mut self,
        schedule: &Schedule,
        bench: &mut Processes<'_>,
    ) -> Result<(), CompareError> {
        let before = timed_before(&self.before, schedule.second);
        let mut done = before.complete;
        let (tell, held) = (self.tell, &mut self.held);
        tell(&format!(
            "time gate{}: cells: {}, launches: {} of {} pairs",
            if schedule.second { ", what is still open" } else { "" },
            schedule.cells.len(),
            schedule.launches,
            schedule.pairs
        ));
        let mut sink = |lines: Vec<Compared>| {
            let launches = lines.iter().filter(|line| matches!(line, Compared::Launch(_)));
            done += launches.count() as u32;
            store::write(held, lines)?;
            tell(&format!("time gate: {done} of {} launches", schedule.launches));
            Ok::<(), RecordError>(())
        };
        Ok(rounds::run(schedule, bench, &before, self.interrupted, &mut sink)?)
    }

    /// The gate could not begin.
    fn no_time(&mut self, cause: &RoleFault) -> Result<(), CompareError> {
        let side = Some(cause.role.side());
        let fault = Fault::new(Gate::Time, side, None, cause.fault.to_string());
        Ok(self.write(vec![Compared::Fault(fault)])?)
    }
}

/// Each stage of the configurations once.
fn stages_of(configurations: &[GateConfiguration]) -> Vec<String> {
    let mut stages: Vec<String> = configurations
        .iter()
        .flat_map(|configuration| configuration.stages.iter().cloned())
        .collect();
    stages.sort();
    stages.dedup();
    stages
}

/// What is there already of the first or second measurement of the time gate.
fn timed_before(before: &StoredComparison, second: bool) -> Before {
    let later = before.faults.iter().skip(before.faults_before_interruption);
    let lost: Vec<&Fault> = later.filter(|fault| fault.gate == Gate::Time).collect();
    let cells = lost.iter().filter(|fault| !fault.control);
    Before {
        complete: before.launches_of(second) as u32,
        last: before.last_launch,
        lost: cells.filter_map(|fault| fault.cell.clone()).collect(),
        control_lost: lost.iter().any(|fault| fault.control),
    }
}

#[cfg(test)]
mod tests;
