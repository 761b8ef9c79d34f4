//! `fathom worker`: holds the prepared configurations of one build and measures one stage of them on request.
//!
//! A stage is measured by a [`StageClock`], alone in a frame and in one command buffer. A whole frame before has filled its inputs.

use std::collections::BTreeMap;
use std::io::{BufRead, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use serde_json::Value;
use thiserror::Error;

use super::cells::Gates;
use super::fingerprint::{self, STAGE_MARK, TracedStage};
use super::protocol::{
    self, CheckReading, Exact, ExactStage, Fingerprints, GateConfiguration, Greeting, PROTOCOL,
    Reply, ServeError, StageFingerprint, StageKind, WorkerRequest,
};
use super::valgrind;
use fathom_base::embedded::{Folders, SHADERS};
use fathom_base::parameter::ParamError;
use fathom_base::quiet;
use fathom_gpu as gpu;
use fathom_gpu::{ClockPlan, DeviceError, FrameTimer, Gpu, GpuError, Stage, StageClock};
use fathom_harness::MAX_PASSES;
use fathom_harness::catalog::Catalog;
use fathom_harness::catalog::SubjectError;
use fathom_harness::subject::{Subject, Subjects};
use fathom_pipelines::{AnyPipeline, Judge, ReferenceCache};
use fathom_record::comparison::CellSubject;
use fathom_record::{PassKind, Work};
use fathom_scene::SceneError;
use fathom_verify::{Case, Check, VerifyError, verify_stages};

/// What a worker of this build can do.
pub const PARTS: [&str; 4] = ["exact", "checks", "time", "instructions"];

static BOUNDARIES: AtomicU64 = AtomicU64::new(0);

/// Called before each frame whose instructions are counted, and after the last: where an instruction counter cuts
/// (`callgrind --dump-before=fathom_sample_boundary`).
#[unsafe(no_mangle)]
#[inline(never)]
pub extern "C" fn fathom_sample_boundary() {
    BOUNDARIES.fetch_add(1, Ordering::SeqCst);
}

/// Answers each line of `input` with a line of `output`, until `quit`, the end of the input or a fatal fault. `set` holds parameters for
/// each configuration whose pipeline has them.
pub fn serve(
    options: &gpu::Options,
    catalog: &Catalog,
    set: &[(String, Value)],
    input: impl BufRead,
    output: impl Write,
) -> Result<(), ServeError> {
    quiet::pad_heap();
    let subjects = Subjects::new(catalog).silent();
    let mut worker = RequestServer { options, catalog, set, subjects, device: None };
    protocol::serve(input, output, |request| worker.reply(request).unwrap_or_else(Refusal::reply))
}

/// Why a request cannot be met.
#[derive(Debug, Error)]
pub enum Refusal {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error(transparent)]
    Subject(#[from] SubjectError),
    #[error(transparent)]
    Verify(#[from] VerifyError),
    #[error("the first message must be `hello`")]
    NoHello,
    #[error("no fingerprint: {0}")]
    NoTrace(String),
    #[error("configuration `{0}` is not prepared")]
    NotPrepared(String),
    #[error("configuration `{config}` has no stage `{stage}`; it has {present}")]
    NoStage { config: String, stage: String, present: String },
}

impl From<DeviceError> for Refusal {
    fn from(error: DeviceError) -> Self {
        Self::Gpu(error.into())
    }
}

impl Refusal {
    fn reply(self) -> Reply {
        Reply::Fault {
            fatal: matches!(self, Self::Gpu(GpuError::Device(DeviceError::Lost(_)))),
            absent: self.is_absence(),
            reason: self.to_string(),
        }
    }

    /// This build does not know what it is asked for. Every other refusal is a failure.
    fn is_absence(&self) -> bool {
        matches!(
            self,
            Self::Subject(
                SubjectError::UnknownPipeline { .. }
                    | SubjectError::OfAnother { .. }
                    | SubjectError::Scene(SceneError::Unknown { .. })
                    | SubjectError::Param(ParamError::Unknown { .. })
            ) | Self::NoStage { .. }
        )
    }
}

struct RequestServer<'a> {
    options: &'a gpu::Options,
    catalog: &'a Catalog,
    set: &'a [(String, Value)],
    subjects: Subjects,
    device: Option<OpenDevice>,
}

/// The open device and what is prepared on it.
struct OpenDevice {
    gpu: Gpu,
    clock: StageClock,
    prepared: BTreeMap<String, PreparedCell>,
}

type PreparedCell = (Subject, Box<AnyPipeline>);

/// Of the parameters that are set for all configurations those that this one has.
fn set_of(
    catalog: &Catalog,
    set: &[(String, Value)],
    configuration: &GateConfiguration,
) -> Result<Vec<(String, Value)>, SubjectError> {
    let fields = (catalog.kind(&configuration.pipeline)?.fields)();
    let is_known = |path: &str| fields.iter().any(|field| field.path == path);
    Ok(set.iter().filter(|(path, _)| is_known(path)).cloned().collect())
}

fn subject(
    subjects: &mut Subjects,
    configuration: &GateConfiguration,
) -> Result<Subject, SubjectError> {
    let overrides: Vec<_> = configuration.params.clone().into_iter().collect();
    subjects.subject(&configuration.pipeline, &configuration.scene, &overrides)
}

/// What each stage asks of the GPU in its first two frames, after what is run once.
pub fn fingerprint(options: &gpu::Options, subject: &Subject) -> Result<Fingerprints, Refusal> {
    let folder = tempfile::tempdir().map_err(|error| Refusal::NoTrace(error.to_string()))?;
    let trace = Some(folder.path().to_owned());
    // The trace ends when the device is gone.
    let record = || -> Result<Vec<(String, Work)>, Refusal> {
        let gpu = Gpu::open(&gpu::Options { trace, ..options.clone() })?;
        let pipeline = subject.build(&gpu)?;
        let stages = pipeline.stages();
        for stage in stages.iter().chain(&stages) {
            let mut marker = gpu.device.create_command_encoder(&Default::default());
            marker.insert_debug_marker(&format!("{STAGE_MARK}{}", stage.name()));
            gpu.queue.submit([marker.finish()]);
            gpu.run(&[*stage])?;
        }
        Ok(stages.iter().map(|stage| (stage.name().to_owned(), stage.work)).collect())
    };
    let works = fingerprint::without_warnings(record).map_err(Refusal::NoTrace)??;
    let mut traced = fingerprint::of_trace(folder.path()).map_err(Refusal::NoTrace)?;
    let folders = options.shaders.clone().unwrap_or_else(|| Folders::new(SHADERS));
    let mut sources = BTreeMap::new();
    let print = |(name, work): (String, Work)| {
        let stage = traced.stages.remove(&name);
        // Without a turn in the trace it has none, and counts as changed.
        let [digest, shaders] = stage.as_ref().map(TracedStage::digests).unwrap_or_default();
        let stage = stage.unwrap_or_default();
        let own = stage.modules.iter().flat_map(|module| gpu::sources(&folders, module));
        let own: BTreeMap<String, String> = own.collect();
        let names = own.keys().cloned().collect();
        sources.extend(own);
        StageFingerprint { digest, name, work, shaders, sources: names, commands: stage.commands }
    };
    let stages = works.into_iter().map(print).collect();
    Ok(Fingerprints { stages, created: traced.created, sources })
}

impl RequestServer<'_> {
    fn reply(&mut self, request: WorkerRequest) -> Result<Reply, Refusal> {
        if let WorkerRequest::Hello { clock, .. } = request {
            return self.hello(clock);
        }
        let device = self.device.as_mut().ok_or(Refusal::NoHello)?;
        match request {
            WorkerRequest::Clock => Ok(Reply::Clock { clock: device.clock.plan(&device.gpu)? }),
            WorkerRequest::Prepare { mut configuration } => {
                configuration.params.extend(set_of(self.catalog, self.set, &configuration)?);
                device.prepare(&mut self.subjects, &configuration)
            }
            WorkerRequest::Fingerprint { mut configuration } => {
                configuration.params.extend(set_of(self.catalog, self.set, &configuration)?);
                let subject = subject(&mut self.subjects, &configuration)?;
                Ok(Reply::Fingerprint(fingerprint(self.options, &subject)?))
            }
            WorkerRequest::Sample { config, stage, frames } => {
                device.sample(&config, &stage, frames)
            }
            WorkerRequest::Exact { config } => device.exact(&config),
            WorkerRequest::Instructions { config, stage, frames } => {
                device.instructions(&config, &stage, frames)
            }
            WorkerRequest::Checks { stages } => device.checks(&self.catalog.cases(), &stages),
            WorkerRequest::Hello { .. } | WorkerRequest::Quit => unreachable!("answered before"),
        }
    }

    fn hello(&mut self, clock: Option<ClockPlan>) -> Result<Reply, Refusal> {
        let gpu = Gpu::open(self.options)?;
        let clock = StageClock::new(&gpu, clock, MAX_PASSES)?;
        let device = self.device.insert(OpenDevice { gpu, clock, prepared: BTreeMap::new() });
        Ok(Reply::Hello(Box::new(Greeting {
            protocol: PROTOCOL,
            fathom_version: env!("CARGO_PKG_VERSION").to_owned(),
            adapter: device.gpu.adapter.clone(),
            parts: PARTS.map(str::to_owned).to_vec(),
            cores: Some(quiet::allowed_cores()).filter(|cores| !cores.is_empty()),
            randomized: quiet::randomized(),
            notes: device.gpu.notes.clone(),
            build: Some(self.catalog.build()),
            measured_by: Some(env!("FATHOM_MEASURED_BY").to_owned()),
            host_code: Some(self.catalog.host_code.to_owned()).filter(|code| !code.is_empty()),
            cells: Gates::load(None, self.catalog.gates)
                .map_or_else(|_| Vec::new(), |own| own.cells()),
        })))
    }
}

impl OpenDevice {
    fn prepare(
        &mut self,
        subjects: &mut Subjects,
        configuration: &GateConfiguration,
    ) -> Result<Reply, Refusal> {
        let subject = subject(subjects, configuration)?;
        let pipeline = subject.build(&self.gpu)?;
        let stages = pipeline.stages();
        // A whole frame compiles the shaders and fills every stage's inputs.
        self.clock.timer.run_stages(&self.gpu, &stages)?;
        let kinds = stages.iter().zip(self.clock.timer.kinds(&self.gpu, &stages)?);
        let kinds = kinds.map(|(stage, kind)| StageKind { name: stage.name().to_owned(), kind });
        let of_host = |subject: CellSubject| {
            let name = subject.to_string();
            StageKind { name, kind: PassKind::Host }
        };
        let encoded = stages.iter().map(|stage| of_host(CellSubject::Encode(stage.name())));
        let hosts = encoded.chain([of_host(CellSubject::Create)]);
        let reply = Reply::Prepared { stages: kinds.chain(hosts).collect() };
        self.prepared.insert(configuration.id.clone(), (subject, pipeline));
        Ok(reply)
    }

    fn sample(&mut self, config: &str, stage: &str, frames: u32) -> Result<Reply, Refusal> {
        let subject = MeasuredWork::find(&self.prepared, config, stage)?;
        if let MeasuredWork::Stage { before, stage } = &subject {
            return Ok(self.clock.sample(&self.gpu, before, stage, frames)?);
        }
        let timed = |_| {
            let start = Instant::now();
            subject.run(&self.gpu, &mut self.clock.timer)?;
            Ok(start.elapsed().as_secs_f64() * 1e9)
        };
        let ns = (0..frames).map(timed).collect::<Result<_, GpuError>>()?;
        Ok(Reply::Sample { ns, machine: None })
    }

    fn exact(&mut self, config: &str) -> Result<Reply, Refusal> {
        let (Subject { scene, .. }, pipeline) = find_prepared(&self.prepared, config)?;
        let stages = pipeline.stages();
        let counted = gpu::count(&self.gpu, &stages, MAX_PASSES)?;
        self.clock.timer.run_stages(&self.gpu, &stages)?;
        let stages = stages.iter().map(|stage| {
            let counters = counted.iter().find(|counted| counted.name == stage.name());
            ExactStage {
                name: stage.name().to_owned(),
                work: stage.work,
                counters: counters.map(|stage| stage.counters.clone()).unwrap_or_default(),
            }
        });
        let mut exact = Exact {
            stages: stages.collect(),
            allocated_bytes: pipeline.allocated_bytes(),
            quantities: pipeline.all_quantities(&self.gpu)?,
            ..Exact::default()
        };
        let known = ReferenceCache::default();
        match pipeline.judge(&self.gpu, &[])?(&Judge::new(scene, &known)) {
            Ok(judged) => {
                exact.quantities.extend(judged.quantities);
                exact.errors =
                    judged.errors.iter().map(|e| (e.name.to_string(), e.value)).collect();
                exact.judged = judged.errors;
            }
            Err(error) => exact.notes.push(format!("errors not computed: {error}")),
        }
        Ok(Reply::Exact(Box::new(exact)))
    }

    fn instructions(&mut self, config: &str, stage: &str, frames: u32) -> Result<Reply, Refusal> {
        let subject = MeasuredWork::find(&self.prepared, config, stage)?;
        valgrind::start_counting();
        // A frame that steadies it is not counted. Making a pipeline takes seconds under callgrind, and needs none.
        if !matches!(subject, MeasuredWork::Create(_)) {
            subject.refill(&self.gpu, &mut self.clock.timer)?;
            subject.run(&self.gpu, &mut self.clock.timer)?;
        }
        for _ in 0..frames {
            fathom_sample_boundary();
            if subject.refill(&self.gpu, &mut self.clock.timer)? {
                valgrind::forget_counts();
            }
            subject.run(&self.gpu, &mut self.clock.timer)?;
        }
        fathom_sample_boundary();
        Ok(Reply::Instructions { frames })
    }

    fn checks(&mut self, cases: &[Case], stages: &[String]) -> Result<Reply, Refusal> {
        let checks = verify_stages(&self.gpu, cases, stages)?.into_iter();
        let read = |check: Check| CheckReading {
            sound: check.is_sound(),
            stage: check.stage.to_owned(),
            what: check.what,
            unit: check.unit.to_owned(),
            measured: check.measured,
            tolerance: check.tolerance,
        };
        Ok(Reply::Checks { checks: checks.map(read).collect() })
    }
}

fn find_prepared<'a>(
    prepared: &'a BTreeMap<String, PreparedCell>,
    config: &str,
) -> Result<&'a PreparedCell, Refusal> {
    prepared.get(config).ok_or_else(|| Refusal::NotPrepared(config.to_owned()))
}

enum MeasuredWork<'a> {
    Stage {
        /// What fills inputs that it spends.
        before: Vec<&'a Stage>,
        stage: &'a Stage,
    },
    Encode(&'a Stage),
    Create(&'a Subject),
}

impl<'a> MeasuredWork<'a> {
    fn find(
        prepared: &'a BTreeMap<String, PreparedCell>,
        config: &str,
        name: &str,
    ) -> Result<Self, Refusal> {
        let (subject, pipeline) = find_prepared(prepared, config)?;
        let stages = pipeline.stages();
        let find = |name: &str| {
            let found = stages.iter().find(|present| present.name() == name);
            found.copied().ok_or_else(|| Refusal::NoStage {
                config: config.to_owned(),
                stage: name.to_owned(),
                present: stages.iter().map(|stage| stage.name()).collect::<Vec<_>>().join(", "),
            })
        };
        Ok(match CellSubject::parse(name) {
            CellSubject::Stage(name) => {
                let stage = find(name)?;
                Self::Stage { before: gpu::stages_before(&stages, stage), stage }
            }
            CellSubject::Encode(stage) => Self::Encode(find(stage)?),
            CellSubject::Create => Self::Create(subject),
        })
    }

    /// Runs what it needs before it is repeated; whether there is such.
    fn refill(&self, gpu: &Gpu, timer: &mut FrameTimer) -> Result<bool, GpuError> {
        match self {
            Self::Stage { before, .. } if !before.is_empty() => {
                timer.run_stages(gpu, before)?;
                Ok(true)
            }
            _ => Ok(false),
        }
    }

    /// Does it once.
    fn run(&self, gpu: &Gpu, timer: &mut FrameTimer) -> Result<(), GpuError> {
        match self {
            Self::Stage { stage, .. } => timer.run_stages(gpu, &[*stage]).map(drop)?,
            Self::Encode(stage) => timer.encode(gpu, &[*stage])?,
            Self::Create(subject) => {
                gpu.drop_pipelines();
                drop(subject.build(gpu)?);
            }
        }
        Ok(())
    }
}
