//! The instruction gate: on a software driver the whole GPU runs in the process, so an instruction counter measures
//! shader, rasterizer and driver almost without noise.
//!
//! A worker runs under `valgrind --tool=callgrind`, single-threaded and, where the system allows it, without address
//! randomization, and calls
//! [`fathom_sample_boundary`](super::worker::fathom_sample_boundary) around each frame, where callgrind cuts its count.
//! Seen on lavapipe: equal builds agree to 0.03 % in each of 41 cells, frames of a process to 0.08 %.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Mutex, PoisonError};

use itertools::Itertools;
use tempfile::TempDir;

use super::launch::{self, Quiet, Waiting, WorkerFault, WorkerProcess, WorkerStart};
use super::protocol::{GateConfiguration, Reply, WorkerRequest};
use super::valgrind;
use fathom_base::process;
use fathom_gates::store::{self, StoredComparison};
use fathom_record::RecordError;
use fathom_record::comparison::{CellId, Compared, Fault, Gate, InstructionCounts, Side};
use fathom_record::output::Held;

/// Frames that are counted of each cell and side.
pub const FRAMES: u32 = 3;
/// Why the gate cannot be run; none where it can.
pub fn obstacle(software: bool) -> Option<String> {
    if !software {
        return Some("the adapter is no software driver: its work is not the process's".to_owned());
    }
    let version = process::printed(Command::new("valgrind").arg("--version"));
    let is_installed = version.is_ok_and(|version| !version.is_empty());
    let lacks = || "valgrind is not installed (Debian: apt-get install valgrind)".to_owned();
    (!is_installed).then(lacks)
}

/// A configuration of one side, with the stages of it that are still to be counted.
struct Job<'a> {
    side: Side,
    configuration: &'a GateConfiguration,
    stages: Vec<String>,
}

/// Counts every cell of `wanted` that `before` lacks, on both sides: as many processes at once as there are cores.
///
/// `start` tells how to start the worker of a side. What cannot be counted becomes a fault.
pub fn run(
    held: &mut Held,
    before: &StoredComparison,
    wanted: &[GateConfiguration],
    start: &(dyn Fn(Side) -> WorkerStart + Sync),
    interrupted: &AtomicBool,
) -> Result<(), RecordError> {
    let jobs = Mutex::new(jobs(before, wanted));
    let cores = launch::allowed_cores();
    let workers = match cores.len() {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        n => n,
    };
    let (sender, lines) = channel();
    let broken = AtomicBool::new(false);
    let ending = [interrupted, &broken];
    std::thread::scope(|scope| {
        for number in 0..workers {
            let (jobs, sender, core) = (&jobs, sender.clone(), cores.get(number).copied());
            scope.spawn(move || {
                let waiting = Waiting { interrupted: &ending, ..Waiting::PLAINLY };
                let next = || jobs.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
                while let Some(job) = next().filter(|_| !waiting.is_interrupted()) {
                    let start = quieted(start(job.side), core);
                    count(&job, &Conditions { start, wrapper: callgrind, waiting }, &sender);
                }
            });
        }
        drop(sender);
        let mut lines = lines.into_iter();
        let written = lines.try_for_each(|line| store::write(held, vec![line]));
        broken.store(written.is_err(), Ordering::Relaxed);
        written
    })
}

fn quieted(start: WorkerStart, core: Option<usize>) -> WorkerStart {
    WorkerStart { quiet: Some(Quiet { core, ..Quiet::default() }), ..start }
}

fn jobs<'a>(before: &StoredComparison, wanted: &'a [GateConfiguration]) -> VecDeque<Job<'a>> {
    let job = |(configuration, side): (&'a GateConfiguration, Side)| {
        let missing = |stage: &&String| {
            let cell = CellId::new(&configuration.id, stage);
            !before.instructions.iter().any(|line| line.side == side && line.cell == cell)
        };
        let stages = configuration.stages.iter().filter(missing).cloned().collect();
        Job { side, configuration, stages }
    };
    let all = wanted.iter().cartesian_product(Side::BOTH).map(job);
    all.filter(|job| !job.stages.is_empty()).collect()
}

/// How a job is counted.
struct Conditions<'a> {
    start: WorkerStart,
    /// The command that counts, which leaves its files in a folder.
    wrapper: fn(&Path) -> Vec<OsString>,
    /// Tells when the gate ends. Nobody hears of a long wait: under callgrind every reply takes long, and several are waited
    /// for at once.
    waiting: Waiting<'a>,
}

/// Counts a job's stages one after the other and sends each as a line, or the fault that it ended in. Stages after a fault
/// are counted by a fresh worker; they fail too if that cannot be had, or if the worker hung.
fn count(job: &Job<'_>, conditions: &Conditions<'_>, lines: &Sender<Compared>) {
    let cell = |stage: &str| CellId::new(&job.configuration.id, stage);
    // Nobody listens only when the store is broken, which ends everything.
    let send = |line: Compared| drop(lines.send(line));
    let send_faults = |stages: &[String], cause: &WorkerFault| {
        for stage in stages {
            let (side, cell) = (Some(job.side), Some(cell(stage)));
            send(Compared::Fault(Fault::new(Gate::Instructions, side, cell, cause.to_string())));
        }
    };
    let mut counter = None;
    for (index, stage) in job.stages.iter().enumerate() {
        if conditions.waiting.is_interrupted() {
            break;
        }
        let mut ready = match counter.take().map_or_else(|| Counter::new(job, conditions), Ok) {
            Ok(ready) => ready,
            Err(_) if conditions.waiting.is_interrupted() => return,
            Err(cause) => return send_faults(&job.stages[index..], &cause),
        };
        match ready.count(&job.configuration.id, stage, conditions.waiting) {
            Ok(counts) => {
                let (side, cell) = (job.side, cell(stage));
                send(Compared::Instructions(InstructionCounts { side, cell, counts }));
                counter = Some(ready);
            }
            Err(_) if conditions.waiting.is_interrupted() => return,
            Err(cause @ WorkerFault::Silent { .. }) => {
                return send_faults(&job.stages[index..], &cause);
            }
            Err(cause) => send_faults(&job.stages[index..=index], &cause),
        }
    }
    if let Some(counter) = counter {
        counter.worker.quit();
    }
}

fn callgrind(folder: &Path) -> Vec<OsString> {
    let mut out = OsString::from("--callgrind-out-file=");
    out.push(folder.join(OUT));
    let held_back = valgrind::SUPPORTED.then(|| OsString::from("--instr-atstart=no"));
    ["valgrind", "--tool=callgrind", "--vgdb=no", "-q"]
        .map(OsString::from)
        .into_iter()
        .chain(held_back)
        .chain([OsString::from("--dump-before=fathom_sample_boundary"), out])
        .collect()
}

/// Stem of callgrind's files: each cut adds one, numbered from 1.
const OUT: &str = "callgrind.out";

/// A worker that has prepared a configuration, and where its counts go.
struct Counter {
    worker: WorkerProcess,
    folder: TempDir,
    /// Files that callgrind has written so far.
    cuts: u32,
}

impl Counter {
    fn new(job: &Job<'_>, conditions: &Conditions<'_>) -> Result<Self, WorkerFault> {
        let folder = tempfile::tempdir()
            .map_err(|error| WorkerFault::fatal(format!("no folder for callgrind: {error}")))?;
        let wrapper = (conditions.wrapper)(folder.path());
        let start = WorkerStart { wrapper, ..conditions.start.clone() };
        let (mut worker, _) = WorkerProcess::open(&start, &conditions.waiting)?;
        let request = WorkerRequest::Prepare { configuration: job.configuration.clone() };
        match worker.ask(&request, &conditions.waiting)? {
            Reply::Prepared { .. } => Ok(Self { worker, folder, cuts: 0 }),
            other => Err(worker.unexpected(&other)),
        }
    }

    /// One stage's counts. After a fault callgrind may have cut any number of times: then the counter is of no more use.
    fn count(
        &mut self,
        configuration: &str,
        stage: &str,
        waiting: Waiting<'_>,
    ) -> Result<Vec<u64>, WorkerFault> {
        let request = WorkerRequest::Instructions {
            config: configuration.to_owned(),
            stage: stage.to_owned(),
            frames: FRAMES,
        };
        match self.worker.ask(&request, &waiting)? {
            Reply::Instructions { frames: FRAMES } => {}
            other => return Err(self.worker.unexpected(&other)),
        }
        // The first cut ends what came before the first frame.
        let first = self.cuts + 2;
        self.cuts += FRAMES + 1;
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
    use std::time::Duration;

    use super::*;

    /// A worker that cuts as callgrind does: the counts of `b` are in the twenties, all others in the tens. It refuses `bad` after a
    /// cut, dies at `dead` and hangs at `slow`.
    const SCRIPT: &str = r#"n=0
cut() { n=$((n + 1)); echo "totals: $1" > "$FOLDER/callgrind.out.$n"; }
while read -r line; do case "$line" in
*'"hello"'*) echo '{"message":"hello","protocol":1,"fathom_version":"0","adapter":ADAPTER,"parts":[],"cores":null,"randomized":null,"notes":[]}';;
*'"prepare"'*) echo '{"message":"prepared","stages":[]}';;
*'"bad"'*) cut 9; echo '{"message":"fault","reason":"too hot","fatal":false,"absent":false}';;
*'"dead"'*) cut 9; exit 3;;
*'"slow"'*) : > "$0.slow"; while [ -e "$0.slow" ]; do sleep 0.1; done;;
*'"b"'*) cut 1; cut 21; cut 22; cut 23; echo '{"message":"instructions","frames":3}';;
*'"instructions"'*) cut 1; cut 11; cut 12; cut 13; echo '{"message":"instructions","frames":3}';;
esac; done
"#;

    fn wrapper(folder: &Path) -> Vec<OsString> {
        let mut variable = OsString::from("FOLDER=");
        variable.push(folder);
        vec!["env".into(), variable, "sh".into()]
    }

    /// What a job of these stages sends, by stage: counts or a reason.
    fn sent(folder: &Path, stages: &[&str], ending: &[&AtomicBool]) -> Vec<String> {
        let script = folder.join("worker");
        let adapter = serde_json::to_string(&fathom_record::Adapter::default()).unwrap();
        std::fs::write(&script, SCRIPT.replace("ADAPTER", &adapter)).unwrap();
        let stages: Vec<String> = stages.iter().map(|stage| (*stage).to_owned()).collect();
        let id = "one".to_owned();
        let configuration = GateConfiguration { id, stages: stages.clone(), ..Default::default() };
        let job = Job { side: Side::Head, configuration: &configuration, stages };
        let start = quieted(WorkerStart::new(&script), None);
        let waiting = Waiting { interrupted: ending, ..Waiting::PLAINLY };
        let conditions = Conditions { start, wrapper, waiting };
        let (sender, lines) = channel();
        count(&job, &conditions, &sender);
        drop(sender);
        let told = |line: Compared| match line {
            Compared::Instructions(line) => format!("{} {:?}", line.cell.stage(), line.counts),
            Compared::Fault(fault) => format!("{} {}", fault.cell.unwrap().stage(), fault.reason),
            other => panic!("{other:?}"),
        };
        lines.into_iter().map(told).collect()
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
        assert_eq!(sent(folder.path(), &["a", "bad", "b", "dead", "a"], &[]), expected);
    }

    #[cfg(unix)]
    #[test]
    fn an_interrupt_ends_the_wait_for_a_count_and_faults_nothing() {
        let interrupted = AtomicBool::new(false);
        let folder = tempfile::tempdir().unwrap();
        // At the end of its patience the hung stage would be faulted.
        let lines = std::thread::scope(|scope| {
            let lines = scope.spawn(|| sent(folder.path(), &["slow", "a"], &[&interrupted]));
            while !folder.path().join("worker.slow").exists() && !lines.is_finished() {
                std::thread::sleep(Duration::from_millis(20));
            }
            interrupted.store(true, Ordering::Relaxed);
            lines.join().unwrap()
        });
        assert!(lines.is_empty(), "{lines:?}");
    }

    #[test]
    fn totals_are_read_from_callgrinds_files() {
        let text = "# callgrind format\nversion: 1\npart: 2\n\nevents: Ir\n\nfn=(1)\n1 5\n\ntotals: 57708534\n";
        assert_eq!(parse_total(text), Some(57_708_534));
        assert_eq!(parse_total("version: 1\n"), None);
        assert_eq!(parse_total("totals: many\n"), None);
    }
}
