//! A comparison's folder: one line of JSON for each thing that was measured, and nothing that was concluded.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer, Serialize, de};
use thiserror::Error;

use super::cells::CellId;
use super::nan;
use super::rounds::{LAUNCHES, PAIRS};
use crate::harness::output::holder;
use crate::record::{self, Adapter, FolderLock, LineWriter, Lines, LockError, RecordError, Work};

/// Version of the lines; raised when a field changes its meaning or goes away.
pub const SCHEMA: u32 = 1;
/// Name of the lines' file in a comparison's folder.
pub const COMPARISON: &str = "comparison.jsonl";

/// Most launches of a measurement: the time to judge them grows with their square, and is seconds for so many.
pub const MOST_LAUNCHES: u32 = 200;
/// Most pairs of a cell in a launch of the first measurement; the second takes up to four times as many.
pub const MOST_PAIRS: u32 = 1000;

/// Family-wise error of the time gate.
const ALPHA: f64 = 0.05;
/// Practical threshold of the time gate.
pub const THRESHOLD: f64 = 0.02;
/// Counts repeat to 0.1 %; half a per cent is plain.
pub const INSTRUCTION_THRESHOLD: f64 = 0.005;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    Base,
    Head,
}

impl Side {
    pub const BOTH: [Self; 2] = [Self::Base, Self::Head];

    pub fn name(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Head => "head",
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Gate {
    Exact,
    Instructions,
    Time,
}

impl Gate {
    pub const ALL: [Self; 3] = [Self::Exact, Self::Instructions, Self::Time];

    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Instructions => "instructions",
            Self::Time => "time",
        }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Line {
    Header(Box<Header>),
    Configuration(ConfigurationFigures),
    Exact(ExactFigures),
    Check(CheckFigure),
    Instructions(InstructionCounts),
    Pair(Pair),
    Launch(Launch),
    Samples(Samples),
    Fault(Fault),
    End(End),
}

impl record::Line for Line {
    const SCHEMA: u32 = SCHEMA;
    const NAME: &'static str = "comparison line";
}

/// What is compared, on what, and by which rules.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    pub schema: u32,
    pub fathom_version: String,
    pub base: Build,
    pub head: Build,
    pub adapter: Adapter,
    pub settings: Settings,
    /// In the order of `benches/gates.toml`.
    pub cells: Vec<CellId>,
    /// Gates that were asked for and cannot be run here.
    pub skipped: Vec<Skip>,
    /// On the comparison as a whole.
    pub notes: Vec<String>,
}

/// Of two builds of which nothing is known, by the default settings.
impl Default for Header {
    fn default() -> Self {
        Self {
            schema: SCHEMA,
            fathom_version: env!("CARGO_PKG_VERSION").to_owned(),
            base: Build::default(),
            head: Build::default(),
            adapter: Adapter::default(),
            settings: Settings::default(),
            cells: Vec::new(),
            skipped: Vec::new(),
            notes: Vec::new(),
        }
    }
}

/// A gate that is left out, which is no failure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Skip {
    pub gate: Gate,
    pub reason: String,
}

/// One side.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Build {
    /// Revision, path or file, as it was asked for.
    pub label: String,
    pub version: String,
    /// Of the worker's line protocol; none for a file of records.
    pub protocol: Option<u32>,
    /// SHA-256 of the program or file.
    pub digest: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Family-wise error of the time gate; the intervals of each of its measurements have the coverage 1 − alpha.
    #[serde(deserialize_with = "share")]
    pub alpha: f64,
    /// Share by which a time must differ to matter.
    #[serde(deserialize_with = "share")]
    pub threshold: f64,
    /// Share by which an instruction count must differ to matter.
    #[serde(deserialize_with = "share")]
    pub instruction_threshold: f64,
    /// Pairs of worker processes, in each of the two measurements of the time gate.
    pub launches: u32,
    /// Pairs of samples of a cell in each launch of the first measurement.
    pub pairs: u32,
    pub seed: u64,
    pub gates: Vec<Gate>,
    /// Sides were measured one after the other, in no pairs: from files of records.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unpaired: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            alpha: ALPHA,
            threshold: THRESHOLD,
            instruction_threshold: INSTRUCTION_THRESHOLD,
            launches: LAUNCHES,
            pairs: PAIRS,
            seed: 0,
            gates: Gate::ALL.to_vec(),
            unpaired: false,
        }
    }
}

/// A number between 0 and 1: no verdict follows from another.
fn share<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let share = f64::deserialize(deserializer)?;
    if 0.0 < share && share < 1.0 {
        return Ok(share);
    }
    Err(de::Error::custom(format!("{share} is no share between 0 and 1")))
}

/// Exact figures of a whole configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ConfigurationFigures {
    pub side: Side,
    pub configuration: String,
    pub allocated_bytes: u64,
    /// Errors against the reference, the larger the worse. Whose output one judges, its name tells
    /// ([`judged_stages`](crate::harness::errors::judged_stages)).
    #[serde(with = "nan::map")]
    pub errors: BTreeMap<String, f64>,
    /// Figures read back that are no errors: a change of one is told and not judged.
    #[serde(default, with = "nan::map")]
    pub quantities: BTreeMap<String, f64>,
    /// What could not be computed, and why.
    #[serde(default)]
    pub notes: Vec<String>,
}

/// Exact figures of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExactFigures {
    pub side: Side,
    pub cell: CellId,
    pub work: Work,
    /// Pipeline statistics, where the adapter counts them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub counters: BTreeMap<String, u64>,
}

/// A stage's error on a small case, as `fathom verify` measures it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckFigure {
    pub side: Side,
    pub stage: String,
    pub what: String,
    pub unit: String,
    #[serde(with = "nan::number")]
    pub measured: f64,
    pub tolerance: f64,
    /// It passed and its control failed.
    pub sound: bool,
}

/// Instructions of a cell's steady frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InstructionCounts {
    pub side: Side,
    pub cell: CellId,
    pub counts: Vec<u64>,
}

/// Two samples of a cell, one right after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    pub launch: u32,
    pub round: u32,
    pub cell: CellId,
    /// Both sides are the base.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub control: bool,
    /// Of the second measurement, of the cells that the first left open.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub second: bool,
    /// The side that was sampled first.
    pub first: Side,
    pub base_ns: f64,
    pub head_ns: f64,
}

/// A pair of workers that went through all its rounds. Pairs of a launch without this line do not count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Launch {
    pub launch: u32,
    pub wall_s: f64,
    /// Of the second measurement.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub second: bool,
    /// How the workers were quieted: core, threads, padding of the environment, and what could not be done.
    pub notes: Vec<String>,
}

/// Something that could not be measured. Without a cell it concerns the whole gate, without a side both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    pub gate: Gate,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<CellId>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub launch: Option<u32>,
    /// It befell the control that bears this cell's name, and not the cell.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub control: bool,
    /// The side has no such cell: there is nothing to compare, and nothing failed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub absent: bool,
    pub reason: String,
}

/// Times of a cell that were taken without a partner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Samples {
    pub side: Side,
    pub cell: CellId,
    pub ns: Vec<f64>,
    /// A shorter median cannot be told from none.
    #[serde(default)]
    pub resolution_ns: f64,
}

/// How measuring ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct End {
    pub wall_s: f64,
    pub interrupted: bool,
}

#[derive(Debug, Error)]
pub enum StoreError {
    #[error(transparent)]
    Lines(#[from] RecordError),
    #[error(transparent)]
    Lock(#[from] LockError),
    #[error("cannot write to {}: {source}; choose another folder with --out", path.display())]
    Unwritable { path: PathBuf, source: std::io::Error },
    #[error(
        "{} holds a comparison already: continue it with --resume, or choose another folder with --out",
        path.display()
    )]
    Occupied { path: PathBuf },
    #[error("no comparison in {}: name its folder with --out", path.display())]
    Absent { path: PathBuf },
    #[error("{} has no sound header line, so its other lines mean nothing", path.display())]
    NoHeader { path: PathBuf },
}

/// A comparison's folder that no other process writes to while this is held.
#[derive(Debug)]
pub struct Held {
    folder: PathBuf,
    lock: FolderLock,
}

impl Held {
    /// Takes a folder that holds no comparison.
    pub fn free(folder: &Path) -> Result<Self, StoreError> {
        let held = Self::take(folder)?;
        let lines = folder.join(COMPARISON);
        if lines.metadata().is_ok_and(|file| file.len() > 0) {
            return Err(StoreError::Occupied { path: folder.to_owned() });
        }
        Ok(held)
    }

    /// Takes the folder of a comparison that is to be continued.
    pub fn with_comparison(folder: &Path) -> Result<Self, StoreError> {
        if !folder.join(COMPARISON).exists() {
            return Err(StoreError::Absent { path: folder.to_owned() });
        }
        Self::take(folder)
    }

    fn take(folder: &Path) -> Result<Self, StoreError> {
        Ok(Self { folder: folder.to_owned(), lock: FolderLock::take(folder, &holder())? })
    }
}

/// The folder of a comparison under way.
#[derive(Debug)]
pub struct Store {
    pub folder: PathBuf,
    writer: LineWriter<Line>,
    /// Held for its release.
    _lock: FolderLock,
}

impl Store {
    /// Starts a comparison in a folder that holds none.
    pub fn create(folder: &Path) -> Result<Self, StoreError> {
        Self::begin(Held::free(folder)?)
    }

    /// Starts a comparison.
    pub fn begin(held: Held) -> Result<Self, StoreError> {
        let path = held.folder.join(COMPARISON);
        let opened = LineWriter::open(&path, |_| Ok::<(), RecordError>(()))?;
        Ok(Self::of(held, opened.writer))
    }

    /// Continues the comparison of a folder, and gives what there is to say of its damage, which is kept aside.
    pub fn resume(held: Held) -> Result<(Self, Comparison, Vec<String>), StoreError> {
        let path = held.folder.join(COMPARISON);
        let has_header = |read: &Lines<Line>| {
            let mut lines = read.lines.iter();
            match lines.any(|line| matches!(line, Line::Header(_))) {
                true => Ok(()),
                false => Err(StoreError::NoHeader { path: path.clone() }),
            }
        };
        let opened = LineWriter::open(&path, has_header)?;
        let notices = opened.notices();
        let before = Comparison::read(&held.folder)?;
        Ok((Self::of(held, opened.writer), before, notices))
    }

    fn of(held: Held, writer: LineWriter<Line>) -> Self {
        Self { folder: held.folder, writer, _lock: held.lock }
    }

    /// Appends lines in one piece. Nothing else than this writes, so that measuring is not disturbed.
    pub fn write(&mut self, lines: &[Line]) -> Result<(), StoreError> {
        Ok(self.writer.write_all(lines)?)
    }
}

/// Everything that was measured, as verdicts take it.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    pub header: Header,
    pub configurations: Vec<ConfigurationFigures>,
    pub exact: Vec<ExactFigures>,
    pub checks: Vec<CheckFigure>,
    pub instructions: Vec<InstructionCounts>,
    /// Of complete launches.
    pub pairs: Vec<Pair>,
    pub launches: Vec<Launch>,
    /// The highest number of a launch that anything was stored of, complete or not.
    pub last_launch: Option<u32>,
    pub samples: Vec<Samples>,
    pub faults: Vec<Fault>,
    /// So many of the faults, the first, stood when measuring was last interrupted: the interruption may have caused
    /// them, so what they took is tried again.
    pub faults_before_interruption: usize,
    /// The last end, if measuring came to one, with the wall time of all.
    pub end: Option<End>,
    /// Lines that could not be read, as they are told.
    pub damaged: Vec<String>,
}

impl Comparison {
    /// Nothing measured yet.
    pub fn new(header: Header) -> Self {
        Self {
            header,
            configurations: Vec::new(),
            exact: Vec::new(),
            checks: Vec::new(),
            instructions: Vec::new(),
            pairs: Vec::new(),
            launches: Vec::new(),
            last_launch: None,
            samples: Vec::new(),
            faults: Vec::new(),
            faults_before_interruption: 0,
            end: None,
            damaged: Vec::new(),
        }
    }

    pub fn read(folder: &Path) -> Result<Self, StoreError> {
        let path = folder.join(COMPARISON);
        if !path.exists() {
            return Err(StoreError::Absent { path: folder.to_owned() });
        }
        let read = record::read_lines(&path)?;
        let mut comparison =
            Self::from_lines(read).ok_or(StoreError::NoHeader { path: path.clone() })?;
        let told = |aside: PathBuf| {
            let name = aside.file_name().unwrap_or_default().to_string_lossy();
            format!("lines that could not be read were left out; they are in {name}")
        };
        let aside = record::kept_aside(&path).into_iter();
        comparison.damaged.extend(aside.map(told));
        Ok(comparison)
    }

    /// Sorts lines by their kind; none without a header. Of several headers the first holds.
    pub fn from_lines(read: Lines<Line>) -> Option<Self> {
        let header = read.lines.iter().find_map(|line| match line {
            Line::Header(header) => Some((**header).clone()),
            _ => None,
        })?;
        let mut all = Self::new(header);
        all.damaged = read.damaged.iter().map(ToString::to_string).collect();
        for line in read.lines {
            match line {
                Line::Header(_) => {}
                Line::Configuration(line) => all.configurations.push(line),
                Line::Exact(line) => all.exact.push(line),
                Line::Check(line) => all.checks.push(line),
                Line::Instructions(line) => all.instructions.push(line),
                Line::Pair(line) => all.pairs.push(line),
                Line::Launch(line) => all.launches.push(line),
                Line::Samples(line) => all.samples.push(line),
                Line::Fault(line) => all.faults.push(line),
                Line::End(line) => all.ended(line),
            }
        }
        all.leave_out_launches();
        all.count_whole_launches();
        Some(all)
    }

    /// Both sides' exact figures of a cell and of its configuration are there.
    pub fn has_exact(&self, cell: &CellId) -> bool {
        Side::BOTH.into_iter().all(|side| {
            let (mut exact, mut whole) = (self.exact.iter(), self.configurations.iter());
            exact.any(|line| line.side == side && line.cell == *cell)
                && whole.any(|line| line.side == side && line.configuration == cell.configuration())
        })
    }

    /// Launches of the first or the second measurement of the time gate.
    pub fn launches_of(&self, second: bool) -> usize {
        let launches = self.launches.iter();
        launches.filter(|launch| launch.second == second).count()
    }

    /// Measuring ended by itself.
    pub fn came_to_its_end(&self) -> bool {
        self.end.as_ref().is_some_and(|end| !end.interrupted)
    }

    fn ended(&mut self, mut end: End) {
        if end.interrupted {
            self.faults_before_interruption = self.faults.len();
        }
        end.wall_s += self.end.as_ref().map_or(0.0, |before| before.wall_s);
        self.end = Some(end);
    }

    /// Leaves out launches beyond those that a comparison may have, and says so.
    fn leave_out_launches(&mut self) {
        let all = self.launches.len();
        let mut counts = [0; 2];
        self.launches.retain(|launch| {
            let count = &mut counts[usize::from(launch.second)];
            *count += 1;
            *count <= MOST_LAUNCHES as usize
        });
        let left_out = all - self.launches.len();
        if left_out > 0 {
            self.damaged.push(format!(
                "{left_out} launches beyond the first {MOST_LAUNCHES} of a measurement were left out"
            ));
        }
    }

    /// Leaves out the pairs of launches that were cut short, whose numbers are nevertheless taken.
    fn count_whole_launches(&mut self) {
        let whole: Vec<u32> = self.launches.iter().map(|launch| launch.launch).collect();
        let paired = self.pairs.iter().map(|pair| pair.launch);
        let failed = self.faults.iter().filter_map(|fault| fault.launch);
        self.last_launch = paired.chain(failed).chain(whole.iter().copied()).max();
        self.pairs.retain(|pair| whole.contains(&pair.launch));
    }
}
