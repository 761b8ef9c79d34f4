//! Frames and their timing.
//!
//! A stage opens passes only through the [`StageScope`] it is handed, which puts the timestamps there:
//! nobody can forget to time. The whole frame is encoded before the first submission, so that what the
//! CPU spends on encoding is in neither the stages nor the gaps.
//!
//! A pass whose kind has sound timestamps shares a command buffer with its neighbours. A pass on the
//! fenced host clock has a command buffer to itself, which is submitted alone and waited for, between
//! two readings of the host clock less the cost of a submission. The command buffers of a frame are its
//! *segments*, each submitted when the one before has finished.
//!
//! Accounting: the *envelope* is the host's time from the first submission to the last fence, and the
//! host stages. *Gaps* are the timestamps' gaps between passes of a segment, the host's gaps between
//! segments, and one submission cost per segment. Stages + gaps = envelope then holds only if the
//! timestamps and the host clock agree.

use std::fmt;
use std::ops::Range;
use std::time::Instant;

use super::readback::map;
use super::{Gpu, GpuError};
use crate::record::{Clock, PassKind};

/// WebGPU's largest query set.
const QUERIES_PER_SET: u32 = 4096;
/// Begin and end.
const QUERIES_PER_PASS: u32 = 2;
const TICK_BYTES: u64 = size_of::<u64>() as u64;
/// WebGPU's largest number of colour targets.
const MAX_COLOR_TARGETS: usize = 8;
/// A timestamp duration may be longer than its segment's wall time by this factor and still be within
/// what two clocks differ by.
const WALL_TOLERANCE: f64 = 1.01;

/// Something that encodes passes: a stage.
pub trait Encode {
    /// The name under which the time is recorded, such as `caustics/trace`.
    fn name(&self) -> &'static str;
    /// Opens the stage's passes. Called once per frame.
    fn encode(&self, scope: &mut StageScope<'_>);
}

/// The clock for each kind of pass, as the audit found it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockPlan {
    pub compute: Clock,
    pub render: Clock,
    pub copy: Clock,
    pub submit_cost: SubmitCost,
}

/// Host time in ns from submission to fence of a command buffer with the least pass of a kind. An empty command buffer
/// says too little: a driver need not wake its threads for it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SubmitCost {
    pub compute_ns: f64,
    pub render_ns: f64,
    pub copy_ns: f64,
}

impl SubmitCost {
    pub fn of(&self, kind: PassKind) -> f64 {
        match kind {
            PassKind::Compute => self.compute_ns,
            PassKind::Render => self.render_ns,
            PassKind::Copy => self.copy_ns,
            PassKind::Host => 0.0,
        }
    }
}

impl ClockPlan {
    /// Every pass on the fenced host clock.
    pub fn fenced(submit_cost: SubmitCost) -> Self {
        let clock = Clock::FencedHost;
        Self {
            compute: clock,
            render: clock,
            copy: clock,
            submit_cost,
        }
    }

    pub fn clock(&self, kind: PassKind) -> Clock {
        match kind {
            PassKind::Compute => self.compute,
            PassKind::Render => self.render,
            PassKind::Copy => self.copy,
            PassKind::Host => Clock::Host,
        }
    }

    /// The same plan with another clock for one kind of pass.
    pub fn with(mut self, kind: PassKind, clock: Clock) -> Self {
        match kind {
            PassKind::Compute => self.compute = clock,
            PassKind::Render => self.render = clock,
            PassKind::Copy => self.copy = clock,
            PassKind::Host => {}
        }
        self
    }
}

/// The targets of a render pass.
#[derive(Clone, Copy, Debug, Default)]
pub struct Targets<'a> {
    /// At most eight.
    pub color: &'a [ColorTarget<'a>],
    pub depth: Option<DepthTarget<'a>>,
}

#[derive(Clone, Copy, Debug)]
pub struct ColorTarget<'a> {
    pub view: &'a wgpu::TextureView,
    /// Cleared to this first; otherwise what it holds is kept.
    pub clear: Option<wgpu::Color>,
}

#[derive(Clone, Copy, Debug)]
pub struct DepthTarget<'a> {
    pub view: &'a wgpu::TextureView,
    /// Cleared to this first; otherwise what it holds is kept.
    pub clear: Option<f32>,
    /// Tested but not written; `clear` is then ignored.
    pub read_only: bool,
}

/// What a stage opens its passes through.
pub struct StageScope<'a> {
    recorder: &'a mut Recorder,
    gpu: &'a Gpu,
    mode: Mode<'a>,
    stage: usize,
    name: &'static str,
}

/// What is done to a frame's passes.
#[derive(Clone, Copy)]
pub(super) enum Mode<'a> {
    /// Each is timed by the plan's clock for its kind.
    Timed {
        plan: &'a ClockPlan,
        sets: &'a [wgpu::QuerySet],
        max_passes: u32,
    },
    /// All in one command buffer, nothing is timed.
    Untimed,
    /// All in one command buffer, with a pipeline statistics query around each compute and render pass.
    Counted {
        set: &'a wgpu::QuerySet,
        max_passes: u32,
    },
}

/// One pass of an encoded frame.
pub(super) struct Pass {
    pub(super) stage: usize,
    kind: PassKind,
    /// The number of its pair of timestamps, or of its statistics.
    pub(super) query: Option<u32>,
}

/// One command buffer of an encoded frame, and which of the frame's passes it holds.
struct Segment {
    commands: wgpu::CommandBuffer,
    passes: Range<usize>,
    fenced: bool,
}

/// Work of the CPU within a frame.
struct HostWork {
    stage: usize,
    ns: f64,
}

/// A frame as it is being encoded. Kept from frame to frame for its allocations.
#[derive(Default)]
pub(super) struct Recorder {
    encoder: Option<wgpu::CommandEncoder>,
    segments: Vec<Segment>,
    pub(super) passes: Vec<Pass>,
    host: Vec<HostWork>,
    /// Passes before the open encoder's first.
    closed: usize,
    pub(super) queries: u32,
    /// The frame wanted more queries than there are.
    overflow: bool,
}

impl Recorder {
    /// Encodes a whole frame.
    pub(super) fn record(
        &mut self,
        gpu: &Gpu,
        mode: Mode<'_>,
        stages: &[&dyn Encode],
    ) -> Result<(), GpuError> {
        self.reset();
        for (stage, encode) in stages.iter().enumerate() {
            let name = encode.name();
            encode.encode(&mut StageScope {
                recorder: self,
                gpu,
                mode,
                stage,
                name,
            });
        }
        self.close(false);
        match mode {
            Mode::Timed { max_passes, .. } | Mode::Counted { max_passes, .. } if self.overflow => {
                Err(GpuError::TooManyPasses(max_passes))
            }
            _ => Ok(()),
        }
    }

    fn reset(&mut self) {
        self.encoder = None;
        self.segments.clear();
        self.passes.clear();
        self.host.clear();
        self.closed = 0;
        self.queries = 0;
        self.overflow = false;
    }

    /// Ends the open command buffer, if there is one.
    fn close(&mut self, fenced: bool) {
        if let Some(encoder) = self.encoder.take() {
            let passes = self.closed..self.passes.len();
            self.segments.push(Segment {
                commands: encoder.finish(),
                passes,
                fenced,
            });
        }
        self.closed = self.passes.len();
    }

    /// Submits what the host stages have queued, so that it burdens no pass and no gap.
    fn flush_host_writes(&self, gpu: &Gpu) -> Result<(), GpuError> {
        if self.host.is_empty() {
            return Ok(());
        }
        let index = gpu.queue.submit([]);
        gpu.wait_for(Some(index))
    }

    fn host_ns(&self) -> f64 {
        self.host.iter().map(|work| work.ns).sum()
    }

    /// Submits all segments at once and waits for them. Returns the wall time in ns.
    pub(super) fn run(&mut self, gpu: &Gpu) -> Result<f64, GpuError> {
        self.flush_host_writes(gpu)?;
        let start = Instant::now();
        let index = gpu
            .queue
            .submit(self.segments.drain(..).map(|segment| segment.commands));
        gpu.wait_for(Some(index))?;
        Ok(ns_between(start, Instant::now()) + self.host_ns())
    }

    /// Submits the segments one after the other, each waited for.
    fn run_segments(&mut self, gpu: &Gpu, spans: &mut Vec<Span>) -> Result<(), GpuError> {
        self.flush_host_writes(gpu)?;
        spans.clear();
        for Segment {
            commands,
            passes,
            fenced,
        } in self.segments.drain(..)
        {
            let submit = Instant::now();
            let index = gpu.queue.submit([commands]);
            gpu.wait_for(Some(index))?;
            spans.push(Span {
                submit,
                fence: Instant::now(),
                passes,
                fenced,
            });
        }
        Ok(())
    }
}

/// When a segment ran, by the host clock.
struct Span {
    submit: Instant,
    fence: Instant,
    passes: Range<usize>,
    fenced: bool,
}

impl Span {
    fn wall_ns(&self) -> f64 {
        ns_between(self.submit, self.fence)
    }
}

fn ns_between(start: Instant, end: Instant) -> f64 {
    end.saturating_duration_since(start).as_secs_f64() * 1e9
}

/// What a pass is given to time or count it.
#[derive(Clone, Copy)]
struct Query<'a> {
    set: &'a wgpu::QuerySet,
    first: u32,
}

impl<'a> StageScope<'a> {
    /// A compute pass.
    pub fn compute(&mut self, f: impl FnOnce(&mut wgpu::ComputePass<'_>)) {
        let (label, counted) = (Some(self.name), self.counted());
        let (encoder, query) = self.begin(PassKind::Compute);
        let timestamps = query.filter(|_| !counted);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label,
            timestamp_writes: timestamps.map(|Query { set, first }| {
                wgpu::ComputePassTimestampWrites {
                    query_set: set,
                    beginning_of_pass_write_index: Some(first),
                    end_of_pass_write_index: Some(first + 1),
                }
            }),
        });
        let statistics = query.filter(|_| counted);
        if let Some(Query { set, first }) = statistics {
            pass.begin_pipeline_statistics_query(set, first);
        }
        f(&mut pass);
        if statistics.is_some() {
            pass.end_pipeline_statistics_query();
        }
        drop(pass);
        self.end(PassKind::Compute);
    }

    /// A render pass to these targets.
    pub fn render(&mut self, targets: &Targets<'_>, f: impl FnOnce(&mut wgpu::RenderPass<'_>)) {
        let (label, counted) = (Some(self.name), self.counted());
        let (encoder, query) = self.begin(PassKind::Render);
        let timestamps = query.filter(|_| !counted);
        let (attachments, count) = color_attachments(targets.color);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label,
            color_attachments: &attachments[..count],
            depth_stencil_attachment: targets.depth.as_ref().map(depth_attachment),
            timestamp_writes: timestamps.map(|Query { set, first }| {
                wgpu::RenderPassTimestampWrites {
                    query_set: set,
                    beginning_of_pass_write_index: Some(first),
                    end_of_pass_write_index: Some(first + 1),
                }
            }),
            ..Default::default()
        });
        let statistics = query.filter(|_| counted);
        if let Some(Query { set, first }) = statistics {
            pass.begin_pipeline_statistics_query(set, first);
        }
        f(&mut pass);
        if statistics.is_some() {
            pass.end_pipeline_statistics_query();
        }
        drop(pass);
        self.end(PassKind::Render);
    }

    /// Copies and clears. `f` must not open passes of its own: they would count as copying.
    pub fn copy(&mut self, f: impl FnOnce(&mut wgpu::CommandEncoder)) {
        let counted = self.counted();
        let (encoder, query) = self.begin(PassKind::Copy);
        let timestamps = query.filter(|_| !counted);
        if let Some(Query { set, first }) = timestamps {
            encoder.write_timestamp(set, first);
        }
        f(encoder);
        if let Some(Query { set, first }) = timestamps {
            encoder.write_timestamp(set, first + 1);
        }
        self.end(PassKind::Copy);
    }

    /// Work of the CPU, such as writing uniforms, timed by the host clock. As always with wgpu, what is
    /// written to a buffer is there before the frame's first pass, whatever the order of the stages.
    pub fn host(&mut self, f: impl FnOnce(&wgpu::Queue)) {
        let start = Instant::now();
        f(&self.gpu.queue);
        let ns = ns_between(start, Instant::now());
        self.recorder.host.push(HostWork {
            stage: self.stage,
            ns,
        });
    }

    fn counted(&self) -> bool {
        matches!(self.mode, Mode::Counted { .. })
    }

    fn fenced(&self, kind: PassKind) -> bool {
        matches!(self.mode, Mode::Timed { plan, .. } if plan.clock(kind) != Clock::Timestamp)
    }

    /// Notes a pass, and gives the encoder to open it in and its queries.
    fn begin(&mut self, kind: PassKind) -> (&mut wgpu::CommandEncoder, Option<Query<'a>>) {
        if self.fenced(kind) {
            self.recorder.close(false);
        }
        let number = self.take_query(kind);
        self.recorder.passes.push(Pass {
            stage: self.stage,
            kind,
            query: number,
        });
        let query = number.map(|number| match self.mode {
            Mode::Timed { sets, .. } => timestamp_query(sets, number),
            Mode::Counted { set, .. } => Query { set, first: number },
            Mode::Untimed => unreachable!("an untimed pass takes no query"),
        });
        let encoder = self.recorder.encoder.get_or_insert_with(|| {
            self.gpu
                .device
                .create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
        });
        (encoder, query)
    }

    /// The number of this pass's query, if it has one.
    fn take_query(&mut self, kind: PassKind) -> Option<u32> {
        let max_passes = match self.mode {
            Mode::Timed { max_passes, .. } if !self.fenced(kind) => max_passes,
            Mode::Counted { max_passes, .. } if kind != PassKind::Copy => max_passes,
            _ => return None,
        };
        if self.recorder.queries >= max_passes {
            self.recorder.overflow = true;
            return None;
        }
        self.recorder.queries += 1;
        Some(self.recorder.queries - 1)
    }

    fn end(&mut self, kind: PassKind) {
        if self.fenced(kind) {
            self.recorder.close(true);
        }
    }
}

fn timestamp_query(sets: &[wgpu::QuerySet], number: u32) -> Query<'_> {
    let index = number * QUERIES_PER_PASS;
    Query {
        set: &sets[(index / QUERIES_PER_SET) as usize],
        first: index % QUERIES_PER_SET,
    }
}

type Attachments<'a> = [Option<wgpu::RenderPassColorAttachment<'a>>; MAX_COLOR_TARGETS];

fn color_attachments<'a>(targets: &[ColorTarget<'a>]) -> (Attachments<'a>, usize) {
    let mut attachments: Attachments<'a> = [const { None }; MAX_COLOR_TARGETS];
    assert!(
        targets.len() <= MAX_COLOR_TARGETS,
        "a render pass has at most eight colour targets"
    );
    for (attachment, target) in attachments.iter_mut().zip(targets) {
        *attachment = Some(wgpu::RenderPassColorAttachment {
            view: target.view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: target.clear.map_or(wgpu::LoadOp::Load, wgpu::LoadOp::Clear),
                store: wgpu::StoreOp::Store,
            },
        });
    }
    (attachments, targets.len())
}

fn depth_attachment<'a>(target: &DepthTarget<'a>) -> wgpu::RenderPassDepthStencilAttachment<'a> {
    wgpu::RenderPassDepthStencilAttachment {
        view: target.view,
        depth_ops: (!target.read_only).then(|| wgpu::Operations {
            load: target.clear.map_or(wgpu::LoadOp::Load, wgpu::LoadOp::Clear),
            store: wgpu::StoreOp::Store,
        }),
        stencil_ops: None,
    }
}

/// One timed frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSample {
    /// In frame order.
    pub stages: Vec<StageSample>,
    pub gaps_ns: f64,
    /// Host time from the first submission to the last fence, and the host stages.
    pub envelope_ns: f64,
    /// The envelope, to be held against [`FrameTimer::untimed`]: what is timed costs more by the gaps
    /// between its segments.
    pub wall_ns: f64,
    /// Durations that cannot be true. A frame with any is not to be used.
    pub faults: Vec<Fault>,
}

impl FrameSample {
    /// |stages + gaps − envelope| / envelope; not a number when a stage has a fault.
    pub fn accounting_error(&self) -> f64 {
        let stages: f64 = self.stages.iter().map(|stage| stage.ns).sum();
        (stages + self.gaps_ns - self.envelope_ns).abs() / self.envelope_ns
    }
}

/// A stage's time in one frame: the sum over its passes.
#[derive(Clone, Debug, PartialEq)]
pub struct StageSample {
    pub name: &'static str,
    /// That of its passes; the fenced host clock where passes differ.
    pub clock: Clock,
    /// Not a number when one of its passes has a fault.
    pub ns: f64,
}

/// A stage's duration that was not accepted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    pub stage: &'static str,
    pub kind: FaultKind,
    /// The duration as read.
    pub ns: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FaultKind {
    Zero,
    Negative,
    /// Both timestamps are those of the frame before.
    Stale,
    LongerThanWall,
    /// The stage opened no pass, so there is nothing to time.
    NoPass,
}

impl FaultKind {
    /// The reason under which rejected frames are counted.
    pub fn reason(self) -> &'static str {
        match self {
            Self::Zero => "zero duration",
            Self::Negative => "negative duration",
            Self::Stale => "stale timestamps",
            Self::LongerThanWall => "longer than the wall clock",
            Self::NoPass => "no pass",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} ({} ns)", self.stage, self.kind.reason(), self.ns)
    }
}

/// Begin and end of a pass, in ticks.
type Ticks = [u64; 2];

/// Runs frames, timed and untimed.
pub struct FrameTimer {
    plan: ClockPlan,
    period_ns: f64,
    max_passes: u32,
    queries: Option<Queries>,
    recorder: Recorder,
    spans: Vec<Span>,
    /// Of the frame's timestamped passes, in order.
    ticks: Vec<Ticks>,
    /// Those of the frame before.
    previous: Vec<Ticks>,
}

/// Timestamp queries and the buffers they are resolved to.
struct Queries {
    sets: Vec<wgpu::QuerySet>,
    resolved: wgpu::Buffer,
    read_back: wgpu::Buffer,
}

impl FrameTimer {
    /// A timer for frames of at most `max_passes` passes on the timestamp clock.
    pub fn new(gpu: &Gpu, plan: ClockPlan, max_passes: u32) -> Result<Self, GpuError> {
        let kinds = [PassKind::Compute, PassKind::Render, PassKind::Copy];
        let timestamps = kinds
            .iter()
            .any(|kind| plan.clock(*kind) == Clock::Timestamp);
        let queries = match timestamps && max_passes > 0 {
            true => Some(Queries::new(gpu, max_passes)?),
            false => None,
        };
        Ok(Self {
            plan,
            period_ns: f64::from(gpu.queue.get_timestamp_period()),
            max_passes,
            queries,
            recorder: Recorder::default(),
            spans: Vec::new(),
            ticks: Vec::new(),
            previous: Vec::new(),
        })
    }

    /// Runs one frame with every stage timed.
    pub fn timed(&mut self, gpu: &Gpu, stages: &[&dyn Encode]) -> Result<FrameSample, GpuError> {
        gpu.scoped(|| {
            let sets = self
                .queries
                .as_ref()
                .map_or(&[][..], |queries| &queries.sets);
            let mode = Mode::Timed {
                plan: &self.plan,
                sets,
                max_passes: self.max_passes,
            };
            self.recorder.record(gpu, mode, stages)?;
            self.recorder.run_segments(gpu, &mut self.spans)?;
            self.read_ticks(gpu)
        })?;
        Ok(self.evaluate(stages))
    }

    /// Runs one frame in one submission with nothing timed within. Returns the wall time from the
    /// submission to the fence and the host stages, in ns.
    pub fn untimed(&mut self, gpu: &Gpu, stages: &[&dyn Encode]) -> Result<f64, GpuError> {
        gpu.scoped(|| {
            self.recorder.record(gpu, Mode::Untimed, stages)?;
            self.recorder.run(gpu)
        })
    }

    /// Reads the frame's timestamps, in a submission after the frame's own.
    fn read_ticks(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        std::mem::swap(&mut self.ticks, &mut self.previous);
        self.ticks.clear();
        match &self.queries {
            Some(queries) if self.recorder.queries > 0 => {
                queries.read(gpu, self.recorder.queries, &mut self.ticks)
            }
            _ => Ok(()),
        }
    }

    fn evaluate(&self, stages: &[&dyn Encode]) -> FrameSample {
        let mut account = Account::new(stages);
        for work in &self.recorder.host {
            account.add(work.stage, Clock::Host, Ok(work.ns));
        }
        for (index, span) in self.spans.iter().enumerate() {
            if let Some(before) = index.checked_sub(1).map(|before| &self.spans[before]) {
                account.gaps_ns += ns_between(before.fence, span.submit);
            }
            account.gaps_ns += self.submit_cost_ns(span);
            match span.fenced {
                true => self.add_fenced(&mut account, span),
                false => self.add_timestamped(&mut account, span),
            }
        }
        let gpu_ns = match (self.spans.first(), self.spans.last()) {
            (Some(first), Some(last)) => ns_between(first.submit, last.fence),
            _ => 0.0,
        };
        account.finish(gpu_ns + self.recorder.host_ns())
    }

    /// That of the segment's first pass.
    fn submit_cost_ns(&self, span: &Span) -> f64 {
        let first = self.recorder.passes[span.passes.clone()].first();
        first.map_or(0.0, |pass| self.plan.submit_cost.of(pass.kind))
    }

    fn add_fenced(&self, account: &mut Account, span: &Span) {
        let ns = span.wall_ns() - self.submit_cost_ns(span);
        for pass in &self.recorder.passes[span.passes.clone()] {
            account.add(pass.stage, Clock::FencedHost, positive(ns));
        }
    }

    fn add_timestamped(&self, account: &mut Account, span: &Span) {
        let wall_ns = span.wall_ns();
        let mut last_end = None;
        for pass in &self.recorder.passes[span.passes.clone()] {
            let Some(query) = pass.query.map(|query| query as usize) else {
                continue;
            };
            let ticks = self.ticks[query];
            let ns = check(ticks, self.previous.get(query), self.period_ns, wall_ns);
            account.add(pass.stage, Clock::Timestamp, ns);
            if let Some(end) = last_end {
                account.gaps_ns += signed_ticks(end, ticks[0]) * self.period_ns;
            }
            last_end = Some(ticks[1]);
        }
    }
}

/// Ticks from `begin` to `end`, negative where they are out of order.
fn signed_ticks(begin: u64, end: u64) -> f64 {
    end.wrapping_sub(begin) as i64 as f64
}

/// A host duration that is more than nothing.
fn positive(ns: f64) -> Result<f64, (FaultKind, f64)> {
    match ns {
        ns if ns > 0.0 => Ok(ns),
        ns if ns < 0.0 => Err((FaultKind::Negative, ns)),
        ns => Err((FaultKind::Zero, ns)),
    }
}

/// The duration between two timestamps in ns, or why it cannot be true.
fn check(
    ticks: Ticks,
    previous: Option<&Ticks>,
    period_ns: f64,
    wall_ns: f64,
) -> Result<f64, (FaultKind, f64)> {
    let ns = positive(signed_ticks(ticks[0], ticks[1]) * period_ns)?;
    if previous == Some(&ticks) {
        return Err((FaultKind::Stale, ns));
    }
    if ns > wall_ns * WALL_TOLERANCE {
        return Err((FaultKind::LongerThanWall, ns));
    }
    Ok(ns)
}

/// The sum of a frame's durations as it is drawn up.
struct Account {
    stages: Vec<StageSample>,
    passes: Vec<u32>,
    gaps_ns: f64,
    faults: Vec<Fault>,
}

impl Account {
    fn new(stages: &[&dyn Encode]) -> Self {
        let empty = |stage: &&dyn Encode| StageSample {
            name: stage.name(),
            clock: Clock::Host,
            ns: 0.0,
        };
        Self {
            stages: stages.iter().map(empty).collect(),
            passes: vec![0; stages.len()],
            gaps_ns: 0.0,
            faults: Vec::new(),
        }
    }

    fn add(&mut self, stage: usize, clock: Clock, duration: Result<f64, (FaultKind, f64)>) {
        let sample = &mut self.stages[stage];
        sample.clock = match (self.passes[stage], sample.clock, clock) {
            (0, _, clock) => clock,
            (_, Clock::Host, clock) | (_, clock, Clock::Host) => clock,
            (_, Clock::Timestamp, Clock::Timestamp) => Clock::Timestamp,
            _ => Clock::FencedHost,
        };
        self.passes[stage] += 1;
        match duration {
            Ok(ns) => sample.ns += ns,
            Err((kind, ns)) => {
                sample.ns = f64::NAN;
                self.faults.push(Fault {
                    stage: sample.name,
                    kind,
                    ns,
                });
            }
        }
    }

    fn finish(mut self, envelope_ns: f64) -> FrameSample {
        for (sample, passes) in self.stages.iter_mut().zip(&self.passes) {
            if *passes == 0 {
                sample.ns = f64::NAN;
                self.faults.push(Fault {
                    stage: sample.name,
                    kind: FaultKind::NoPass,
                    ns: 0.0,
                });
            }
        }
        FrameSample {
            stages: self.stages,
            gaps_ns: self.gaps_ns,
            envelope_ns,
            wall_ns: envelope_ns,
            faults: self.faults,
        }
    }
}

impl Queries {
    fn new(gpu: &Gpu, max_passes: u32) -> Result<Self, GpuError> {
        let count = max_passes * QUERIES_PER_PASS;
        let bytes = u64::from(count.next_multiple_of(QUERIES_PER_SET)) * TICK_BYTES;
        let set = |first: u32| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: (count - first).min(QUERIES_PER_SET),
            })
        };
        let buffer = |label, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes,
                usage,
                mapped_at_creation: false,
            })
        };
        use wgpu::BufferUsages as Usage;
        gpu.scoped(|| {
            Ok(Self {
                sets: (0..count)
                    .step_by(QUERIES_PER_SET as usize)
                    .map(set)
                    .collect(),
                resolved: buffer("ticks", Usage::QUERY_RESOLVE | Usage::COPY_SRC),
                read_back: buffer("ticks read back", Usage::MAP_READ | Usage::COPY_DST),
            })
        })
    }

    /// Appends the ticks of the first `passes` passes.
    fn read(&self, gpu: &Gpu, passes: u32, ticks: &mut Vec<Ticks>) -> Result<(), GpuError> {
        let count = passes * QUERIES_PER_PASS;
        let bytes = u64::from(count) * TICK_BYTES;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        for (index, set) in self.sets.iter().enumerate() {
            let first = index as u32 * QUERIES_PER_SET;
            if first < count {
                let here = (count - first).min(QUERIES_PER_SET);
                let offset = u64::from(first) * TICK_BYTES;
                encoder.resolve_query_set(set, 0..here, &self.resolved, offset);
            }
        }
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read_back, 0, bytes);
        gpu.queue.submit([encoder.finish()]);
        map(gpu, &self.read_back, bytes, |raw| {
            let tick = |raw: &[u8]| u64::from_le_bytes(std::array::from_fn(|byte| raw[byte]));
            let pair = |raw: &[u8]| [tick(&raw[..8]), tick(&raw[8..])];
            ticks.extend(raw.chunks_exact(16).map(pair));
        })
    }
}
