//! What the comparing process and a worker say to each other: one JSON object per line, a reply to each request. For programs that are
//! not fathom: `docs/worker-protocol.md`.
//!
//! Fields may be added within a version, each with a default, and so may messages: a worker answers one it does not know with
//! [`Reply::Unsupported`]. The version is raised when a message changes its meaning.

use std::collections::BTreeMap;
use std::io::{self, BufRead, Write};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use strum::{Display, EnumDiscriminants, EnumString};
use thiserror::Error;

use super::comparison::CellId;
use super::{Adapter, Build, ClockPlan, ErrorFigure, MachineState, PassKind, Work, nan};

/// Version of these messages.
pub const PROTOCOL: u32 = 1;

/// A pipeline on a scene with these parameters, under a name of the caller's choice.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GateConfiguration {
    /// Later requests call the configuration so.
    pub id: String,
    /// As the cells file has it.
    pub pipeline: String,
    /// As the cells file has it.
    pub scene: String,
    /// Dotted path → value, over the pipeline's defaults.
    pub params: Map<String, Value>,
    /// Those that are compared. The worker prepares all that the pipeline has.
    #[serde(skip)]
    pub stages: Vec<String>,
}

impl GateConfiguration {
    pub fn cells(&self) -> impl Iterator<Item = CellId> + '_ {
        self.stages.iter().map(|stage| CellId::new(&self.id, stage))
    }
}

/// A line that a worker reads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema, EnumDiscriminants)]
#[serde(tag = "message", rename_all = "snake_case")]
#[strum_discriminants(name(RequestKind), derive(Display, EnumString))]
#[strum_discriminants(strum(serialize_all = "snake_case"))]
pub enum WorkerRequest {
    /// Comes first. The worker opens its device.
    Hello {
        /// Version of the protocol.
        protocol: u32,
        /// How to time, where the caller knows it from another worker's reply to `clock`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        clock: Option<ClockPlan>,
    },
    /// Audits the clock of a hardware adapter; a software one needs none. Takes seconds.
    Clock,
    /// Builds a configuration and runs its frame, which compiles its shaders.
    Prepare {
        #[serde(flatten)]
        configuration: GateConfiguration,
    },
    /// Builds a configuration on a device of its own and tells what its stages ask of the GPU.
    Fingerprint {
        #[serde(flatten)]
        configuration: GateConfiguration,
    },
    /// Runs a stage alone, so many frames in a row.
    Sample {
        /// The id of a prepared configuration.
        config: String,
        /// A stage of it.
        stage: String,
        /// How many times to take.
        frames: u32,
    },
    /// What can be counted of a configuration.
    Exact {
        /// The id of a prepared configuration.
        config: String,
    },
    /// Runs a stage alone with a call of a function named `fathom_sample_boundary` before each frame and one after the last.
    Instructions {
        /// The id of a prepared configuration.
        config: String,
        /// A stage of it.
        stage: String,
        /// How many frames to count.
        frames: u32,
    },
    /// The checks of `fathom verify` that concern these stages.
    Checks {
        /// Names of stages.
        stages: Vec<String>,
    },
    /// Ends the worker, which does not reply.
    Quit,
}

impl WorkerRequest {
    /// The answer of a worker that cannot do this.
    pub fn unsupported(&self) -> Reply {
        Reply::Unsupported { message: RequestKind::from(self).to_string() }
    }
}

/// A line that a worker writes, for each request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum Reply {
    Hello(Box<Greeting>),
    Clock {
        /// What the audit has chosen.
        clock: ClockPlan,
    },
    Prepared {
        /// All stages of the configuration, in frame order.
        stages: Vec<StageKind>,
    },
    /// Stages of the same digest ask the GPU for the same work on the same inputs.
    Fingerprint(Fingerprints),
    /// One reading per frame.
    Sample {
        /// Nanoseconds, each above 0.
        ns: Vec<f64>,
        /// The adapter after the last frame, where its driver tells; workers of earlier versions do not.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        machine: Option<Box<MachineState>>,
    },
    Exact(Box<Exact>),
    Checks {
        /// One for each figure that is checked.
        checks: Vec<CheckReading>,
    },
    Instructions {
        /// How many were counted: as many as were asked for.
        frames: u32,
    },
    /// The request could not be met. After a fatal one the worker ends.
    Fault {
        /// For people, in a line.
        reason: String,
        /// The worker ends.
        fatal: bool,
        /// This build knows no such pipeline, scene, stage or parameter.
        absent: bool,
    },
    /// The worker does not know this message.
    Unsupported {
        /// Its name.
        #[serde(rename = "request")]
        message: String,
    },
}

/// What a worker says of itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Greeting {
    /// Version of the protocol.
    pub protocol: u32,
    /// Version of the program.
    pub fathom_version: String,
    /// What the stages run on.
    pub adapter: Adapter,
    /// `exact`, `checks`, `time`, `instructions`: what this worker can do.
    pub parts: Vec<String>,
    /// Cores it may run on; unknown outside Linux.
    #[serde(default)]
    pub cores: Option<Vec<usize>>,
    /// Its addresses are randomized; unknown outside Linux.
    #[serde(default)]
    pub randomized: Option<bool>,
    /// What degrades on this adapter.
    #[serde(default)]
    pub notes: Vec<String>,
    /// What the program was built of; absent from programs that do not know.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub build: Option<Build>,
    /// Digest of the sources that measure and of the libraries below them; absent from programs that give no fingerprints.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_by: Option<String>,
    /// Digest of all code that runs on the host; absent from programs that do not know.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub host_code: Option<String>,
    /// The cells of its own gates; absent from programs that have none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cells: Vec<CellId>,
}

/// `llvmpipe (Mesa 22.3.6)`.
pub fn with_driver(adapter: &Adapter) -> String {
    format!("{} ({})", adapter.title(), adapter.driver_info)
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageKind {
    /// As the cells file has it.
    pub name: String,
    /// Kind of its first pass; `host` for a stage without passes.
    pub kind: PassKind,
}

/// What a configuration asks of the GPU.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Fingerprints {
    /// In frame order.
    pub stages: Vec<StageFingerprint>,
    /// Digest of all that is made and uploaded before the first stage.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub created: String,
    /// Sources of shaders by name, to show what differs.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sources: BTreeMap<String, String>,
}

/// What a stage asks of the GPU.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageFingerprint {
    /// As `prepared` has it.
    pub name: String,
    /// Of its commands, and of what they read.
    pub digest: String,
    /// What the program declares that the stage does.
    pub work: Work,
    /// Digest of its shaders alone.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub shaders: String,
    /// Names of their sources and of what these import.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sources: Vec<String>,
    /// Commands and descriptors in words, to show what differs.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub commands: String,
}

/// The exact figures of a configuration.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Exact {
    /// In frame order.
    pub stages: Vec<ExactStage>,
    /// Memory of the adapter that the configuration has taken.
    pub allocated_bytes: u64,
    /// Errors against the reference: more is worse.
    #[serde(deserialize_with = "nan::map")]
    #[schemars(schema_with = "nan::map_schema")]
    pub errors: BTreeMap<String, f64>,
    /// The same with the stage that each judges; absent from workers that do not know.
    #[serde(default)]
    pub judged: Vec<ErrorFigure>,
    /// Figures read back from the frame that are no errors.
    #[serde(deserialize_with = "nan::map")]
    #[schemars(schema_with = "nan::map_schema")]
    pub quantities: BTreeMap<String, f64>,
    /// What could not be computed, and why.
    pub notes: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExactStage {
    /// As `prepared` has it.
    pub name: String,
    /// What the program declares that the stage does.
    pub work: Work,
    /// Shader invocations; empty where the adapter does not count.
    pub counters: BTreeMap<String, u64>,
}

/// A stage's error on a small case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CheckReading {
    /// The stage that was checked.
    pub stage: String,
    /// What was compared.
    pub what: String,
    /// Of `measured` and `tolerance`.
    pub unit: String,
    /// The error, in `unit`; null where it is no number.
    #[serde(deserialize_with = "nan::number")]
    #[schemars(schema_with = "nan::number_schema")]
    pub measured: f64,
    /// Largest error that passes, in `unit`.
    pub tolerance: f64,
    /// It passed and its control failed.
    pub sound: bool,
}

/// The request on a line, or what to answer instead.
pub fn parse_request(line: &str) -> Result<WorkerRequest, Reply> {
    let fault = |error: serde_json::Error| Reply::Fault {
        reason: format!("not a message: {error}"),
        fatal: false,
        absent: false,
    };
    let value: Value = serde_json::from_str(line).map_err(fault)?;
    match value.get("message").and_then(Value::as_str) {
        Some(name) if name.parse::<RequestKind>().is_err() => {
            Err(Reply::Unsupported { message: name.to_owned() })
        }
        _ => serde_json::from_value(value).map_err(fault),
    }
}

/// Why a worker ends before it is asked to.
#[derive(Debug, Error)]
pub enum ServeError {
    #[error("cannot read a request: {0}")]
    Read(io::Error),
    #[error("cannot write a reply: {0}")]
    Write(io::Error),
    #[error("{0}")]
    Fatal(String),
}

/// The loop of a worker: answers each line of `input` with a line of `output`, until `quit`, the end of the input or a fatal fault.
/// A worker passes [`WorkerRequest::unsupported`] on for what it cannot do.
pub fn serve(
    input: impl BufRead,
    mut output: impl Write,
    mut answer: impl FnMut(WorkerRequest) -> Reply,
) -> Result<(), ServeError> {
    for line in input.lines() {
        let line = line.map_err(ServeError::Read)?;
        if line.trim().is_empty() {
            continue;
        }
        let reply = match parse_request(&line) {
            Ok(WorkerRequest::Quit) => return Ok(()),
            Ok(request) => answer(request),
            Err(reply) => reply,
        };
        let line =
            serde_json::to_string(&reply).map_err(|error| ServeError::Write(error.into()))?;
        let written = writeln!(output, "{line}").and_then(|()| output.flush());
        written.map_err(ServeError::Write)?;
        if let Reply::Fault { reason, fatal: true, .. } = reply {
            return Err(ServeError::Fatal(reason));
        }
    }
    Ok(())
}

/// What one line asks and another answers; `quit` has no reply.
#[derive(JsonSchema)]
pub(super) struct Exchange {
    /// The line on the worker's standard input.
    #[expect(dead_code, reason = "for the schema alone")]
    request: WorkerRequest,
    /// The line on its standard output.
    #[expect(dead_code, reason = "for the schema alone")]
    reply: Option<Reply>,
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_field_of_a_later_version_is_passed_over() {
        let sample = r#"{"message":"sample","config":"a","stage":"b","frames":1,"later":1}"#;
        let sample = parse_request(sample);
        let expected = WorkerRequest::Sample { config: "a".into(), stage: "b".into(), frames: 1 };
        assert_eq!(sample.unwrap(), expected);
    }

    #[test]
    fn unknown_messages_are_named_and_wrong_ones_say_what_lacks() {
        let unknown = parse_request(r#"{"message":"explode","config":"a"}"#).unwrap_err();
        assert_eq!(
            serde_json::to_value(unknown).unwrap(),
            json!({"message": "unsupported", "request": "explode"})
        );
        for (line, reason) in [
            (r#"{"message":"sample","stage":"b"}"#, "missing field `config`"),
            (r#"{"config":"a"}"#, "missing field `message`"),
            ("fish", "expected"),
        ] {
            let Err(Reply::Fault { reason: found, fatal: false, .. }) = parse_request(line) else {
                panic!("{line} was taken");
            };
            assert!(found.contains(reason), "{line}: {found}");
        }
    }
}
