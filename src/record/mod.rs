//! Records: one line of JSON each. Measuring writes records and never formats; reports read records and never measure.
//!
//! A file holds one [`Run`] line, a [`Definition`] line per experiment, then [`Cell`] lines in the order in
//! which they were written, then one [`End`] line. [`Begun`] lines lie between them. A resumed file may hold several runs, and several
//! versions of a cell, of which the latest counts. Units stand in the field names.

use std::collections::BTreeMap;
use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use strum::Display;

use fathom_base::text;

pub mod calendar;
pub mod ceilings;
mod clock_plan;
pub mod command;
pub mod comparison;
mod error_figure;
mod file;
mod kinds;
mod lines;
mod lock;
pub mod machine;
mod mask;
pub mod nan;
pub mod output;
mod params;
pub mod protocol;
pub mod schema;
mod shard;
mod stage;
#[cfg(test)]
mod tests;
pub use ceilings::{Ceiling, CeilingShare, Limit};
pub use clock_plan::{ClockPlan, SubmitCost};
pub use comparison::Compared;
pub use error_figure::ErrorFigure;
pub use fathom_base::machine::Machine;
pub use fathom_base::quiet::Conditions;
pub use fathom_base::statistics::{Estimate, Interval};
pub use file::{Earlier, OutcomeCounts, crashed_cells, earlier, empty_or_sound, read_good};
pub use kinds::{
    ErrorSpan, FaultKind, Note, NoteKind, Picture, PictureKind, PictureScale, Profile,
    RejectedFrames, Rejection, RunProgress, SetUp, ShaderChecks, Surrounding,
};
pub use lines::{Damaged, RecordError, RecordFile, Writer, read, stored};
pub use lock::{FolderLock, LOCK, LockError};
pub use machine::{MachineState, ThrottleReason, Throttling};
pub use mask::{Feature, Mask};
pub use params::Params;
pub use shard::{MAX_SHARDS, Part};
pub use stage::{Fenced, StageRecord, Work};

/// The clock that each kind of pass is timed by.
pub type Clocks = BTreeMap<PassKind, Clock>;

/// Version of the record format; raised when a field changes its meaning or goes away.
pub const SCHEMA: u32 = 3;
/// Ids of experiments as a regular expression; see [`text::check_id`].
const ID: &str = "^[a-z0-9-]+$";

/// A line of `records.jsonl`. Times are nanoseconds where a name ends in `_ns`, seconds where it ends in `_s`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema, strum::EnumTryAs)]
#[serde(tag = "record", rename_all = "snake_case")]
pub enum Record {
    Run(Box<Run>),
    Experiment(Definition),
    Cell(Box<Cell>),
    Begun(Begun),
    End(End),
    /// Of a comparison of two builds, which has a file of its own.
    Comparison(Compared),
}

/// What a run was: the build, the adapter, the clock's audit, the conditions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Run {
    /// Version of the record format.
    #[schemars(extend("const" = SCHEMA))]
    pub schema: u32,
    /// Of the program that measured.
    pub fathom_version: String,
    /// What that program was built of; absent where it does not know.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub build: Option<Build>,
    /// RFC 3339, UTC.
    pub started_at: String,
    pub profile: Profile,
    /// In records of before, what was asked of each cell: half the width of the frame time's 95 % interval over its median.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub precision: Option<f64>,
    /// Arguments of the program, its name first.
    pub command: Vec<String>,
    /// Experiments that it was asked for, those that are not built in by their files in the run's folder; empty where it was all built-in
    /// ones. Absent from records of programs of one's own and of the committed runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub experiments: Option<Vec<String>>,
    pub adapter: Adapter,
    pub shader_checks: ShaderChecks,
    /// Of the process that measured.
    pub conditions: Conditions,
    /// The clock that timed each kind of pass.
    #[schemars(schema_with = "schema::map::<PassKind, Clock>")]
    pub clocks: Clocks,
    /// How each clock did against the host clock.
    pub audit: Vec<AuditRow>,
    /// Host time of a submission with the least pass of a kind, nanoseconds, as the audit measured it. What was taken off
    /// fenced host durations was measured beside them and is in `fenced` of each stage.
    #[schemars(schema_with = "schema::map::<PassKind, f64>")]
    pub submit_cost_ns: BTreeMap<PassKind, f64>,
    /// Turns of loops that an invocation makes on this adapter. Absent where that was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loop_turns: Option<LoopTurns>,
    /// The adapter's limits, measured after the audit. Absent where they were not measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ceilings: Vec<Ceiling>,
    /// The part of a run that this is; absent where it is the whole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shard: Option<Part>,
    /// On the whole run.
    pub notes: Vec<Note>,
}

/// The revision that a program was built of. What a development build reads from its checkout when it runs may be newer: shaders,
/// scenes, experiments.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
pub struct Build {
    /// Hash of the commit; null where the program was built outside a repository.
    pub commit: Option<String>,
    /// Its files differed from the commit.
    pub dirty: bool,
    /// Digest of the program's file and of the shaders that it read; absent where it does not know.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub program: Option<String>,
    /// How it was built: `profile`, `opt-level`, `target`, `flags` and `compiler`; absent where it does not know.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub with: BTreeMap<String, String>,
}

impl Build {
    /// As `git describe --always --dirty=-dirty --abbrev=40 --exclude='*'` names a checkout; of nothing where that is empty.
    pub fn described(revision: &str) -> Self {
        let commit = revision.strip_suffix("-dirty");
        let dirty = commit.is_some();
        let commit = Some(commit.unwrap_or(revision)).filter(|commit| !commit.is_empty());
        Self { commit: commit.map(str::to_owned), dirty, program: None, with: BTreeMap::new() }
    }

    /// What differs between how two were built, of what both say: `profile debug → release`.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let pairs =
            self.with.iter().filter_map(|(name, own)| Some((name, own, other.with.get(name)?)));
        let different = pairs.filter(|(_, own, other)| own != other);
        let or_none =
            |text: &str| if text.is_empty() { "none".to_owned() } else { text.to_owned() };
        different
            .map(|(name, own, other)| format!("{name} {} → {}", or_none(own), or_none(other)))
            .collect()
    }
}

impl fmt::Display for Build {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let commit = self.commit.as_deref().unwrap_or("an unknown commit");
        write!(f, "{commit}{}", if self.dirty { " with changed files" } else { "" })
    }
}

/// The text of an experiment's file as it was when its cells were measured, so that its published
/// figures, claims and plots can be recomputed from the records alone. Written before its first cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Definition {
    /// Lower-case letters, digits and `-`.
    #[schemars(regex(pattern = ID), length(max = text::ID_LENGTH))]
    pub id: String,
    /// Text of the file, TOML.
    pub toml: String,
}

/// The device that was measured, and its driver.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Adapter {
    /// As the driver tells it.
    pub name: String,
    /// Interface to the driver: `vulkan`, `metal`, `dx12`, `gl`.
    pub backend: String,
    /// Kind of device, as wgpu names it.
    pub device_type: String,
    /// The driver's name.
    pub driver: String,
    /// The driver's version, as it tells it.
    pub driver_info: String,
    /// PCI id of the vendor; of a driver without one its own.
    pub vendor_id: u32,
    /// PCI id of the device; 0 where there is none.
    pub device_id: u32,
    /// The device is a CPU running a software driver.
    pub software: bool,
    /// Length of a tick of timestamps, nanoseconds.
    pub timestamp_period_ns: f32,
    /// Threads that the host runs at once.
    pub host_threads: usize,
    /// What was taken away from it.
    #[serde(default, skip_serializing_if = "Mask::is_none")]
    pub mask: Mask,
}

impl Adapter {
    /// Its name, with what was taken away from it: figures of a masked adapter are not those of the adapter.
    pub fn title(&self) -> String {
        let Self { name, mask, .. } = self;
        if mask.is_none() { name.clone() } else { format!("{name}, masked: {mask}") }
    }
}

#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Display, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum PassKind {
    /// Dispatches.
    Compute,
    /// Draws.
    Render,
    /// Copies between buffers and textures.
    Copy,
    /// Work of the CPU, such as frame preparation.
    Host,
}

impl PassKind {
    /// Those that an audit chooses a clock for.
    pub const TIMED: [Self; 3] = [Self::Compute, Self::Render, Self::Copy];
}

/// The clock that timed a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Timestamp queries at the pass's begin and end.
    Timestamp,
    /// The pass alone in a submission, between host clock readings around submit and fence, less the cost of a submission.
    FencedHost,
    /// The same by the CPU time of the process, where a software driver does the GPU's work in it.
    ProcessCpu,
    /// Host clock around CPU work.
    Host,
}

impl Clock {
    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Timestamp => "timestamp",
            Self::FencedHost => "fenced host",
            Self::ProcessCpu => "process CPU",
            Self::Host => "host",
        }
    }
}

/// How many turns an invocation made of loops of `tried` turns: fewer where the driver ends long loops early. A record of a stage whose
/// invocations make more turns than that is wrong; stages make at most 65,000.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct LoopTurns {
    /// Of each loop, and of both nested ones together.
    pub tried: u32,
    /// Of one loop.
    pub single: u32,
    /// Of the inner of two loops, over all turns of the outer one.
    pub nested: u32,
}

/// One row of the clock's audit: one clock for one kind of pass in one surrounding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AuditRow {
    /// The audited clock.
    pub clock: Clock,
    /// Kind of the audited pass.
    pub pass: PassKind,
    pub context: Surrounding,
    /// Median by the audited clock for the kernel at N work, nanoseconds.
    pub clock_ns: f64,
    /// The same by the fenced host clock, nanoseconds.
    pub host_ns: f64,
    /// `clock_ns / host_ns`.
    pub ratio: f64,
    /// The clock's duration at 2 N work over that at N.
    pub doubling: f64,
    /// The clock can be used for this kind of pass in this surrounding.
    pub sound: bool,
    /// Why it is sound or not, in one sentence.
    pub reason: String,
}

/// One measured, skipped or failed point of an experiment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Cell {
    /// The experiment's id: lower-case letters, digits and `-`.
    #[schemars(regex(pattern = ID), length(max = text::ID_LENGTH))]
    pub experiment: String,
    /// The axis values as `name=value,name=value`: the cell's identity within its experiment.
    pub cell: String,
    /// Axis → its value in this cell.
    pub axes: Map<String, Value>,
    /// Kind of pipeline.
    pub pipeline: String,
    /// Name of the scene or path of its file.
    pub scene: String,
    /// Assets that were absent, each with the stand-in used.
    pub stand_ins: Vec<String>,
    /// What the scene was made of: the name of each mesh and volume that was read, and `scene_file` for what its file and the bases of that
    /// say → first 16 digits of the SHA-256, hexadecimal, of the unpacked content. Absent where there is no scene, and from the committed runs.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sources: BTreeMap<String, String>,
    /// Every parameter of the pipeline, resolved.
    pub params: Params,
    pub outcome: Outcome,
}

impl Cell {
    /// Its figures, where it was measured.
    pub fn measured(&self) -> Option<&Measured> {
        if let Outcome::Measured(measured) = &self.outcome { Some(measured) } else { None }
    }

    pub fn measured_mut(&mut self) -> Option<&mut Measured> {
        if let Outcome::Measured(measured) = &mut self.outcome { Some(measured) } else { None }
    }
}

/// A process is about to build a cell, or to render its first frame. If a run ends with this line, the process ended in that.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Begun {
    /// Digest of the cell and its conditions: build, machine, adapter, profile, shader checks and resume key.
    pub id: String,
    /// The experiment, for readers: the id says all.
    pub experiment: String,
    /// The cell within its experiment, for readers.
    pub cell: String,
}

impl Outcome {
    /// What became of the cell, and why; empty where it was measured.
    pub fn words(&self) -> [&str; 2] {
        match self {
            Outcome::Measured(_) => ["measured", ""],
            Outcome::Skipped { reason } => ["skipped", reason],
            Outcome::Failed { reason } => ["failed", reason],
            Outcome::OverBudget => ["not run", "budget"],
        }
    }
}

/// What became of a cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum Outcome {
    /// Measured, at least in part.
    Measured(Box<Measured>),
    /// Not measured, because its demands exceed a limit.
    Skipped {
        /// Why, in one sentence.
        reason: String,
    },
    /// Measuring it failed.
    Failed {
        /// Why, in one sentence.
        reason: String,
    },
    /// Not run: the run's time budget ended before its turn came. A resumed run measures it.
    #[default]
    OverBudget,
}

/// What is said of a cell that was not run as the time budget ended.
pub const OVER_BUDGET: &str = "not run: budget";

/// Figures of a measured cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Measured {
    /// In frame order.
    pub stages: Vec<StageRecord>,
    pub frame: FrameRecord,
    /// GPU memory that the pipeline allocated for this cell, bytes.
    pub allocated_bytes: u64,
    /// Rates of missed photons, means and the like: `name → value`, the unit in the name.
    pub quantities: BTreeMap<String, f64>,
    /// Quantities that were measured once for each repetition of the cell with another seed or offset: `name → values`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub repeated: BTreeMap<String, Vec<f64>>,
    /// Errors against references.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<ErrorFigure>,
    /// Frames rendered before the figures were steady.
    pub warm_up_frames: u32,
    /// Timed frames that were not used.
    pub rejected: Vec<RejectedFrames>,
    /// What there is to know about these figures.
    pub notes: Vec<Note>,
    /// Pictures of the cell.
    pub pictures: Vec<Picture>,
    /// What its frames cost the CPU; of one cell of each pipeline of a run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub host: Option<HostCosts>,
}

/// What the thread that encodes and submits takes, by its CPU time (on Linux) or by wall time, nanoseconds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HostCosts {
    /// To encode a stage alone, up to the finished command buffer: in frame order.
    pub stages: Vec<StageEncoding>,
    /// To encode the whole frame into one command buffer.
    pub encode: Estimate,
    /// Until the submission of the whole frame returns. A driver that works in the calling thread does the frame's work in it.
    pub submit: Estimate,
}

/// What the CPU takes to encode a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageEncoding {
    /// The stage's name.
    pub stage: String,
    /// Nanoseconds.
    pub encode: Estimate,
}

impl Measured {
    /// What the stages leave of the untimed frame, nanoseconds: what lies between passes, and what the frame takes to begin and to end.
    pub fn in_no_stage_ns(&self) -> f64 {
        let stages: f64 = self.stages.iter().map(|stage| stage.time.median).sum();
        (self.frame.untimed.median - stages).max(0.0)
    }

    pub fn rejected_frames(&self) -> u32 {
        self.rejected.iter().map(|rejected| rejected.frames).sum()
    }

    /// Its frames were timed.
    pub fn is_timed(&self) -> bool {
        !self.frame.untimed_samples_ns.is_empty()
    }

    /// Quantities and errors by their names.
    pub fn figures(&self) -> BTreeMap<&str, f64> {
        let quantities = self.quantities.iter().map(|(name, value)| (name.as_str(), *value));
        quantities.chain(self.errors.iter().map(|e| (e.name.as_str(), e.value))).collect()
    }
}

/// Whole frames: with per-stage timing (envelope, gaps) and without (wall time of one submission).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameRecord {
    /// The round of sampling that each sample is of, those of the stages too: samples of one round were taken next to each
    /// other. No two groups of cells have a round in common.
    pub rounds: Vec<u32>,
    /// The visit that each sample is of: samples of one visit were taken within 10 s, and intervals are over visits. Empty in records of
    /// before, whose intervals are over samples.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub visits: Vec<u32>,
    /// When each sample was taken, seconds of Unix time.
    pub sampled_at_s: Vec<f64>,
    /// Of the adapter at each sample; empty where no driver tells.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub machine: Vec<MachineState>,
    /// How long two fixed kernels took just before each sample, arithmetic and writes to memory, nanoseconds; empty in records of before.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pacer_ns: Vec<[f64; 2]>,
    /// From the first stage's begin to the last stage's end, nanoseconds, frame by frame.
    pub envelope_samples_ns: Vec<f64>,
    /// Time between stages, nanoseconds, frame by frame.
    pub gap_samples_ns: Vec<f64>,
    /// Median of |stages + gaps − envelope| / envelope, a share.
    pub accounting_error: f64,
    /// Frame time without per-stage timing, nanoseconds, in alternation with timed frames.
    pub untimed_samples_ns: Vec<f64>,
    /// Of `untimed_samples_ns` over visits, nanoseconds.
    pub untimed: Estimate,
    /// Timed over untimed frame's wall time, a ratio, measured in alternation: the cost of timing.
    pub timing_cost: Estimate,
}

/// How a run ended.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct End {
    /// Wall time after set-up (device, audit, pipeline and asset preparation), seconds.
    pub measuring_wall_s: f64,
    /// Sum of all measured GPU time, warm-up included, seconds.
    pub measured_gpu_s: f64,
    /// Time of set-up, seconds.
    pub set_up_s: f64,
    /// Its parts, seconds.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(schema_with = "schema::map::<SetUp, f64>")]
    pub set_up_parts_s: BTreeMap<SetUp, f64>,
    /// Most memory that the process had, bytes; null where the system does not tell.
    pub peak_memory_bytes: Option<u64>,
    /// It was interrupted before all cells were measured.
    pub interrupted: bool,
}

impl End {
    /// Share of the run's time in which the adapter worked on frames that were measured, warm-up included.
    pub fn measured_share(&self) -> f64 {
        let all_s = self.measuring_wall_s + self.set_up_s;
        if all_s > 0.0 { self.measured_gpu_s / all_s } else { 0.0 }
    }
}
