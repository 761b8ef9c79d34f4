//! Samples of cells that are still being measured: a line for what each visit to a cell added, so that a process that is killed
//! loses no more than the round it was in.
//!
//! Each line stands for itself: it names its cell by a digest of all that makes the cell and its conditions, so a line that is
//! lost takes no other with it.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{Clock, Line, MachineState, PassKind, Rejection, Run, schema};

/// Version of the lines; raised when a field changes its meaning or goes away.
pub const SAMPLES_SCHEMA: u32 = 3;
/// Bytes of the digest that names a cell.
const ID_BYTES: usize = 12;

/// What one visit to a cell added.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SampleLine {
    /// Version of the format of these lines.
    #[schemars(extend("const" = SAMPLES_SCHEMA))]
    pub schema: u32,
    /// Digest of the cell and its conditions: build, machine, adapter, profile, shader checks and resume key.
    pub id: String,
    /// The experiment, for readers: the id says all.
    pub experiment: String,
    /// The cell within its experiment, for readers.
    pub cell: String,
    /// The clock of each kind of pass.
    #[schemars(schema_with = "schema::map::<PassKind, Clock>")]
    pub clocks: Clocks,
    pub added: Addition,
}

/// The clock that each kind of pass is timed by.
pub type Clocks = BTreeMap<PassKind, Clock>;

impl Line for SampleLine {
    const SCHEMA: u32 = SAMPLES_SCHEMA;
    const NAME: &'static str = "line of samples";
}

impl SampleLine {
    /// Name of a cell under a run's conditions: the same build, machine, adapter, profile and shader checks, and the same
    /// [resume key](super::resume_key).
    pub fn id(run: &Run, resume_key: &str) -> String {
        let Run { fathom_version, adapter, profile, shader_checks, .. } = run;
        let host = &run.conditions.host;
        let conditions =
            serde_json::json!([fathom_version, host, adapter, profile, shader_checks, resume_key]);
        let digest = Sha256::digest(conditions.to_string());
        hex::encode(&digest[..ID_BYTES])
    }
}

/// What a visit adds to a cell's samples.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Addition {
    /// All that came before of this cell does not count: it went into a record, or was measured in another way.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub afresh: bool,
    /// Frames rendered to warm up.
    #[serde(skip_serializing_if = "super::is_zero")]
    pub warm_up_frames: u32,
    /// The frame time still fell when warm-up was given up.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub unsteady: bool,
    /// The frames of this visit, where they were used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pair: Option<FramePair>,
    /// Why the frames of this visit were not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rejected: Option<Rejection>,
}

/// A timed frame and an untimed one, nanoseconds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FramePair {
    /// The round of sampling: samples of one round were taken next to each other.
    pub round: u32,
    /// When it was sampled, seconds of Unix time.
    pub sampled_at_s: f64,
    /// The adapter at that moment, where its driver tells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<MachineState>,
    /// In frame order.
    pub stages: Vec<StageTime>,
    /// From the first stage's begin to the last stage's end, nanoseconds.
    pub envelope_ns: f64,
    /// Time between stages, nanoseconds.
    pub gaps_ns: f64,
    /// Frame time without per-stage timing, nanoseconds.
    pub untimed_ns: f64,
}

/// Time of a stage in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageTime {
    /// The stage's name: `FAMILY/STEM`.
    pub stage: String,
    pub clock: Clock,
    /// Nanoseconds, less the submission's cost, if one is taken off; noise of that cost can then leave less than nothing.
    pub ns: f64,
    /// What was taken off, nanoseconds.
    #[serde(default)]
    pub submit_cost_ns: f64,
    /// A shorter time cannot be distinguished from 0, nanoseconds.
    #[serde(default)]
    pub resolution_ns: f64,
}

impl StageTime {
    /// Of a stage that did nothing.
    pub fn none(stage: &str) -> Self {
        let (stage, clock) = (stage.into(), Clock::Host);
        Self { stage, clock, ns: 0.0, submit_cost_ns: 0.0, resolution_ns: 0.0 }
    }

    /// Whether the time is more than the clock's uncertainty.
    pub fn is_resolved(&self) -> bool {
        self.ns > self.resolution_ns
    }

    /// The time, or the resolution where that is longer.
    pub fn at_least_resolution_ns(&self) -> f64 {
        self.ns.max(self.resolution_ns)
    }
}
