//! The instruction gate: on a software driver the whole GPU runs in the process, so an instruction counter measures
//! shader, rasterizer and driver almost without noise.
//!
//! A worker runs under `valgrind --tool=callgrind`, single-threaded and, where the system allows it, without address
//! randomization, and calls
//! [`fathom_sample_boundary`](super::worker::fathom_sample_boundary) around each frame, where callgrind cuts its count.
//! Seen on lavapipe: builds with two versions of wgpu agree to 0.05 % in each of 65 stages, frames of a process to 0.08 %.
//!
//! Only a process counts that found all its shaders in the driver's cache. Where it compiled some, Mesa compresses them for the
//! cache in a thread of its own, whose instructions fall on any frame (up to 12 % of one of `rays/reduce`), and the compiler leaves
//! another heap behind, which changes counts by 0.5 to 3 %. The caches are kept. A process in which one grew is followed by fresh ones
//! until none grows: of a configuration's shaders lavapipe stored one in the second process and one in the third.
//!
//! What a process did before decides how the C library's free blocks lie, and so how many of them an allocation looks through: `rays/reduce`
//! of one build took 12.16, 12.49 and 12.54 million instructions in processes that had compiled, had counted nothing before or had counted
//! other stages, and all of the difference was in `_int_malloc` and what it calls. So cells whose counts differ are counted again, each
//! alone in a fresh process of each side.

use std::collections::{BTreeSet, VecDeque};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::channel;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use itertools::{Either, Itertools};
use tempfile::TempDir;

use super::protocol::{GateConfiguration, Reply, WorkerRequest};
use super::valgrind;
use super::worker_process::{self, Quiet, ReplyWait, WorkerFault, WorkerProcess, WorkerStart};
use fathom_base::process;
use fathom_judge::store::{self, Comparison};
use fathom_record::RecordError;
use fathom_record::comparison::{
    CellId, CellSubject, Compared, Fault, Gate, InstructionCounts, Side,
};
use fathom_record::output::Recording;
use fathom_scene::assets;

/// Frames that are counted of each cell and side.
const FRAMES: u32 = 3;
/// Time that a worker under callgrind has to end, in which its driver fills the shader cache. Then it is killed.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(60);

/// Why the gate cannot be run; none where it can.
pub fn obstacle(software: bool) -> Option<String> {
    if !software {
        return Some("the adapter is no software driver: its work is not the process's".to_owned());
    }
    let version = process::run_for_stdout(Command::new("valgrind").arg("--version"));
    let is_installed = version.is_ok_and(|version| !version.is_empty());
    let lacks = || "valgrind is not installed (Debian: apt-get install valgrind)".to_owned();
    (!is_installed).then(lacks)
}

/// What one process counts: cells of one side, those of a configuration one after the other.
#[derive(Clone)]
struct Job<'a> {
    side: Side,
    cells: Vec<(&'a GateConfiguration, &'a String)>,
    /// It is there for one cell.
    alone: bool,
    /// Its shader cache is called so.
    shaders: String,
}

/// Counts every cell of `wanted` that `before` lacks, on both sides: as many processes at once as there are cores. Each
/// counts many configurations, as valgrind's translation of the program takes half of the time of a process that counts one.
///
/// `start` tells how to start the worker of a side. What cannot be counted becomes a fault. Where each cell is counted `alone`, it has a
/// process to itself.
pub fn run(
    held: &mut Recording,
    before: &Comparison,
    wanted: &[GateConfiguration],
    alone: bool,
    start: &(dyn Fn(Side) -> WorkerStart + Sync),
    interrupted: &AtomicBool,
) -> Result<(), RecordError> {
    let cores = worker_process::allowed_cores();
    let workers = match cores.len() {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        n => n,
    };
    let jobs = Mutex::new(jobs(before, wanted, alone, workers));
    let (sender, lines) = channel();
    std::thread::scope(|scope| {
        for number in 0..workers {
            let (jobs, sender, core) = (&jobs, sender.clone(), cores.get(number).copied());
            scope.spawn(move || {
                let waiting = ReplyWait { interrupted: Some(interrupted), ..ReplyWait::SILENT };
                let next = || jobs.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
                while let Some(sides) = next().filter(|_| !waiting.is_interrupted()) {
                    // One side after the other: what the first compiles the second finds.
                    for job in sides {
                        let start = quieted(start(job.side), core);
                        let start = with_kept_shaders(start, &job.shaders);
                        let conditions = CountingSetup { start, wrapper: callgrind, waiting };
                        for line in count_warm(&job, &conditions) {
                            // There is no receiver where a line could not be stored.
                            if sender.send(line).is_err() {
                                return;
                            }
                        }
                    }
                }
            });
        }
        drop(sender);
        lines.into_iter().try_for_each(|line| store::write(held, vec![line]))
    })
}

fn quieted(start: WorkerStart, core: Option<usize>) -> WorkerStart {
    let quiet = Quiet { core, ..Quiet::default() };
    WorkerStart { quiet: Some(quiet), ..start }
}

/// By groups of configurations, for both sides: a group for each of `workers`, or one where there are few, whose sides are counted at
/// once. Where each cell is counted `alone`, a job for each cell and side.
fn jobs<'a>(
    before: &Comparison,
    wanted: &'a [GateConfiguration],
    alone: bool,
    workers: usize,
) -> VecDeque<Vec<Job<'a>>> {
    let counted: BTreeSet<_> =
        before.instructions.iter().map(|line| (line.side, &line.cell, line.second)).collect();
    let both = |cells: Vec<(&'a GateConfiguration, &'a String)>, shaders: String| {
        let job = |side| {
            let mut cells = cells.clone();
            cells.retain(|(own, stage)| {
                !counted.contains(&(side, &CellId::new(&own.id, stage), alone))
            });
            Job { side, cells, alone, shaders: shaders.clone() }
        };
        Side::BOTH.map(job).into_iter().filter(|job| !job.cells.is_empty()).collect_vec()
    };
    let cells = |own: &'a GateConfiguration| own.stages.iter().map(move |stage| (own, stage));
    let groups = if wanted.len() < 2 * workers { 1 } else { workers };
    let size = wanted.len().div_ceil(groups).max(1);
    // What a group's process has compiled those find that count one of its cells.
    let shaders = |index: usize| format!("group-{}-of-{groups}", index / size);
    let mut jobs: Vec<Vec<Job<'a>>> = if alone {
        let of_configuration = |(index, own): (usize, &'a GateConfiguration)| {
            cells(own).flat_map(|cell| both(vec![cell], shaders(index))).collect()
        };
        wanted.iter().enumerate().map(of_configuration).collect()
    } else {
        let of_group = |(number, group): (usize, &'a [GateConfiguration])| {
            both(group.iter().flat_map(cells).collect(), shaders(number * size))
        };
        wanted.chunks(size).enumerate().map(of_group).collect()
    };
    jobs.retain(|sides| !sides.is_empty());
    if jobs.len() < workers {
        jobs = jobs.into_iter().flatten().map(|job| vec![job]).collect();
    }
    jobs.into()
}

/// Most that Mesa keeps of the shaders of a process.
const MAX_SHADERS: &str = "MESA_SHADER_CACHE_MAX_SIZE=256M";

/// With a shader cache of its own: in that of the side if it has one, else in one that is kept from comparison to comparison.
fn with_kept_shaders(start: WorkerStart, name: &str) -> WorkerStart {
    let kept = || Some(assets::cache()?.join("callgrind-shaders"));
    let Some(folder) = start.shader_cache.clone().or_else(kept) else { return start };
    let folder = folder.join(name);
    // Where there can be none the driver has its own, and nothing tells whether it grew.
    let is_there = std::fs::create_dir_all(&folder).is_ok();
    WorkerStart { shader_cache: is_there.then_some(folder), ..start }
}

/// Bytes of a folder's files, without following links; 0 where there is none.
fn size(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = |entry: std::fs::DirEntry| match entry.metadata() {
        Ok(of) if of.is_dir() => size(&entry.path()),
        Ok(of) => of.len(),
        Err(_) => 0,
    };
    entries.map(bytes).sum()
}

/// Processes that may find a shader to compile: on lavapipe three did.
const MAX_COMPILING: u32 = 5;

/// The counts of the first process that compiled no shader, or of the last where each compiles some.
fn count_warm(job: &Job<'_>, conditions: &CountingSetup<'_>) -> Vec<Compared> {
    let kept = || conditions.start.shader_cache.as_deref().map_or(0, size);
    for _ in 0..MAX_COMPILING {
        let before = kept();
        let is_warm = || kept() == before;
        let (lines, grew) = count(job, conditions, &is_warm);
        if !grew && is_warm() || conditions.waiting.is_interrupted() {
            return lines;
        }
    }
    count(job, conditions, &|| true).0
}

struct CountingSetup<'a> {
    start: WorkerStart,
    /// The command that counts, which leaves its files in a folder.
    wrapper: fn(&Path) -> Vec<OsString>,
    /// Tells when the gate ends. Nobody hears of a long wait: under callgrind every reply takes long, and several are waited
    /// for at once.
    waiting: ReplyWait<'a>,
}

/// Counts a job's cells one after the other: a line each, or the fault that it ended in. Cells after a fault are counted by a
/// fresh worker; they fail too if that cannot be had, and those of their configuration if the worker hung. Ends before the
/// first count where a prepared worker is not `warm`; then the second value is true.
fn count(
    job: &Job<'_>,
    conditions: &CountingSetup<'_>,
    warm: &dyn Fn() -> bool,
) -> (Vec<Compared>, bool) {
    let mut lines = Vec::new();
    let mut remaining: VecDeque<_> = job.cells.iter().copied().collect();
    let mut counter: Option<Counter> = None;
    while let Some((configuration, stage)) = remaining.front().copied() {
        let ready = match counter.take().map_or_else(|| Counter::new(&remaining, conditions), Ok) {
            Ok(ready) => ready,
            Err(_) if conditions.waiting.is_interrupted() => break,
            Err((unprepared, cause)) => {
                let is_lost = |own: &GateConfiguration| unprepared.is_none_or(|id| own.id == id);
                lines.extend(drop_cells(job, &mut remaining, is_lost, &cause));
                continue;
            }
        };
        if lines.is_empty() && !warm() {
            ready.quit();
            return (lines, true);
        }
        let mut ready = ready;
        match ready.count(&configuration.id, stage, conditions.waiting) {
            Ok(counts) => {
                let (side, second) = (job.side, job.alone);
                let cell = CellId::new(&configuration.id, stage);
                lines.push(Compared::Instructions(InstructionCounts {
                    side,
                    cell,
                    counts,
                    second,
                }));
                counter = Some(ready);
                remaining.pop_front();
            }
            Err(_) if conditions.waiting.is_interrupted() => break,
            Err(cause @ WorkerFault::Silent { .. }) => {
                lines.extend(drop_cells(
                    job,
                    &mut remaining,
                    |own| own.id == configuration.id,
                    &cause,
                ));
            }
            Err(cause) => {
                remaining.pop_front();
                lines.push(fault(job.side, configuration, stage, &cause));
            }
        }
    }
    if let Some(counter) = counter {
        counter.quit();
    }
    (lines, false)
}

/// The faults of the cells that are left of some configurations, which are then left out.
fn drop_cells<'a>(
    job: &Job<'_>,
    left: &mut VecDeque<(&'a GateConfiguration, &'a String)>,
    is_lost: impl Fn(&GateConfiguration) -> bool,
    cause: &WorkerFault,
) -> Vec<Compared> {
    let (gone, kept): (Vec<_>, VecDeque<_>) = left.drain(..).partition_map(|cell| match cell {
        (own, _) if is_lost(own) => Either::Left(cell),
        _ => Either::Right(cell),
    });
    *left = kept;
    gone.into_iter().map(|(own, stage)| fault(job.side, own, stage, cause)).collect()
}

fn fault(side: Side, own: &GateConfiguration, stage: &str, cause: &WorkerFault) -> Compared {
    let cell = Some(CellId::new(&own.id, stage));
    Compared::Fault(Fault::new(Gate::Instructions, Some(side), cell, cause.to_string()))
}

fn callgrind(folder: &Path) -> Vec<OsString> {
    let mut out = OsString::from("--callgrind-out-file=");
    out.push(folder.join(OUT));
    let held_back = valgrind::SUPPORTED.then(|| OsString::from("--instr-atstart=no"));
    ["env", MAX_SHADERS, "valgrind", "--tool=callgrind", "--vgdb=no", "-q"]
        .map(OsString::from)
        .into_iter()
        .chain(held_back)
        .chain([OsString::from("--dump-before=fathom_sample_boundary"), out])
        .collect()
}

/// Stem of callgrind's files: each cut adds one, numbered from 1.
const OUT: &str = "callgrind.out";

/// A worker that has prepared configurations, and where its counts go.
struct Counter {
    worker: WorkerProcess,
    folder: TempDir,
    /// Files that callgrind has written so far.
    cuts: u32,
}

impl Counter {
    /// Has prepared what the cells need that are left. A fault comes with the configuration that it is of.
    fn new<'a>(
        left: &VecDeque<(&'a GateConfiguration, &String)>,
        conditions: &CountingSetup<'_>,
    ) -> Result<Self, (Option<&'a str>, WorkerFault)> {
        let folder = tempfile::tempdir()
            .map_err(|error| WorkerFault::fatal(format!("no folder for callgrind: {error}")))
            .map_err(|fault| (None, fault))?;
        let wrapper = (conditions.wrapper)(folder.path());
        let start = WorkerStart { wrapper, ..conditions.start.clone() };
        let (mut worker, _) =
            WorkerProcess::open(&start, &conditions.waiting).map_err(|fault| (None, fault))?;
        for configuration in left.iter().map(|(own, _)| *own).dedup_by(|a, b| a.id == b.id) {
            let request = WorkerRequest::Prepare { configuration: configuration.clone() };
            let prepared = match worker.ask(&request, &conditions.waiting) {
                Ok(Reply::Prepared { .. }) => continue,
                Ok(other) => worker.unexpected(&other),
                Err(fault) => fault,
            };
            return Err((Some(&configuration.id), prepared));
        }
        Ok(Self { worker, folder, cuts: 0 })
    }

    fn quit(self) {
        self.worker.quit_within(SHUTDOWN_TIMEOUT);
    }

    /// One stage's counts. After a fault callgrind may have cut any number of times: then the counter is of no more use.
    fn count(
        &mut self,
        configuration: &str,
        stage: &str,
        waiting: ReplyWait<'_>,
    ) -> Result<Vec<u64>, WorkerFault> {
        let frames = if CellSubject::parse(stage) == CellSubject::Create { 1 } else { FRAMES };
        let request = WorkerRequest::Instructions {
            config: configuration.to_owned(),
            stage: stage.to_owned(),
            frames,
        };
        match self.worker.ask(&request, &waiting)? {
            Reply::Instructions { frames: counted } if counted == frames => {}
            other => return Err(self.worker.unexpected(&other)),
        }
        // The first cut ends what came before the first frame.
        let first = self.cuts + 2;
        self.cuts += frames + 1;
        let count = |cut| match total(&self.folder.path().join(format!("{OUT}.{cut}"))) {
            Ok(0) => Err("callgrind counted nothing".to_owned()),
            count => count,
        };
        (first..=self.cuts).map(count).collect::<Result<_, _>>().map_err(WorkerFault::fatal)
    }
}

/// The count of one cut, whose file is removed.
fn total(path: &PathBuf) -> Result<u64, String> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| format!("callgrind wrote no {}: {error}", path.display()))?;
    // The next cut does not depend on it; what cannot be removed goes with the folder.
    let _ = std::fs::remove_file(path);
    parse_total(&text).ok_or_else(|| format!("no total in callgrind's {}", path.display()))
}

fn parse_total(text: &str) -> Option<u64> {
    let total = text.lines().find_map(|line| line.strip_prefix("totals:"))?;
    total.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;

    /// A worker that cuts as callgrind does: the counts of `b` are in the twenties, all others in the tens. It refuses `bad` after a
    /// cut, dies at `dead` and hangs at `slow`. What it compiles for `compiled`, in two processes, adds 60 to its counts, and is kept.
    const SCRIPT: &str = r#"n=0
cut() { n=$((n + 1)); echo "totals: $1" > "$FOLDER/callgrind.out.$n"; }
while read -r line; do case "$line" in
*'"hello"'*) echo '{"message":"hello","protocol":1,"fathom_version":"0","adapter":ADAPTER,"parts":[],"cores":null,"randomized":null,"notes":[]}';;
*'"prepare"'*) echo '{"message":"prepared","stages":[]}';;
*'"bad"'*) cut 9; echo '{"message":"fault","reason":"too hot","fatal":false,"absent":false}';;
*'"dead"'*) cut 9; exit 3;;
*'"slow"'*) : > "$0.slow"; while [ -e "$0.slow" ]; do sleep 0.1; done;;
*'"b"'*) cut 1; cut 21; cut 22; cut 23; echo '{"message":"instructions","frames":3}';;
*'"compiled"'*) of=3; kept="$MESA_SHADER_CACHE_DIR/kept"
    grep -q codecode "$kept" || { of=9; printf code >> "$kept"; }
    cut 1; cut ${of}1; cut ${of}2; cut ${of}3; echo '{"message":"instructions","frames":3}';;
*'"instructions"'*) cut 1; cut 11; cut 12; cut 13; echo '{"message":"instructions","frames":3}';;
esac; done
"#;

    fn wrapper(folder: &Path) -> Vec<OsString> {
        let mut variable = OsString::from("FOLDER=");
        variable.push(folder);
        vec!["env".into(), variable, "sh".into()]
    }

    /// What a job of these stages sends, by stage: counts or a reason.
    fn sent(folder: &Path, stages: &[&str], interrupted: Option<&AtomicBool>) -> Vec<String> {
        let script = folder.join("worker");
        let adapter = serde_json::to_string(&fathom_record::Adapter::default()).unwrap();
        std::fs::write(&script, SCRIPT.replace("ADAPTER", &adapter)).unwrap();
        let stages: Vec<String> = stages.iter().map(|stage| (*stage).to_owned()).collect();
        let id = "one".to_owned();
        let configuration = GateConfiguration { id, stages, ..Default::default() };
        let cells = configuration.stages.iter().map(|stage| (&configuration, stage)).collect();
        let job = Job { side: Side::Head, cells, alone: false, shaders: String::new() };
        let start = quieted(WorkerStart::new(&script), None);
        let start = WorkerStart { shader_cache: Some(folder.join("shaders")), ..start };
        std::fs::create_dir_all(folder.join("shaders")).unwrap();
        let waiting = ReplyWait { interrupted, ..ReplyWait::SILENT };
        let conditions = CountingSetup { start, wrapper, waiting };
        let told = |line: Compared| match line {
            Compared::Instructions(line) => format!("{} {:?}", line.cell.stage(), line.counts),
            Compared::Fault(fault) => format!("{} {}", fault.cell.unwrap().stage(), fault.reason),
            other => panic!("{other:?}"),
        };
        count_warm(&job, &conditions).into_iter().map(told).collect()
    }

    #[cfg(unix)]
    #[test]
    fn a_process_that_compiled_a_shader_does_not_count() {
        let folder = tempfile::tempdir().unwrap();
        for _ in 0..2 {
            let lines = sent(folder.path(), &["a", "compiled"], None);
            assert_eq!(lines, ["a [11, 12, 13]", "compiled [31, 32, 33]"]);
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_stage_that_fails_shifts_no_later_counts() {
        let expected = [
            "a [11, 12, 13]",
            "bad too hot",
            "b [21, 22, 23]",
            "dead it ended with exit status: 3",
            "a [11, 12, 13]",
        ];
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(sent(folder.path(), &["a", "bad", "b", "dead", "a"], None), expected);
    }

    #[cfg(unix)]
    #[test]
    fn an_interrupt_ends_the_wait_for_a_count_and_faults_nothing() {
        let interrupted = AtomicBool::new(false);
        let folder = tempfile::tempdir().unwrap();
        // At the end of its patience the hung stage would be faulted.
        let lines = std::thread::scope(|scope| {
            let lines = scope.spawn(|| sent(folder.path(), &["slow", "a"], Some(&interrupted)));
            while !folder.path().join("worker.slow").exists() && !lines.is_finished() {
                std::thread::sleep(Duration::from_millis(20));
            }
            interrupted.store(true, Ordering::Relaxed);
            lines.join().unwrap()
        });
        assert!(lines.is_empty(), "{lines:?}");
    }

    /// Also where a comparison is resumed that has counted some of them.
    #[test]
    fn cells_that_are_counted_alone_have_a_process_each() {
        let stages = ["a", "b"].map(str::to_owned).to_vec();
        let own = |id: &str| GateConfiguration {
            id: id.to_owned(),
            stages: stages.clone(),
            ..Default::default()
        };
        let wanted = ["one", "two", "three", "four"].map(own);
        let mut before = Comparison::default();
        let cell = CellId::new("one", "a");
        let done = InstructionCounts { side: Side::Base, cell, counts: vec![1], second: true };
        before.instructions.push(done);
        let told = |wanted: &[GateConfiguration], alone| {
            let jobs = jobs(&before, wanted, alone, 2).into_iter();
            let names = |job: &Job<'_>| {
                let cells = job.cells.iter().map(|(own, stage)| format!("{} {stage}", own.id));
                format!("{}: {}", job.side, cells.format(", "))
            };
            jobs.map(|sides| sides.iter().map(names).collect_vec()).collect_vec()
        };
        let group = ["base: one a, one b, two a, two b", "head: one a, one b, two a, two b"];
        assert_eq!(told(&wanted, false)[0], group);
        assert_eq!(told(&wanted, false).len(), 2);
        let alone = told(&wanted, true);
        assert_eq!(alone[0], ["head: one a", "base: one b", "head: one b"]);
        assert_eq!(alone[1], ["base: two a", "head: two a", "base: two b", "head: two b"]);
        // Of few both sides at once.
        assert_eq!(told(&wanted[..2], false), group.map(|side| [side]));
        assert_eq!(
            told(&wanted[..1], true),
            alone[0].iter().map(|job| [job.clone()]).collect_vec()
        );
    }

    #[test]
    fn totals_are_read_from_callgrinds_files() {
        let text = "# callgrind format\nversion: 1\npart: 2\n\nevents: Ir\n\nfn=(1)\n1 5\n\ntotals: 57708534\n";
        assert_eq!(parse_total(text), Some(57_708_534));
        assert_eq!(parse_total("version: 1\n"), None);
        assert_eq!(parse_total("totals: many\n"), None);
    }
}
