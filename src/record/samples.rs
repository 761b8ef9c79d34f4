//! Samples of cells that are still being measured: a line for what each visit to a cell added, so that a process that is killed
//! loses no more than the round it was in.
//!
//! Each line stands for itself: it names its cell by a digest of all that makes the cell and its conditions, so a line that is
//! lost takes no other with it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{Clock, Line, MachineState, PassKind, Rejection, Run};

/// Version of the lines; raised when a field changes its meaning or goes away.
pub const SAMPLES_SCHEMA: u32 = 3;
/// Bytes of the digest that names a cell.
const ID_BYTES: usize = 12;

/// What one visit to a cell added.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SampleLine {
    pub schema: u32,
    /// See [`SampleLine::id`].
    pub id: String,
    /// For readers: the id says all.
    pub experiment: String,
    pub cell: String,
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
    /// Name of a cell under a run's conditions: the same build, adapter, profile and shader checks, and the same
    /// [resume key](super::resume_key).
    pub fn id(run: &Run, resume_key: &str) -> String {
        let Run { fathom_version, adapter, profile, shader_checks, .. } = run;
        let conditions =
            serde_json::json!([fathom_version, adapter, profile, shader_checks, resume_key]);
        let digest = Sha256::digest(conditions.to_string());
        digest[..ID_BYTES].iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// What a visit adds to a cell's samples.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Addition {
    /// All that came before of this cell does not count: it went into a record, or was measured in another way.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub afresh: bool,
    #[serde(skip_serializing_if = "super::is_zero")]
    pub warm_up_frames: u32,
    /// The frame time still fell when warm-up was given up.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub unsteady: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pair: Option<FramePair>,
    /// Why the frames of this visit were not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rejected: Option<Rejection>,
}

/// A timed frame and an untimed one, nanoseconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FramePair {
    /// See [`FrameRecord::rounds`](super::FrameRecord::rounds).
    pub round: u32,
    /// Seconds of Unix time.
    pub sampled_at_s: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<MachineState>,
    pub stages: Vec<StageTime>,
    pub envelope_ns: f64,
    pub gaps_ns: f64,
    pub untimed_ns: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    pub stage: String,
    pub clock: Clock,
    /// Less the submission's cost, if one is taken off; noise of that cost can then leave less than nothing.
    pub ns: f64,
    #[serde(default)]
    pub submit_cost_ns: f64,
    #[serde(default)]
    pub resolution_ns: f64,
}
