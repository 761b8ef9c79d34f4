//! What is known of each shard: from the queue, from its folder, and told to the user.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use itertools::Itertools;

use super::slurm::{JobId, Queue};
use super::{GRACE, UNSEEN_GRACE};
use fathom_base::folder;
use fathom_base::input;
use fathom_base::tell;
use fathom_base::text;
use fathom_record as record;
use fathom_record::output::RECORDS;
use fathom_record::{MAX_LINE, Record};

/// Ending of the name of the file with a task's exit status.
pub const STATUS: &str = "status";
/// Ending of the name of the file with what a task printed.
const LOG: &str = "log";
pub const SHARDS: &str = "shards";
/// Bytes of a file of status: two numbers.
const MOST_STATUS_BYTES: u64 = 40;
/// Bytes of a log whose last line is told.
const MOST_LOG_BYTES: u64 = 4 << 20;
/// Time between two lines that say how far the shards are, where there is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);
/// How a line of a cell begins.
const CELL: &[u8] = br#"{"record":"cell""#;

/// The folder that a shard's task writes to, and the files beside it.
pub struct Folder {
    /// The fleet's. Beneath it no link is followed.
    out: PathBuf,
    /// Its place beneath that.
    name: String,
}

impl Folder {
    pub fn of(out: &Path, number: u32) -> Self {
        Self { out: out.to_owned(), name: format!("{SHARDS}/{number}") }
    }

    pub fn path(&self) -> PathBuf {
        self.out.join(&self.name)
    }

    /// Where Slurm puts what tasks print; `%a` is the number of the task, `%%` a `%` (`sbatch(1)`, "filename pattern").
    pub fn logs(out: &str) -> String {
        format!("{}/{SHARDS}/%a.{LOG}", out.replace('%', "%%"))
    }

    /// Makes the folder of all shards' folders. That of a shard is no link.
    pub fn prepare(out: &Path, shards: u32) -> io::Result<()> {
        let parent = folder::Folder::open(out)?.make_beneath(SHARDS)?;
        (1..=shards).try_for_each(|number| match parent.beneath(number.to_string()) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        })
    }

    /// The place beneath the fleet's folder of a file beside this one.
    fn beside(&self, ending: &str) -> String {
        format!("{}.{ending}", self.name)
    }

    /// The text of such a file.
    fn text_beside(&self, ending: &str, limit: u64) -> Option<String> {
        let bytes = folder::Folder::open(&self.out).ok()?.bytes(self.beside(ending), limit).ok()?;
        Some(String::from_utf8_lossy(&bytes).into_owned())
    }

    fn records(&self) -> io::Result<File> {
        folder::Folder::open(&self.out)?.read(format!("{}/{RECORDS}", self.name))
    }

    /// The exit status that its task wrote last. Of a job that is known, only that job's counts: an earlier one's may still be
    /// there when the next begins.
    fn status(&self, job: Option<JobId>) -> Option<i32> {
        let text = self.text_beside(STATUS, MOST_STATUS_BYTES)?;
        let (status, of) = text.trim().split_once(' ')?;
        let of = JobId(of.parse().ok()?);
        job.is_none_or(|job| job == of).then_some(status)?.parse().ok()
    }

    /// The last line that its task printed.
    fn last_line(&self) -> Option<String> {
        let text = self.text_beside(LOG, MOST_LOG_BYTES)?;
        let line = text.lines().rev().find(|line| !line.trim().is_empty());
        line.map(|line| text::line(line.trim()))
    }

    /// What its records say first; none while they cannot be merged.
    pub fn header(&self) -> Option<record::Shard> {
        let mut lines = input::Lines::new(BufReader::new(self.records().ok()?), MAX_LINE);
        lines.advance().ok()??;
        match serde_json::from_slice(&lines.line).ok()? {
            Record::Run(run) => run.shard,
            _ => None,
        }
    }
}

/// How a task ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All its cells are measured or skipped.
    Done,
    /// Some cell failed.
    CellsFailed,
    /// Fathom could not run, or was interrupted: its exit status.
    Stopped(i32),
    /// Nothing is known: the task was killed, or its node.
    Lost,
}

impl Ending {
    fn of(status: Option<i32>) -> Self {
        match status {
            Some(0) => Self::Done,
            Some(1) => Self::CellsFailed,
            Some(other) => Self::Stopped(other),
            None => Self::Lost,
        }
    }
}

/// Where a shard is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// It has no task yet.
    New,
    Waits,
    Runs {
        node: String,
    },
    /// It is no longer in the queue, since then, and its folder does not say why.
    Gone(Instant),
    Over(Ending),
}

pub struct Shard {
    pub number: u32,
    pub folder: Folder,
    pub state: State,
    /// Its latest, if it was submitted or seen here.
    job: Option<JobId>,
    /// The queue has shown that job.
    is_seen: bool,
    /// How often it was submitted.
    attempts: u32,
    /// Cells of its file of records up to a place in it.
    counted: (usize, u64),
    /// Of its header.
    cells: Option<usize>,
}

impl Shard {
    pub fn new(folder: Folder, number: u32) -> Self {
        let state = match folder.status(None) {
            None => State::New,
            status => State::Over(Ending::of(status)),
        };
        let (job, is_seen, attempts, counted, cells) = (None, false, 0, (0, 0), None);
        Self { number, folder, state, job, is_seen, attempts, counted, cells }
    }

    /// Takes over what the queue and the folder say; a line to tell where that is news.
    pub fn look(&mut self, queue: &Queue) -> Option<String> {
        let number = self.number;
        if let Some(task) = queue.get(&number) {
            (self.job, self.is_seen) = (Some(task.job), true);
            let state = task.node.clone().map_or(State::Waits, |node| State::Runs { node });
            let is_news = state != self.state;
            self.state = state;
            let node = task.node.as_ref().filter(|_| is_news);
            return node.map(|node| format!("shard {number} runs on {node}"));
        }
        let since = match self.state {
            State::New | State::Over(_) => return None,
            State::Waits | State::Runs { .. } => Instant::now(),
            State::Gone(since) => since,
        };
        let ending = self.ending();
        let grace = if self.is_seen { GRACE } else { UNSEEN_GRACE };
        if ending == Ending::Lost && since.elapsed() < grace {
            self.state = State::Gone(since);
            return None;
        }
        self.state = State::Over(ending);
        Some(format!("shard {number} {}", self.told(ending)))
    }

    fn ending(&self) -> Ending {
        Ending::of(self.folder.status(self.job))
    }

    fn told(&self, ending: Ending) -> String {
        let last = || self.folder.last_line().map_or_else(String::new, |line| format!(": {line}"));
        match ending {
            Ending::Done => "is done".to_owned(),
            Ending::CellsFailed => "is done, but for cells that failed".to_owned(),
            Ending::Stopped(status) => format!("ended with status {status}{}", last()),
            Ending::Lost => "was killed before it ended".to_owned(),
        }
    }

    /// It needs a task.
    pub fn is_due(&self, retries: u32) -> bool {
        match self.state {
            State::New => true,
            State::Over(ending) => ending != Ending::Done && self.attempts <= retries,
            State::Waits | State::Runs { .. } | State::Gone(_) => false,
        }
    }

    /// Nothing more comes of it.
    pub fn is_over(&self, retries: u32) -> bool {
        matches!(self.state, State::Over(_)) && !self.is_due(retries)
    }

    pub fn submitted(&mut self, job: JobId) {
        self.attempts += 1;
        (self.job, self.is_seen) = (Some(job), false);
        self.state = State::Waits;
    }

    /// What the folder says, where the queue was not asked to the end.
    pub fn read_ending(&mut self) {
        if !matches!(self.state, State::Over(_)) {
            self.state = State::Over(self.ending());
        }
    }

    /// Why cells of it may be missing.
    pub fn failure(&self) -> Option<String> {
        match self.state {
            State::Over(Ending::Done | Ending::CellsFailed) => None,
            State::Over(ending) => Some(format!("shard {} {}", self.number, self.told(ending))),
            _ => Some(format!("shard {} did not end", self.number)),
        }
    }

    /// Cells that have a record, and all of them where that is known.
    fn count(&mut self) -> (usize, Option<usize>) {
        if self.cells.is_none() {
            self.cells = self.folder.header().map(|shard| shard.cells);
        }
        // What cannot be read now is counted at the next look.
        let _ = self.count_on();
        (self.counted.0, self.cells)
    }

    /// Reads the whole lines that were added to the records.
    fn count_on(&mut self) -> std::io::Result<()> {
        let mut file = self.folder.records()?;
        if file.metadata()?.len() < self.counted.1 {
            self.counted = (0, 0);
        }
        file.seek(SeekFrom::Start(self.counted.1))?;
        let mut added = Vec::new();
        file.read_to_end(&mut added)?;
        let whole = added.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        let lines = added[..whole].split(|byte| *byte == b'\n');
        self.counted.0 += lines.filter(|line| line.starts_with(CELL)).count();
        self.counted.1 += whole as u64;
        Ok(())
    }
}

/// How far all shards are, in one line.
pub struct Progress {
    /// Hidden where there is no terminal.
    pub bar: ProgressBar,
    last: (Instant, String),
}

impl Default for Progress {
    fn default() -> Self {
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} cells  {msg}");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        let last = (Instant::now(), String::new());
        Self { bar: ProgressBar::new(0).with_style(style), last }
    }
}

impl Progress {
    pub fn say(&self, message: &str) {
        if self.bar.is_hidden() {
            tell::note(message);
        } else {
            self.bar.println(message);
        }
    }

    pub fn show(&mut self, shards: &mut [Shard]) {
        let counts: Vec<_> = shards.iter_mut().map(Shard::count).collect();
        let done: usize = counts.iter().map(|(done, _)| done).sum();
        let known: usize = counts.iter().filter_map(|(_, cells)| *cells).sum();
        let unknown = counts.iter().filter(|(_, cells)| cells.is_none()).count();
        let message = states(shards);
        if !self.bar.is_hidden() {
            self.bar.set_length(known as u64);
            self.bar.set_position(done as u64);
            self.bar.set_message(message);
            return;
        }
        let of = if unknown > 0 { format!("at least {known}") } else { known.to_string() };
        let line = format!("{done} of {of} cells; {message}");
        if line != self.last.1 && self.last.0.elapsed() >= LINE_INTERVAL {
            tell::note(&line);
            self.last = (Instant::now(), line);
        }
    }
}

/// How many shards wait, run and are over, and where those run.
fn states(shards: &[Shard]) -> String {
    let count = |is: fn(&State) -> bool| shards.iter().filter(|shard| is(&shard.state)).count();
    let waits = count(|state| matches!(state, State::New | State::Waits));
    let over = count(|state| matches!(state, State::Over(_)));
    let mut running = shards.iter().filter_map(|shard| {
        let State::Runs { node } = &shard.state else { return None };
        let cells = shard.cells.map_or_else(|| "?".to_owned(), |cells| cells.to_string());
        Some(format!("{node}: shard {}, {}/{cells}", shard.number, shard.counted.0))
    });
    let states = format!("{waits} shards wait, {over} are over");
    let running = running.join(", ");
    [states, running].iter().filter(|told| !told.is_empty()).join("; ")
}

#[cfg(test)]
mod tests;
