//! Records of a comparison: what was measured of two builds, and nothing that was concluded.
//!
//! A comparison's file begins with its [`ComparisonHeader`]. A run's file holds no record of a comparison, nor the other way about.

use std::collections::BTreeMap;
use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, de};
use strum::Display;

use super::protocol::CheckReading;
use super::{Adapter, Build, ErrorFigure, MachineState, Record, Work, nan};
use fathom_base::private;

/// Most launches to ask for: the time to judge them grows with their square, and is seconds for twice as many.
pub const MAX_LAUNCHES: u32 = 200;
/// Most pairs of a cell in a launch.
pub const MAX_PAIRS: u32 = 1000;

/// Launches of a gate by default. The least that an exact test of 44 cells can decide on is 11, if all of them
/// agree; with 20 a few may stray.
pub const LAUNCHES: u32 = 20;
/// Pairs of samples of a cell in each launch by default.
pub const PAIRS: u32 = 16;
/// Family-wise error of the time gate.
const ALPHA: f64 = 0.05;
/// Practical threshold of the time gate.
pub const THRESHOLD: f64 = 0.02;
/// Counts repeat to 0.1 %; half a per cent is plain.
pub const INSTRUCTION_THRESHOLD: f64 = 0.005;

/// One of the two builds that are compared.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Display, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Side {
    Base,
    Head,
}

impl Side {
    pub const BOTH: [Self; 2] = [Self::Base, Self::Head];
}

/// A part of a comparison: of exact figures, of instruction counts, of times.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Display, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Gate {
    Exact,
    Instructions,
    Time,
}

impl Gate {
    pub const ALL: [Self; 3] = [Self::Exact, Self::Instructions, Self::Time];
}

/// A gate cell's name: `CONFIGURATION STAGE`, such as `tank caustics/trace`. The stage holds no space.
#[derive(
    Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct CellId(String);

impl CellId {
    pub fn new(configuration: &str, stage: &str) -> Self {
        Self(format!("{configuration} {stage}"))
    }

    pub fn configuration(&self) -> &str {
        self.parts().0
    }

    pub fn stage(&self) -> &str {
        self.parts().1
    }

    pub fn subject(&self) -> CellSubject<'_> {
        CellSubject::parse(self.stage())
    }

    pub fn as_str(&self) -> &str {
        &self.0
    }

    fn parts(&self) -> (&str, &str) {
        self.0.rsplit_once(' ').unwrap_or((&self.0, ""))
    }
}

/// What a gate cell measures of its configuration, by the second part of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellSubject<'a> {
    /// `STAGE`: the stage alone in a frame.
    Stage(&'a str),
    /// `encode:STAGE`: what the host does to encode the stage alone in a frame, up to the finished command buffer.
    Encode(&'a str),
    /// `create`: what the host does to make the configuration's resources and pipelines again on the same device.
    Create,
}

impl<'a> CellSubject<'a> {
    const ENCODE: &'static str = "encode:";
    const CREATE: &'static str = "create";

    pub fn parse(name: &'a str) -> Self {
        match name.strip_prefix(Self::ENCODE) {
            Some(stage) => Self::Encode(stage),
            None if name == Self::CREATE => Self::Create,
            None => Self::Stage(name),
        }
    }

    pub fn is_stage(self) -> bool {
        matches!(self, Self::Stage(_))
    }

    /// Whether a gate measures it. Exact figures are of stages. What the host does is counted where its instructions can be, and
    /// timed elsewhere: on a software driver its time is short beside that of the driver's threads.
    pub fn is_measured_by(self, gate: Gate, software: bool) -> bool {
        self.is_stage() || gate == Gate::Instructions || (gate == Gate::Time && !software)
    }
}

impl fmt::Display for CellSubject<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stage(stage) => f.write_str(stage),
            Self::Encode(stage) => write!(f, "{}{stage}", Self::ENCODE),
            Self::Create => f.write_str(Self::CREATE),
        }
    }
}

impl fmt::Display for CellId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// What a record of a comparison holds: its kind and the fields of that kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Compared {
    Header(Box<ComparisonHeader>),
    Configuration(ConfigurationFigures),
    Unchanged(UnchangedCells),
    Changed(ChangedStage),
    Exact(ExactFigures),
    Check(CheckFigure),
    Instructions(InstructionCounts),
    Pair(Pair),
    Launch(Launch),
    Fault(Fault),
    End(ComparisonEnd),
}

impl From<Compared> for Record {
    fn from(compared: Compared) -> Self {
        Self::Comparison(compared)
    }
}

/// What is compared, on what, and by which rules.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ComparisonHeader {
    /// Version of the record format.
    #[schemars(extend("const" = super::SCHEMA))]
    pub schema: u32,
    /// Of the program that compared.
    pub fathom_version: String,
    /// The build that is compared with.
    pub base: ComparedBuild,
    /// The build that is judged.
    pub head: ComparedBuild,
    /// Of the head, and of the base unless `base_adapter` is there.
    pub adapter: Adapter,
    /// Of the base, where its environment or driver gives it another one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_adapter: Option<Adapter>,
    pub settings: GateSettings,
    /// In the order of `benches/gates.toml`.
    pub cells: Vec<CellId>,
    /// Those of the base's own list, where it is known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub base_cells: Vec<CellId>,
    /// Gates that were asked for and cannot be run here.
    pub skipped: Vec<Skip>,
    /// On the comparison as a whole.
    pub notes: Vec<String>,
}

/// Of two builds of which nothing is known, by the default settings.
impl Default for ComparisonHeader {
    fn default() -> Self {
        Self {
            schema: super::SCHEMA,
            fathom_version: env!("CARGO_PKG_VERSION").to_owned(),
            base: ComparedBuild::default(),
            head: ComparedBuild::default(),
            adapter: Adapter::default(),
            base_adapter: None,
            settings: GateSettings::default(),
            cells: Vec::new(),
            base_cells: Vec::new(),
            skipped: Vec::new(),
            notes: Vec::new(),
        }
    }
}

impl ComparisonHeader {
    /// What a side ran on.
    pub fn adapter_of(&self, side: Side) -> &Adapter {
        match side {
            Side::Base => self.base_adapter.as_ref().unwrap_or(&self.adapter),
            Side::Head => &self.adapter,
        }
    }
}

/// A gate that is left out, which is no failure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Skip {
    pub gate: Gate,
    /// Why, in one sentence.
    pub reason: String,
}

/// A build of one side.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ComparedBuild {
    /// Revision, path or file, as it was asked for.
    pub label: String,
    /// Of the program.
    pub version: String,
    /// Of the worker's line protocol.
    pub protocol: u32,
    /// What it was built of and how, as it says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub build: Option<Build>,
    /// SHA-256 of the program or file, of a command its text and the files that its worker runs.
    pub digest: String,
    /// What its processes alone were given.
    #[serde(default, skip_serializing_if = "SideEnvironment::is_empty")]
    pub environment: SideEnvironment,
}

/// What the processes of one side are given that those of the other are not.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct SideEnvironment {
    /// Environment variables by name. Their values only where that was asked for.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub variables: BTreeMap<String, Option<String>>,
    /// 16 bits of the SHA-256 of all names and values: enough to tell other values, too few to find a value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values_digest: Option<String>,
}

impl SideEnvironment {
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// Rules by which two builds are compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GateSettings {
    /// Family-wise error of the time gate. Intervals have the coverage 1 − alpha, whichever look decides their cell.
    #[serde(deserialize_with = "share")]
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 1))]
    pub alpha: f64,
    /// Share by which a time must differ to matter.
    #[serde(deserialize_with = "share")]
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 1))]
    pub threshold: f64,
    /// Share by which an instruction count must differ to matter.
    #[serde(deserialize_with = "share")]
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 1))]
    pub instruction_threshold: f64,
    /// Pairs of worker processes of the time gate; as many again for cells that are then undecided.
    pub launches: u32,
    /// Pairs of samples of a cell in each launch.
    pub pairs: u32,
    /// Seed of the order of cells and samples.
    pub seed: u64,
    /// Gates that were asked for.
    pub gates: Vec<Gate>,
    /// They measure also what asks the GPU for the same on both sides.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub all: bool,
}

impl Default for GateSettings {
    fn default() -> Self {
        Self {
            alpha: ALPHA,
            threshold: THRESHOLD,
            instruction_threshold: INSTRUCTION_THRESHOLD,
            launches: LAUNCHES,
            pairs: PAIRS,
            seed: 0,
            gates: Gate::ALL.to_vec(),
            all: false,
        }
    }
}

/// A number between 0 and 1: any other decides nothing.
fn share<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let share = f64::deserialize(deserializer)?;
    if 0.0 < share && share < 1.0 {
        return Ok(share);
    }
    Err(de::Error::custom(format!("{share} is no share between 0 and 1")))
}

/// Exact figures of a whole configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ConfigurationFigures {
    pub side: Side,
    /// Name of the configuration.
    pub configuration: String,
    /// GPU memory that the pipeline allocated, bytes.
    pub allocated_bytes: u64,
    /// Errors against the reference, the larger the worse: name → value, the unit in the name; null where it is no number.
    #[serde(deserialize_with = "nan::map")]
    #[schemars(schema_with = "nan::map_schema")]
    pub errors: BTreeMap<String, f64>,
    /// The same with the stage that each judges.
    pub judged: Vec<ErrorFigure>,
    /// Figures read back that are no errors: a change of one is reported, but not judged. The unit is in the name.
    #[serde(deserialize_with = "nan::map")]
    #[schemars(schema_with = "nan::map_schema")]
    pub quantities: BTreeMap<String, f64>,
    /// What could not be computed, and why.
    pub notes: Vec<String>,
}

/// Cells of a configuration that ask the GPU for the same work on the same inputs on both sides: no gate measures them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct UnchangedCells {
    /// Its id.
    pub configuration: String,
    /// Stages whose fingerprints are equal; of equal programs also what the host does.
    pub cells: Vec<CellId>,
    /// Why the others count as changed, where their digests do not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// A stage that asks the GPU for something else than the base's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ChangedStage {
    pub cell: CellId,
    /// The most that differs.
    pub differs: Differs,
    /// Lines of the shader's sources, or else of commands and descriptors, as a unified diff; the first few.
    pub diff: String,
}

/// In what the sides' stages differ, the most suspicious first.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Display, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Differs {
    /// In a shader as naga reads it.
    #[strum(to_string = "its shader differs")]
    Shader,
    /// In commands, states, formats or sizes.
    #[strum(to_string = "its commands or descriptors differ")]
    Commands,
    /// In uploads, or in what stages before it have left.
    #[strum(to_string = "its inputs differ")]
    Inputs,
}

/// Exact figures of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExactFigures {
    pub side: Side,
    pub cell: CellId,
    pub work: Work,
    /// Pipeline statistics, where the adapter counts them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub counters: BTreeMap<String, u64>,
}

/// A stage's error on a small case, as `fathom verify` measures it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CheckFigure {
    pub side: Side,
    #[serde(flatten)]
    pub check: CheckReading,
}

/// Instructions of a cell's steady frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct InstructionCounts {
    pub side: Side,
    pub cell: CellId,
    /// Instructions of each frame.
    pub counts: Vec<u64>,
    /// By a fresh process that counted this cell alone, as the first counts of both sides differed. Of earlier versions: its configuration.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub second: bool,
}

/// Two samples of a cell, one right after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pair {
    /// Number of the launch.
    pub launch: u32,
    /// Number of the pair within its launch.
    pub round: u32,
    pub cell: CellId,
    /// Both sides are one build: the base in even launches, the head in odd ones. Earlier versions took the base in all.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub control: bool,
    /// Of a second measurement, which earlier versions made of the cells that the first left open.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub second: bool,
    /// The side that was sampled first.
    pub first: Side,
    /// The base's sample, nanoseconds.
    pub base_ns: f64,
    /// The head's sample, nanoseconds.
    pub head_ns: f64,
    /// The adapter after each sample, where its driver tells.
    #[serde(default, skip_serializing_if = "PairStates::is_empty")]
    pub machine: PairStates,
}

/// State of the adapter after the two samples of a pair.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct PairStates {
    /// After the base's sample.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base: Option<MachineState>,
    /// After the head's sample.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub head: Option<MachineState>,
}

impl PairStates {
    pub fn is_empty(&self) -> bool {
        self.base.is_none() && self.head.is_none()
    }
}

/// A pair of workers that went through all its rounds. Pairs of a launch without this line do not count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Launch {
    /// Number of the launch.
    pub launch: u32,
    /// How long it took, seconds.
    pub wall_s: f64,
    /// Of a second measurement, which earlier versions made.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub second: bool,
    /// The only core that was measured on, if the workers were kept on one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub core: Option<usize>,
    /// Conditions of a quiet measurement that could not be had.
    pub notes: Vec<String>,
}

/// Something that could not be measured. Without a cell it concerns the whole gate, without a side both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Fault {
    pub gate: Gate,
    /// The side that failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
    /// The cell that could not be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<CellId>,
    /// Number of the launch in which it happened.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub launch: Option<u32>,
    /// The control failed that measures this cell, not the cell itself.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub control: bool,
    /// The side has no such cell: there is nothing to compare, and nothing failed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub absent: bool,
    /// Why, in one sentence.
    pub reason: String,
}

impl Fault {
    pub fn new(
        gate: Gate,
        side: Option<Side>,
        cell: Option<CellId>,
        reason: impl Into<String>,
    ) -> Self {
        let reason = private::redact(&reason.into());
        Self { gate, side, cell, launch: None, control: false, absent: false, reason }
    }
}

/// How measuring ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ComparisonEnd {
    /// How long measuring took, seconds.
    pub wall_s: f64,
    /// It was interrupted before all was measured.
    pub interrupted: bool,
}
