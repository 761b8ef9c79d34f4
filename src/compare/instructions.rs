//! The instruction gate: on a software driver the whole GPU runs in the process, so an instruction counter measures
//! shader, rasterizer and driver almost without noise.
//!
//! A worker runs under `valgrind --tool=callgrind`, single-threaded and, where the system allows it, without address
//! randomization, and calls
//! [`fathom_sample_boundary`](super::worker::fathom_sample_boundary) around each frame, where callgrind cuts its count.
//! Seen on lavapipe: frames of a stage agree to 0.001 % (compute traces to 0.1 %), and so do two runs.

use std::collections::{BTreeMap, VecDeque};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use super::cells::{CellId, Configuration};
use super::launch::{self, Patience, Quiet, Start, Worker, WorkerFault};
use super::protocol::{Reply, Request};
use super::store::{Comparison, Fault, Gate, InstructionCounts, Line, Side, Store, StoreError};
use super::valgrind;

/// Frames that are counted of each cell and side.
pub const FRAMES: u32 = 3;
/// Under valgrind a process is tens of times slower than by itself.
const PATIENCE: Patience = Patience {
    slow: Duration::from_secs(900),
    sample: Duration::from_secs(900),
};

/// A cell's counts on both sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Counted {
    /// Medians over the frames.
    pub base: f64,
    pub head: f64,
    /// `head / base`.
    pub ratio: f64,
    pub change: Change,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    More,
    Fewer,
    Same,
}

/// Holds the counts of both sides against each other. A change is one that exceeds the threshold and the spread of
/// either side's frames; cells that lack a side are left out.
pub fn judge(comparison: &Comparison) -> BTreeMap<CellId, Counted> {
    let threshold = comparison.header.settings.instruction_threshold;
    let counts = |cell: &CellId, side: Side| {
        let mut lines = comparison.instructions.iter().rev();
        lines
            .find(|line| line.cell == *cell && line.side == side && !line.counts.is_empty())
            .map(|line| line.counts.as_slice())
    };
    let judged = |cell: &CellId| {
        let (base, head) = (counts(cell, Side::Base)?, counts(cell, Side::Head)?);
        Some((cell.clone(), held_against(base, head, threshold)))
    };
    comparison.header.cells.iter().filter_map(judged).collect()
}

fn held_against(base: &[u64], head: &[u64], threshold: f64) -> Counted {
    let ends = |counts: &[u64]| {
        let least = counts.iter().min().copied().unwrap_or(0);
        let most = counts.iter().max().copied().unwrap_or(0);
        (least, most)
    };
    let median = |counts: &[u64]| {
        let counts: Vec<f64> = counts.iter().map(|count| *count as f64).collect();
        crate::statistics::median(&counts)
    };
    let ((base_least, base_most), (head_least, head_most)) = (ends(base), ends(head));
    let (base, head) = (median(base), median(head));
    let ratio = head / base;
    let change = if ratio > 1.0 + threshold && head_least > base_most {
        Change::More
    } else if ratio < 1.0 - threshold && head_most < base_least {
        Change::Fewer
    } else {
        Change::Same
    };
    Counted {
        base,
        head,
        ratio,
        change,
    }
}

/// The version of the valgrind that is installed, if one is.
pub fn valgrind_version() -> Option<String> {
    let output = Command::new("valgrind")
        .arg("--version")
        .stdin(Stdio::null())
        .output()
        .ok()?;
    let version = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    (output.status.success() && !version.is_empty()).then_some(version)
}

/// Why the gate cannot be run; none where it can.
pub fn obstacle(software: bool) -> Option<String> {
    if !software {
        return Some("the adapter is no software driver: its work is not the process's".to_owned());
    }
    match valgrind_version() {
        Some(_) => None,
        None => Some("valgrind is not installed (Debian: apt-get install valgrind)".to_owned()),
    }
}

/// A configuration of one side, with the stages of it that are still to be counted.
struct Job<'a> {
    side: Side,
    configuration: &'a Configuration,
    stages: Vec<String>,
}

/// Counts every cell of `wanted` that `before` lacks, on both sides: as many processes at once as there are cores.
///
/// `start` tells how to start the worker of a side. What cannot be counted becomes a fault.
pub fn run(
    store: &mut Store,
    before: &Comparison,
    wanted: &[Configuration],
    start: &(dyn Fn(Side) -> Start + Sync),
    interrupted: &AtomicBool,
) -> Result<(), StoreError> {
    let jobs = Mutex::new(jobs(before, wanted));
    let cores = launch::allowed_cores();
    let workers = match cores.len() {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        n => n,
    };
    let (sender, lines) = channel();
    std::thread::scope(|scope| {
        for number in 0..workers {
            let (jobs, sender, core) = (&jobs, sender.clone(), cores.get(number).copied());
            scope.spawn(move || {
                while let Some(job) = next(jobs, interrupted) {
                    count(&job, start(job.side), core, &sender, interrupted);
                }
            });
        }
        drop(sender);
        for line in lines {
            store.write(&[line])?;
        }
        Ok(())
    })
}

fn jobs<'a>(before: &Comparison, wanted: &'a [Configuration]) -> VecDeque<Job<'a>> {
    let counted = |side: Side, cell: &CellId| {
        let mut lines = before.instructions.iter();
        lines.any(|line| line.side == side && line.cell == *cell)
    };
    let job = |configuration: &'a Configuration, side: Side| Job {
        side,
        configuration,
        stages: configuration
            .stages
            .iter()
            .filter(|stage| !counted(side, &CellId::new(&configuration.id, stage)))
            .cloned()
            .collect(),
    };
    let both = |configuration| Side::BOTH.map(|side| job(configuration, side));
    wanted
        .iter()
        .flat_map(both)
        .filter(|job| !job.stages.is_empty())
        .collect()
}

fn next<'a>(jobs: &Mutex<VecDeque<Job<'a>>>, interrupted: &AtomicBool) -> Option<Job<'a>> {
    if interrupted.load(Ordering::Relaxed) {
        return None;
    }
    jobs.lock()
        .unwrap_or_else(PoisonError::into_inner)
        .pop_front()
}

/// Counts a job's stages one after the other and sends each as a line, or the fault that ended it.
fn count(
    job: &Job<'_>,
    mut start: Start,
    core: Option<usize>,
    lines: &Sender<Line>,
    interrupted: &AtomicBool,
) {
    let fault = |cell: Option<CellId>, reason: String| {
        let configuration = &job.configuration.id;
        Line::Fault(Fault {
            gate: Gate::Instructions,
            side: Some(job.side),
            reason: match &cell {
                Some(_) => reason,
                None => format!("configuration {configuration}: {reason}"),
            },
            cell,
            launch: None,
            control: false,
            absent: false,
        })
    };
    // Nobody listens only when the store is broken, which ends everything.
    let send = |line: Line| drop(lines.send(line));
    let folder = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(error) => return send(fault(None, format!("no folder for callgrind: {error}"))),
    };
    start.wrapper = callgrind(folder.path());
    start.patience = PATIENCE;
    start.quiet = Some(Quiet { core, padding: 0 });
    let cell = |stage: &str| CellId::new(&job.configuration.id, stage);
    let mut worker = match prepared(&start, job.configuration) {
        Ok(worker) => worker,
        Err(error) => {
            for stage in &job.stages {
                send(fault(Some(cell(stage)), error.to_string()));
            }
            return;
        }
    };
    let mut cuts = 0;
    for (index, stage) in job.stages.iter().enumerate() {
        if interrupted.load(Ordering::Relaxed) {
            break;
        }
        match counted(&mut worker, folder.path(), &mut cuts, job, stage) {
            Ok(counts) => send(Line::Instructions(InstructionCounts {
                side: job.side,
                cell: cell(stage),
                counts,
            })),
            Err((reason, true)) => send(fault(Some(cell(stage)), reason)),
            Err((reason, false)) => {
                for stage in &job.stages[index..] {
                    send(fault(Some(cell(stage)), reason.clone()));
                }
                return;
            }
        }
    }
    worker.quit();
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

fn prepared(start: &Start, configuration: &Configuration) -> Result<Worker, WorkerFault> {
    let mut worker = Worker::start(start)?;
    worker.greet()?;
    worker.greeted()?;
    match worker.ask(&Request::Prepare {
        configuration: configuration.into(),
    })? {
        Reply::Prepared { .. } => Ok(worker),
        other => Err(worker.unexpected(&other)),
    }
}

/// One stage's counts, or the reason and whether the worker goes on. `cuts` counts callgrind's files so far.
fn counted(
    worker: &mut Worker,
    folder: &Path,
    cuts: &mut u32,
    job: &Job<'_>,
    stage: &str,
) -> Result<Vec<u64>, (String, bool)> {
    let request = Request::Instructions {
        config: job.configuration.id.clone(),
        stage: stage.to_owned(),
        frames: FRAMES,
    };
    match worker.ask(&request) {
        Ok(Reply::Instructions { frames: FRAMES }) => {}
        Ok(other) => return Err((worker.unexpected(&other).to_string(), false)),
        Err(error) => return Err((error.to_string(), error.goes_on())),
    }
    // The first cut ends what came before the first frame.
    let first = *cuts + 2;
    *cuts += FRAMES + 1;
    let counts: Result<Vec<u64>, String> = (first..=*cuts)
        .map(|cut| total(&folder.join(format!("{OUT}.{cut}"))))
        .collect();
    match counts {
        Ok(counts) if counts.iter().all(|count| *count > 0) => Ok(counts),
        Ok(_) => Err(("callgrind counted nothing".to_owned(), true)),
        Err(reason) => Err((reason, true)),
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
    use super::*;

    #[test]
    fn totals_are_read_from_callgrinds_files() {
        let text = "# callgrind format\nversion: 1\npart: 2\n\nevents: Ir\n\nfn=(1)\n1 5\n\ntotals: 57708534\n";
        assert_eq!(parse_total(text), Some(57_708_534));
        assert_eq!(parse_total("version: 1\n"), None);
        assert_eq!(parse_total("totals: many\n"), None);
    }

    /// The figures of two runs on lavapipe, and of one with 2 % more work.
    #[test]
    fn two_percent_more_is_a_change_and_the_spread_of_runs_is_not() {
        let base = [60_679_568, 60_718_750, 60_729_061];
        let again = [60_677_997, 60_716_862, 60_727_334];
        assert_eq!(held_against(&base, &again, 0.005).change, Change::Same);
        let more = base.map(|count| count + count / 50);
        let counted = held_against(&base, &more, 0.005);
        assert_eq!(counted.change, Change::More);
        assert!((counted.ratio - 1.02).abs() < 1e-6);
        assert_eq!(held_against(&more, &base, 0.005).change, Change::Fewer);
    }

    #[test]
    fn frames_that_vary_more_than_the_sides_differ_are_no_change() {
        let wide = [100, 110, 120];
        assert_eq!(
            held_against(&wide, &[112, 113, 114], 0.005).change,
            Change::Same
        );
        assert_eq!(
            held_against(&wide, &[121, 122, 123], 0.005).change,
            Change::More
        );
    }
}
