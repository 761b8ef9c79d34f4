//! Runs and repositories that were never measured.

use std::path::PathBuf;

use fathom::record::{
    Adapter, Ceiling, Clock, ErrorFigure, FrameRecord, Limit, Measured, Outcome, Record, Run,
    SCHEMA, StageRecord,
};
use fathom::statistics::estimate;
use serde_json::json;

use crate::common::{Ends, git, lines, own_cell};

pub const CELLS: usize = 3;
/// Frame, a stage and an error.
pub const FIGURES_OF_A_CELL: usize = 3;

/// Samples about a time, nanoseconds.
fn samples(ns: f64) -> Vec<f64> {
    (0..7).map(|i| ns * (1.0 + 1e-3 * f64::from(i))).collect()
}

fn cell(number: usize, ns: f64) -> Record {
    let untimed_samples_ns = samples(2.0 * ns);
    let untimed = estimate(&untimed_samples_ns);
    let measured = Measured {
        stages: vec![StageRecord::new("caustics/trace", Clock::ProcessCpu, samples(ns), &[])],
        frame: FrameRecord { untimed_samples_ns, untimed, ..FrameRecord::default() },
        errors: vec![ErrorFigure::new("photon_error_p99_m", 0.25, "m", "caustics/trace")],
        ..Measured::default()
    };
    let mut cell = own_cell(&format!("n={number}"), Outcome::Measured(Box::new(measured)));
    cell.params = json!({ "n": number }).into();
    Record::Cell(Box::new(cell))
}

/// Of a run that starts at a second on a machine.
fn header(second: usize, host: Option<&str>) -> Record {
    let adapter =
        Adapter { name: "made".to_owned(), backend: "vulkan".to_owned(), ..Adapter::default() };
    let started_at = format!("2026-01-02T03:{:02}:{:02}Z", second / 60, second % 60);
    let mut run = Run { schema: SCHEMA, started_at, adapter, ..Run::default() };
    run.conditions.host = host.map(str::to_owned);
    Record::Run(Box::new(run))
}

/// Shards of a cell each, measured on these machines and merged.
pub fn merged(second: usize, hosts: &[&str]) -> String {
    let shard = |(number, host): (usize, &&str)| [header(second, Some(host)), cell(number, 5e6)];
    lines(hosts.iter().enumerate().flat_map(shard))
}

/// A run of so many cells, which starts at a second. Cell 0 takes `ns`, the others a time that never changes much.
pub fn records(second: usize, cells: usize, ns: f64) -> String {
    let jitter = 1.0 + 1e-3 * ((second * 7919) % 13) as f64;
    let time = |number: usize| jitter * if number == 0 { ns } else { 5e6 };
    let cells = (0..cells).map(|number| cell(number, time(number)));
    lines(std::iter::once(header(second, None)).chain(cells))
}

/// The same run on an adapter that reads so many bytes a second.
pub fn with_limit(records: &str, rate: f64) -> String {
    let (header, rest) = records.split_once('\n').unwrap();
    let mut header: Record = serde_json::from_str(header).unwrap();
    let limit = Limit::ReadCached;
    let rate = estimate(&samples(rate));
    header.try_as_run_mut().unwrap().ceilings = vec![Ceiling::new(limit, rate, 2.0)];
    lines([header]) + rest
}

/// A repository of empty commits.
pub struct Repository {
    pub folder: PathBuf,
    pub commits: Vec<String>,
}

impl Repository {
    /// A commit of each of these days on top of the one before.
    pub fn new(folder: PathBuf, days: impl IntoIterator<Item = usize>) -> Repository {
        std::fs::create_dir_all(&folder).unwrap();
        git(&folder).args(["init", "--quiet", "--initial-branch", "main"]).ends(0);
        let commits = days.into_iter().map(|day| {
            let date = format!("2026-{:02}-{:02}T12:00:00Z", 1 + day / 28, 1 + day % 28);
            let mut commit = git(&folder);
            commit.envs(["AUTHOR", "COMMITTER"].map(|who| (format!("GIT_{who}_DATE"), &date)));
            commit.args(["commit", "--quiet", "--allow-empty", "--message", "day"]).ends(0);
            git(&folder).args(["rev-parse", "HEAD"]).answer().trim().to_owned()
        });
        let commits = commits.collect();
        Repository { folder, commits }
    }
}
