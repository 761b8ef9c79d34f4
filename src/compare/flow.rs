//! A comparison from its options to its stored lines: which builds, which gates, in which order.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use anyhow::{Context, Result, anyhow, bail};
use itertools::Itertools;
use serde_json::{Value, json};

use super::cells::Gates;
use super::environment;
use super::exact_gate::{self, ExactGateSide};
use super::fingerprint;
use super::instructions;
use super::launch_workers::LaunchProcesses;
use super::launches::{self, EarlierLaunches, GateSchedule};
use super::protocol::{GateConfiguration, Greeting, with_driver};
use super::settings;
use super::worker_process::{Quiet, ReplyWait, WorkerStart, allowed_cores};
use fathom_harness::assets;
use fathom_harness::catalog::Catalog;
use fathom_judge::adapters::AdapterRelation;
use fathom_judge::counts::{self, Change, CountChange};
use fathom_judge::exact;
use fathom_judge::store::{self, Comparison};
use fathom_judge::time::{self, TimeVerdict};
use fathom_record::comparison::{
    CellId, CellSubject, Compared, ComparedBuild, ComparisonEnd, ComparisonHeader, Differs, Fault,
    Gate, GateSettings, Side, Skip, UnchangedCells,
};
use fathom_record::output::{FolderKind, LockedFolder, OutputError, Recording};
use fathom_record::{Build, RecordError};
use fathom_scene::SceneFile;

/// So few configurations are counted together, whatever differs.
const FEW: usize = 3;

/// A build to compare.
#[derive(Clone, Debug)]
pub struct Program {
    /// What to call it: the revision it was built from, or its path.
    pub label: String,
    /// How its workers are started.
    pub start: WorkerStart,
}

#[derive(Clone, Debug)]
pub struct CompareOptions {
    pub catalog: Catalog,
    /// In the order of [`Side::BOTH`].
    pub programs: [Program; 2],
    /// The gates' configurations; the built-in ones without.
    pub cells_file: Option<PathBuf>,
    /// The base's own list of cells; that of its greeting without, unless `cells_file` is there.
    pub base_cells: Option<Vec<CellId>>,
    /// Only cells whose names contain this.
    pub filter: Option<String>,
    /// Records and reports say the values of the sides' variables.
    pub env_values: bool,
    /// Of the gates, those asked for.
    pub settings: GateSettings,
    /// Go on with the comparison in the folder.
    pub resume: bool,
    /// What the head should be built of: a note says where it is not.
    pub checkout: Option<Build>,
}

impl CompareOptions {
    fn start(&self, side: Side) -> WorkerStart {
        WorkerStart { name: side.to_string(), ..self.programs[side as usize].start.clone() }
    }
}

/// Measures what `options` ask for into a folder and gives it with its lines. `report` takes a line for each step.
pub fn measure(
    options: &CompareOptions,
    taken: LockedFolder,
    interrupted: &AtomicBool,
    report: &dyn Fn(&str),
) -> Result<Recording> {
    let start = Instant::now();
    let gates = Gates::load(options.cells_file.as_deref(), options.catalog.gates)?;
    let mut gates = gates.filtered(options.filter.as_deref())?;
    let waiting = ReplyWait { interrupted: Some(interrupted), report };
    let [base, head] = Side::BOTH.map(|side| start_build(options, side, waiting));
    let mut builds = [base?, head?];
    let greetings = greet(options, &mut builds)?;
    let skipped = skipped(options, &greetings);
    let software = greetings[Side::Head as usize].adapter.software;
    gates.retain(|cell| {
        let is_run = |gate: &&Gate| !skipped.iter().any(|skip| skip.gate == **gate);
        let mut run = options.settings.gates.iter().filter(is_run);
        // A stage that no gate measures is told as such.
        cell.is_stage() || run.any(|gate| cell.is_measured_by(*gate, software))
    });
    if gates.configurations.is_empty() {
        bail!(
            "these cells are of what the host does, and none of the gates that run here measures that"
        );
    }
    let digests = digests(options, &builds)?;
    let header = header(options, &gates, &greetings, &digests, skipped);
    let settings = settings(options, &gates, &header, scenes(&options.catalog, &gates));
    let mut output = taken.open(FolderKind::Comparison)?;
    let before = if options.resume {
        resumed(&mut output, &settings, report)?
    } else {
        settings::store(&output.output.folder, &settings)?;
        store::write(&mut output, vec![Compared::Header(Box::new(header.clone()))])?;
        Comparison { header, ..Comparison::default() }
    };
    let checks = without_checks(&greetings).is_none();
    let told = BTreeSet::new();
    let mut run = ComparisonRun { options, output, interrupted, waiting, before, checks, told };
    let same_code = fingerprint::is_same_code(&greetings, &digests);
    let mut common = Vec::new();
    for suspected in run.changed(&mut builds, &gates.configurations, same_code)? {
        let of_both = run.exact(&mut builds, &suspected)?;
        run.instructions(&of_both)?;
        common.extend(of_both);
    }
    run.checks(&mut builds, &common)?;
    drop(builds);
    run.time(&gates.control, &common)?;
    let end = ComparisonEnd {
        wall_s: start.elapsed().as_secs_f64(),
        interrupted: waiting.is_interrupted(),
    };
    store::write(&mut run.output, vec![Compared::End(end)])?;
    Ok(run.output)
}

/// The folder to resume from, or to write to if it is free. Without `out` it is a new one, named after the command.
pub fn lock_output(
    out: Option<&Path>,
    command: &str,
    resume: bool,
) -> Result<LockedFolder, OutputError> {
    match out {
        Some(folder) if resume => LockedFolder::lock_measured(folder, FolderKind::Comparison),
        _ => LockedFolder::lock_named(out, command),
    }
}

/// How to start a side's worker of the exact gate. Both run at once, each on a core of its own where there are two.
fn start_build<'a>(
    options: &CompareOptions,
    side: Side,
    waiting: ReplyWait<'a>,
) -> Result<ExactGateSide<'a>> {
    let core = allowed_cores().into_iter().cycle().nth(side as usize);
    let quiet = Some(Quiet { core, ..Quiet::default() });
    let start = WorkerStart { quiet, ..options.start(side) };
    ExactGateSide::new(start, waiting).map_err(|fault| anyhow!("the {side} build: {fault}"))
}

/// What both sides say of themselves. Sides that were given the same must have the same adapter.
fn greet(options: &CompareOptions, builds: &mut [ExactGateSide<'_>; 2]) -> Result<[Greeting; 2]> {
    let environments = options.programs.each_ref().map(|program| &program.start.environment);
    let greet = |side: Side, build: &mut ExactGateSide<'_>| -> Result<Greeting> {
        build.greet().map_err(|fault| anyhow!("the {side} build: {fault}"))
    };
    let [base, head] = builds;
    let greetings = [greet(Side::Base, base)?, greet(Side::Head, head)?];
    if let (Some(asked), Some(build)) = (&options.programs[0].start.commit, &greetings[0].build)
        && build.commit.as_ref().is_some_and(|commit| commit != asked)
    {
        bail!("the base build: it was built of {build} and not of {asked}");
    }
    let [base, head] = greetings.each_ref().map(|greeting| &greeting.adapter);
    let given_the_same = environments[0] == environments[1];
    if given_the_same && AdapterRelation::between(base, head) != AdapterRelation::Same {
        let [base, head] = [base, head].map(with_driver);
        bail!("the sides run on different adapters: the base on {base}, the head on {head}");
    }
    Ok(greetings)
}

/// Of the programs of both sides.
fn digests(options: &CompareOptions, builds: &[ExactGateSide<'_>; 2]) -> Result<[String; 2]> {
    let [base, head] = Side::BOTH.map(|side| {
        let path = &options.programs[side as usize].start.program;
        let digest = builds[side as usize].digest();
        digest.with_context(|| format!("{} cannot be read", path.display()))
    });
    Ok([base?, head?])
}

fn header(
    options: &CompareOptions,
    gates: &Gates,
    greetings: &[Greeting; 2],
    digests: &[String; 2],
    skipped: Vec<Skip>,
) -> ComparisonHeader {
    let build = |side: Side| {
        let (program, greeting) = (&options.programs[side as usize], &greetings[side as usize]);
        ComparedBuild {
            label: program.label.clone(),
            version: greeting.fathom_version.clone(),
            protocol: greeting.protocol,
            build: greeting.build.clone(),
            digest: digests[side as usize].clone(),
            environment: environment::recorded(&program.start.environment, options.env_values),
        }
    };
    let [base, head] = greetings;
    let notes = base.notes.iter().chain(&head.notes).unique().cloned();
    let commit = base.build.as_ref().and_then(|build| build.commit.as_ref());
    let is_silent = options.programs[0].start.commit.is_some() && commit.is_none();
    let silent = "the base build does not say of which commit it was built".to_owned();
    let notes = notes.chain(is_silent.then_some(silent));
    let notes = notes.chain(stale_head(options, &greetings[Side::Head as usize]));
    let mut settings = options.settings.clone();
    let obstacle = fingerprint::obstacle(&options.programs, greetings).filter(|_| !settings.all);
    settings.all |= obstacle.is_some();
    settings.gates.retain(|gate| !skipped.iter().any(|skip| skip.gate == *gate));
    let unchecked = without_checks(greetings).filter(|_| settings.gates.contains(&Gate::Exact));
    let base_cells = base_cells(options, base, &settings.gates);
    ComparisonHeader {
        base: build(Side::Base),
        head: build(Side::Head),
        adapter: head.adapter.clone(),
        base_adapter: (base.adapter != head.adapter).then(|| base.adapter.clone()),
        settings,
        cells: gates.cells(),
        base_cells,
        skipped,
        notes: notes.chain(unchecked).chain(obstacle).collect(),
        ..ComparisonHeader::default()
    }
}

/// The cells of the base's own list that are asked for and that one of these gates measures.
fn base_cells(options: &CompareOptions, base: &Greeting, gates: &[Gate]) -> Vec<CellId> {
    let greeted = options.cells_file.is_none().then_some(&base.cells);
    let mut cells = options.base_cells.as_ref().or(greeted).cloned().unwrap_or_default();
    let software = base.adapter.software;
    cells.retain(|cell| {
        let mut gates = gates.iter();
        options.filter.as_ref().is_none_or(|filter| cell.as_str().contains(filter))
            && gates.any(|gate| cell.subject().is_measured_by(*gate, software))
    });
    cells
}

/// That the head was built of another commit than the checkout holds.
fn stale_head(options: &CompareOptions, head: &Greeting) -> Option<String> {
    let (head, checkout) = head.build.as_ref().zip(options.checkout.as_ref())?;
    let is_stale =
        head.commit.is_some() && (&head.commit, head.dirty) != (&checkout.commit, checkout.dirty);
    is_stale.then(|| {
        format!("the head was built of {head}, and the checkout is at {checkout}: build it again")
    })
}

/// What the cells' scenes are made of, those apart that only a worker of another program knows.
fn scenes(catalog: &Catalog, gates: &Gates) -> Value {
    let names = gates.configurations.iter().map(|configuration| &configuration.scene).unique();
    let scene = |name| SceneFile::load_from(&catalog.scenes, name).ok()?.digests().ok();
    let digests = names.filter_map(|name| Some((name, scene(name)?)));
    let present = assets::look_up().into_iter().flatten().filter(|asset| asset.path.is_some());
    let present = present.map(|asset| asset.asset.name).collect_vec();
    json!({ "sources": digests.collect::<BTreeMap<_, _>>(), "assets": present })
}

/// All that defines what is measured. Of variables there are names and a digest, as their values may be secret.
fn settings(
    options: &CompareOptions,
    gates: &Gates,
    header: &ComparisonHeader,
    scenes: Value,
) -> Value {
    let side = |build: &ComparedBuild, program: &Program| {
        let environment = environment::recorded(&program.start.environment, false);
        json!({
            "program": build.digest,
            "version": build.version,
            "build": build.build,
            "environment": environment,
            "options": program.start.gpu.to_args(),
        })
    };
    let [base, head] = &options.programs;
    let sides = json!({
        "base": side(&header.base, base),
        "head": side(&header.head, head),
        "adapter": header.adapter,
        "base_adapter": header.base_adapter,
        "scenes": scenes,
    });
    settings::collect(&options.settings, gates, sides)
}

/// The gates asked for that cannot be run.
fn skipped(options: &CompareOptions, greetings: &[Greeting; 2]) -> Vec<Skip> {
    let skip =
        |gate: &Gate| Some(Skip { gate: *gate, reason: obstacle(*gate, greetings, options)? });
    options.settings.gates.iter().filter_map(skip).collect()
}

/// The sentence that a side has no checks, so that those of the other are not run.
fn without_checks(greetings: &[Greeting; 2]) -> Option<String> {
    let mut sides = Side::BOTH.into_iter().zip(greetings);
    let lacks =
        |(_, greeting): &(Side, &Greeting)| !greeting.parts.iter().any(|part| part == "checks");
    let (side, _) = sides.find(lacks)?;
    Some(format!("the {side} build knows no checks: none are compared"))
}

/// Why a gate cannot be run with these workers here.
fn obstacle(gate: Gate, greetings: &[Greeting; 2], options: &CompareOptions) -> Option<String> {
    let knows = |greeting: &Greeting| greeting.parts.contains(&gate.to_string());
    let mut sides = Side::BOTH.into_iter().zip(greetings);
    if let Some((side, _)) = sides.find(|(_, greeting)| !knows(greeting)) {
        return Some(format!("the {side} build knows no such gate"));
    }
    if gate == Gate::Instructions && options.programs.iter().any(|it| it.start.command.is_some()) {
        return Some("callgrind would count the shell that starts a command".to_owned());
    }
    let software = greetings.iter().all(|greeting| greeting.adapter.software);
    (gate == Gate::Instructions).then(|| instructions::obstacle(software))?
}

/// The folder's comparison, if it is this one.
fn resumed(held: &mut Recording, settings: &Value, tell: &dyn Fn(&str)) -> Result<Comparison> {
    held.damage.iter().for_each(|notice| tell(notice));
    let folder = held.output.folder.clone();
    let before = Comparison::from_records(std::mem::take(&mut held.before));
    let before = before.ok_or_else(|| OutputError::NoHeader { path: folder.clone() })?;
    settings::check(&folder, settings)?;
    Ok(before)
}

/// A comparison that is being measured.
struct ComparisonRun<'a> {
    options: &'a CompareOptions,
    output: Recording,
    interrupted: &'a AtomicBool,
    waiting: ReplyWait<'a>,
    /// What was measured before this process, if anything, or before this step. Its settings hold.
    before: Comparison,
    /// Both sides have checks.
    checks: bool,
    /// Verdicts that were told.
    told: BTreeSet<(Gate, CellId)>,
}

impl ComparisonRun<'_> {
    fn has_gate(&self, gate: Gate) -> bool {
        self.before.header.settings.gates.contains(&gate) && !self.waiting.is_interrupted()
    }

    /// Stores what was found out, unless that was interrupted: then what looks like a fault is the interruption's.
    fn write_lines(&mut self, lines: Vec<Compared>) -> Result<(), RecordError> {
        if self.waiting.is_interrupted() { Ok(()) } else { store::write(&mut self.output, lines) }
    }

    /// The configurations without what asks the GPU for the same on both sides, in groups of which the most suspicious comes first.
    fn changed(
        &mut self,
        builds: &mut [ExactGateSide<'_>; 2],
        configurations: &[GateConfiguration],
        same_code: bool,
    ) -> Result<Vec<Vec<GateConfiguration>>> {
        if self.before.header.settings.all {
            return Ok(vec![configurations.to_vec()]);
        }
        (self.waiting.report)("fingerprints: what each stage asks of the GPU");
        for configuration in configurations {
            let known = |line: &UnchangedCells| line.configuration == configuration.id;
            if !self.before.unchanged.iter().any(known) && !self.waiting.is_interrupted() {
                let lines = fingerprint::compare(builds, configuration, same_code);
                if let Some(Compared::Unchanged(UnchangedCells { reason: Some(why), .. })) =
                    lines.last()
                {
                    (self.waiting.report)(&format!("{}: all is measured: {why}", configuration.id));
                }
                self.write_lines(lines)?;
            }
        }
        self.before = Comparison::read(&self.output.output.folder)?;
        let mut all = Vec::new();
        for configuration in configurations {
            let mut changed = configuration.clone();
            let cell = |stage: &String| CellId::new(&configuration.id, stage);
            changed.stages.retain(|stage| !self.before.is_unchanged(&cell(stage)));
            let suspicion = |stage: &String| suspicion(&self.before, &cell(stage));
            if let Some(most) = changed.stages.iter().map(suspicion).min() {
                changed.stages.sort_by_key(suspicion);
                all.push((most, changed));
            }
        }
        all.sort_by_key(|(most, _)| *most);
        // Another process under callgrind takes longer than a few more configurations in one.
        let is_few = all.len() <= FEW;
        let groups = all.chunk_by(|a, b| is_few || a.0 == b.0);
        Ok(groups.map(|group| group.iter().map(|(_, own)| own.clone()).collect()).collect())
    }

    /// What both sides have of the configurations, with its exact figures if they are wanted and not known.
    fn exact(
        &mut self,
        builds: &mut [ExactGateSide<'_>; 2],
        configurations: &[GateConfiguration],
    ) -> Result<Vec<GateConfiguration>> {
        let counting = self.has_gate(Gate::Exact);
        (self.waiting.report)(if counting {
            "exact gate: work, counters, bytes and errors of both builds"
        } else {
            "preparing both builds"
        });
        let mut common = Vec::new();
        for configuration in configurations {
            if self.waiting.is_interrupted() {
                break;
            }
            let (known, faults) = exact_gate::prepare(builds, configuration);
            self.write_lines(faults)?;
            let lacks = |cell: CellId| cell.subject().is_stage() && !self.before.has_exact(&cell);
            if counting && known.cells().any(lacks) {
                self.write_lines(exact_gate::exact(builds, &known))?;
            }
            common.push(known);
        }
        common.retain(|configuration| !configuration.stages.is_empty());
        self.tell_verdicts(Gate::Exact)?;
        Ok(common)
    }

    /// The checks of the stages that both sides have.
    fn checks(
        &mut self,
        builds: &mut [ExactGateSide<'_>; 2],
        common: &[GateConfiguration],
    ) -> Result<()> {
        let checked = |side| self.before.checks.iter().any(|check| check.side == side);
        if !self.checks || !self.has_gate(Gate::Exact) || Side::BOTH.into_iter().all(checked) {
            return Ok(());
        }
        let stages = common.iter().flat_map(|configuration| &configuration.stages);
        let stages = stages.filter(|name| CellSubject::parse(name).is_stage());
        let stages: Vec<String> = stages.sorted().dedup().cloned().collect();
        (self.waiting.report)(&format!("exact gate: checks of {} stages", stages.len()));
        Ok(self.write_lines(exact_gate::checks(builds, &stages))?)
    }

    /// Tells the verdicts of a gate that stand since it was last asked: a line for each change, and how many cells have none.
    fn tell_verdicts(&mut self, gate: Gate) -> Result<()> {
        self.before = Comparison::read(&self.output.output.folder)?;
        let standing = standing(&self.before, gate).into_iter();
        let new = standing.filter(|(cell, _)| self.told.insert((gate, cell.clone()))).collect_vec();
        let tell = |line: String| (self.waiting.report)(&format!("{gate} gate: {line}"));
        let changes = new.iter().filter_map(|(cell, change)| Some((cell, change.as_ref()?)));
        changes.for_each(|(cell, change)| tell(format!("{cell}: {change}")));
        let same = new.iter().filter(|(_, change)| change.is_none()).count();
        if same > 0 {
            tell(format!("cells without a change: {same}"));
        }
        Ok(())
    }

    fn instructions(&mut self, common: &[GateConfiguration]) -> Result<()> {
        if !self.has_gate(Gate::Instructions) {
            return Ok(());
        }
        (self.waiting.report)("instruction gate: every stage under callgrind");
        let options = self.options;
        let start = |side| options.start(side);
        instructions::run(&mut self.output, &self.before, common, false, &start, self.interrupted)?;
        self.tell_verdicts(Gate::Instructions)?;
        let open = counts::open(&self.before);
        if open.is_empty() || !self.has_gate(Gate::Instructions) {
            return Ok(());
        }
        (self.waiting.report)(&format!(
            "instruction gate: {} cells once more, each alone",
            open.len()
        ));
        let of_open = |configuration: &GateConfiguration| {
            let mut of_open = configuration.clone();
            of_open.stages.retain(|stage| open.contains(&CellId::new(&of_open.id, stage)));
            of_open
        };
        let again: Vec<GateConfiguration> = common.iter().map(of_open).collect();
        instructions::run(&mut self.output, &self.before, &again, true, &start, self.interrupted)?;
        self.tell_verdicts(Gate::Instructions)
    }

    fn time(&mut self, control: &CellId, common: &[GateConfiguration]) -> Result<()> {
        if !self.has_gate(Gate::Time) {
            return Ok(());
        }
        let software = self.before.header.adapter.software;
        let timed = |cell: &CellId| cell.subject().is_measured_by(Gate::Time, software);
        let cells: Vec<CellId> =
            common.iter().flat_map(GateConfiguration::cells).filter(timed).collect();
        let settings = &self.before.header.settings;
        let builds = Side::BOTH.map(|side| self.options.start(side));
        let mut workers = match LaunchProcesses::new(builds, common, settings.seed, self.waiting) {
            Ok(workers) => workers,
            Err(cause) => {
                let side = Some(cause.role.side(0));
                let fault = Fault::new(Gate::Time, side, None, cause.fault.to_string());
                return Ok(self.write_lines(vec![Compared::Fault(fault)])?);
            }
        };
        let mut schedule = GateSchedule {
            control: cells.iter().find(|cell| *cell == control).or(cells.first()).cloned(),
            cells,
            launches: 0,
            pairs: settings.pairs,
            seed: settings.seed,
        };
        let tell = self.waiting.report;
        for look in time::looks(&self.before) {
            let decided = time::decided_cells(&self.before);
            schedule.cells.retain(|cell| !decided.contains(cell));
            schedule.launches = look;
            let is_void = time::judge(&self.before).void_reason().is_some();
            if schedule.cells.is_empty() || is_void || !self.has_gate(Gate::Time) {
                break;
            }
            let (count, pairs) = (schedule.cells.len(), schedule.pairs);
            tell(&format!("time gate: cells: {count}, launches: {look} of {pairs} pairs"));
            let before = timed_before(&self.before);
            let mut done = before.complete;
            let sink = |lines: Vec<Compared>| -> Result<(), RecordError> {
                let ended = lines.iter().filter(|line| matches!(line, Compared::Launch(_)));
                done += ended.count() as u32;
                store::write(&mut self.output, lines)?;
                tell(&format!("time gate: {done} of {look} launches"));
                Ok(())
            };
            launches::run(&schedule, &mut workers, &before, self.interrupted, sink)?;
            self.tell_verdicts(Gate::Time)?;
            if self.before.launches.len() < look as usize {
                break;
            }
        }
        Ok(())
    }
}

/// The lower, the sooner a cell is measured: what differs in a way that is not known, then what differs most, and what the host does
/// last.
fn suspicion(comparison: &Comparison, cell: &CellId) -> (bool, Option<Differs>) {
    let known = comparison.changed.iter().find(|changed| changed.cell == *cell);
    (!cell.subject().is_stage(), known.map(|changed| changed.differs))
}

/// The cells on which a gate has its verdict, and the change if there is one.
fn standing(comparison: &Comparison, gate: Gate) -> Vec<(CellId, Option<String>)> {
    let percent = |share: f64| 100.0 * share;
    match gate {
        Gate::Exact => {
            let differences = exact::judge(comparison);
            let changes = |cell: &CellId| {
                let own = differences.iter().filter(|difference| difference.concerns(cell));
                let told = own.map(|of| format!("{} {:.4} → {:.4}", of.figure, of.base, of.head));
                Some(told.collect_vec().join("; ")).filter(|told| !told.is_empty())
            };
            let cells = comparison.header.cells.iter();
            let known = cells.filter(|cell| comparison.has_exact(cell));
            known.map(|cell| (cell.clone(), changes(cell))).collect()
        }
        Gate::Instructions => {
            let open = counts::open(comparison);
            let judged = counts::judge(comparison).into_iter();
            let closed = judged.filter(|(cell, _)| !open.contains(cell));
            let change = |of: &CountChange| format!("{:+.2} %", percent(of.ratio - 1.0));
            closed
                .map(|(cell, of)| (cell, (of.change != Change::Same).then(|| change(&of))))
                .collect()
        }
        Gate::Time => {
            let judged = time::judge(comparison).cells.into_iter();
            let decided = judged.filter(|of| of.verdict != TimeVerdict::Inconclusive);
            decided
                .map(|of| {
                    let [low, high] = of.change.ends().map(percent);
                    let change =
                        format!("{:+.1} % ({low:.1} … {high:.1})", percent(of.change.median));
                    (of.cell, (of.verdict != TimeVerdict::Same).then_some(change))
                })
                .collect()
        }
    }
}

/// What is there already of the time gate.
fn timed_before(before: &Comparison) -> EarlierLaunches {
    let later = before.faults.iter().skip(before.faults_before_interruption);
    let lost = later.filter(|fault| fault.gate == Gate::Time);
    let cells = lost.clone().filter(|fault| !fault.control);
    EarlierLaunches {
        complete: before.launches.len() as u32,
        last: before.last_launch,
        given_up: cells.filter_map(|fault| fault.cell.clone()).collect(),
        control_lost: lost.clone().any(|fault| fault.control),
    }
}

#[cfg(test)]
mod tests;
