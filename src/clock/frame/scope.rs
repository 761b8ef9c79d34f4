//! Encodes a frame: the scope through which stages open their passes, and the resulting command buffers.

use super::host_clock::{HostClock, process_ns, thread_ns};
use super::meter::SubmissionMeter;
use super::targets::{Targets, open};
use crate::{Device, DeviceError, TimedStage};
use fathom_record::ceilings::TargetRecord;
use fathom_record::{ClockPlan, PassKind};
use std::ops::Range;

/// WebGPU's largest query set.
pub(super) const QUERIES_PER_SET: u32 = 4096;
/// Begin and end.
pub(super) const QUERIES_PER_PASS: u32 = 2;
/// What a stage opens its passes through.
pub struct StageScope<'a> {
    recorder: &'a mut Recorder,
    gpu: &'a Device,
    mode: FrameMode<'a>,
    stage: usize,
    iteration: u32,
    name: &'static str,
}

#[derive(Clone, Copy)]
pub(crate) enum FrameMode<'a> {
    /// Each is timed by the plan's clock for its kind.
    Timed { plan: &'a ClockPlan, sets: &'a [wgpu::QuerySet], max_passes: u32 },
    /// All in one command buffer, nothing is timed.
    Untimed,
    /// All in one command buffer, with a pipeline statistics query around each compute and render pass, where the adapter has them.
    Counted { set: Option<&'a wgpu::QuerySet>, max_passes: u32 },
}

impl FrameMode<'_> {
    /// A pass of this kind has a command buffer of its own.
    fn fences(&self, kind: PassKind) -> bool {
        matches!(self, FrameMode::Timed { plan, .. } if plan.fences(kind))
    }
}

pub(crate) struct EncodedPass {
    pub(crate) stage: usize,
    pub(crate) kind: PassKind,
    /// The number of its pair of timestamps, or of its statistics.
    pub(crate) query: Option<u32>,
    /// What it draws into, where passes are counted.
    pub(crate) targets: Vec<TargetRecord>,
}

/// One command buffer of an encoded frame, and which of the frame's passes it holds.
struct CommandSegment {
    commands: wgpu::CommandBuffer,
    passes: Range<usize>,
    fenced: bool,
}

/// Work of the CPU within a frame.
pub(super) struct HostWork {
    pub(super) stage: usize,
    pub(super) ns: f64,
    /// It submits by itself and was waited for.
    pub(super) submits: bool,
}

/// A frame as it is being encoded. Kept from frame to frame for its allocations.
#[derive(Default)]
pub(crate) struct Recorder {
    clock: HostClock,
    encoder: Option<wgpu::CommandEncoder>,
    segments: Vec<CommandSegment>,
    pub(crate) passes: Vec<EncodedPass>,
    pub(super) host: Vec<HostWork>,
    /// Passes before the open encoder's first.
    closed: usize,
    pub(crate) queries: u32,
    /// So many passes can have queries, and the frame needed more.
    overflow: Option<u32>,
}

impl Recorder {
    pub(super) fn new(clock: HostClock) -> Self {
        Self { clock, ..Self::default() }
    }

    /// Encodes a whole frame.
    pub(crate) fn record<S: TimedStage + ?Sized>(
        &mut self,
        gpu: &Device,
        mode: FrameMode<'_>,
        stages: &[&S],
    ) -> Result<(), DeviceError> {
        self.reset();
        for (stage, iteration) in order(stages) {
            let encode = stages[stage];
            let name = encode.name();
            encode.encode(&mut StageScope { recorder: self, gpu, mode, stage, iteration, name });
        }
        self.close(false);
        self.check()
    }

    pub(super) fn reset(&mut self) {
        self.encoder = None;
        self.segments.clear();
        self.passes.clear();
        self.host.clear();
        self.closed = 0;
        self.queries = 0;
        self.overflow = None;
    }

    /// Ends the open command buffer, if there is one.
    fn close(&mut self, fenced: bool) {
        match self.encoder.take() {
            Some(encoder) => self.push(encoder, fenced),
            None => self.closed = self.passes.len(),
        }
    }

    /// Ends a command buffer, which holds the passes since the one before.
    pub(super) fn push(&mut self, encoder: wgpu::CommandEncoder, fenced: bool) {
        let passes = self.closed..self.passes.len();
        self.segments.push(CommandSegment { commands: encoder.finish(), passes, fenced });
        self.closed = self.passes.len();
    }

    /// Passes were opened since the last command buffer ended.
    pub(super) fn has_open_passes(&self) -> bool {
        self.closed < self.passes.len()
    }

    /// Notes a pass, and gives its queries.
    pub(super) fn add<'q>(
        &mut self,
        mode: FrameMode<'q>,
        stage: usize,
        kind: PassKind,
    ) -> Option<Query<'q>> {
        let number = self.take_query(mode, kind);
        self.passes.push(EncodedPass { stage, kind, query: number, targets: Vec::new() });
        number.and_then(|number| match mode {
            FrameMode::Timed { sets, .. } => {
                let index = number * QUERIES_PER_PASS;
                let set = &sets[(index / QUERIES_PER_SET) as usize];
                Some(Query { set, first: index % QUERIES_PER_SET })
            }
            FrameMode::Counted { set, .. } => set.map(|set| Query { set, first: number }),
            FrameMode::Untimed => unreachable!("an untimed pass takes no query"),
        })
    }

    /// The number of the next pass's query, if it has one.
    fn take_query(&mut self, mode: FrameMode<'_>, kind: PassKind) -> Option<u32> {
        let max_passes = match mode {
            FrameMode::Timed { max_passes, .. } if !mode.fences(kind) => max_passes,
            FrameMode::Counted { set: Some(_), max_passes } if kind != PassKind::Copy => max_passes,
            _ => return None,
        };
        if self.queries >= max_passes {
            self.overflow = Some(max_passes);
            return None;
        }
        self.queries += 1;
        Some(self.queries - 1)
    }

    /// Fails where the frame needed more queries than there are.
    pub(super) fn check(&self) -> Result<(), DeviceError> {
        self.overflow.map_or(Ok(()), |max_passes| Err(DeviceError::TooManyPasses(max_passes)))
    }

    /// Submits what the host stages have queued, so that no pass and no gap contains it.
    fn flush_host_writes(&self, gpu: &Device) -> Result<(), DeviceError> {
        if self.host.is_empty() {
            return Ok(());
        }
        gpu.flush()
    }

    pub(super) fn host_ns(&self) -> f64 {
        self.host.iter().map(|work| work.ns).sum()
    }

    /// Submits all segments at once and waits for them.
    pub(crate) fn run(&mut self, gpu: &Device) -> Result<HostTime, DeviceError> {
        self.flush_host_writes(gpu)?;
        let thread_ns_before = thread_ns();
        let before_ns = process_ns();
        let start_ns = HostClock::Wall.now_ns();
        let index = gpu.queue.submit(self.segments.drain(..).map(|segment| segment.commands));
        let submit_ns = thread_ns() - thread_ns_before;
        gpu.wait_for(Some(index))?;
        let wall_ns = HostClock::Wall.now_ns() - start_ns + self.host_ns();
        let spent_ns = |before| process_ns().map(|after| after - before);
        Ok(HostTime {
            wall_ns,
            process_ns: before_ns.and_then(spent_ns).map(|ns| ns + self.host_ns()),
            submit_ns,
        })
    }

    /// Submits the segments one after the other, each waited for. Between them the cost of a submission is measured.
    pub(super) fn run_segments(
        &mut self,
        gpu: &Device,
        metering: &mut SubmissionMeter,
        spans: &mut Vec<PassSpan>,
    ) -> Result<(), DeviceError> {
        self.flush_host_writes(gpu)?;
        spans.clear();
        let kinds = self.segment_kinds();
        metering.begin(&kinds, self.segments.iter().any(|segment| segment.fenced));
        for (segment, kind) in self.segments.drain(..).zip(kinds) {
            let CommandSegment { commands, passes, fenced } = segment;
            let metered_ns = self.clock.now_ns();
            metering.before(gpu, kind)?;
            let submit_ns = self.clock.now_ns();
            let index = gpu.queue.submit([commands]);
            gpu.wait_for(Some(index))?;
            let fence_ns = self.clock.now_ns();
            spans.push(PassSpan { metered_ns, submit_ns, fence_ns, passes, fenced });
        }
        Ok(())
    }

    /// Kind of each segment's first pass.
    fn segment_kinds(&self) -> Vec<PassKind> {
        let first = |segment: &CommandSegment| self.passes[segment.passes.clone()].first();
        let kind = |segment| first(segment).map_or(PassKind::Host, |pass| pass.kind);
        self.segments.iter().map(kind).collect()
    }
}

/// Stages and their iterations in the order in which they are encoded.
fn order<S: TimedStage + ?Sized>(stages: &[&S]) -> Vec<(usize, u32)> {
    let mut order = Vec::new();
    let mut first = 0;
    for group in stages.chunk_by(|a, b| a.iterations() == b.iterations()) {
        let iterations = group[0].iterations();
        let all = first..first + group.len();
        order.extend(
            (0..iterations).flat_map(|iteration| all.clone().map(move |stage| (stage, iteration))),
        );
        first += group.len();
    }
    order
}

/// What an untimed frame took from its submission to its fence, and its host stages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HostTime {
    pub wall_ns: f64,
    /// CPU time of this process, all threads together, without the time that other processes took. Unknown outside Linux.
    pub process_ns: Option<f64>,
    /// What this thread took until the submission returned.
    pub submit_ns: f64,
}

impl HostTime {
    pub fn time_ns(self, clock: HostClock) -> f64 {
        match clock {
            HostClock::Wall => self.wall_ns,
            HostClock::ProcessCpu => self.process_ns.unwrap_or(self.wall_ns),
        }
    }
}

/// When a segment ran, by the host clock.
pub(super) struct PassSpan {
    /// From here to `submit_ns` the cost of a submission was measured. That time is not part of the frame.
    pub(super) metered_ns: f64,
    pub(super) submit_ns: f64,
    pub(super) fence_ns: f64,
    pub(super) passes: Range<usize>,
    pub(super) fenced: bool,
}

impl PassSpan {
    pub(super) fn wall_ns(&self) -> f64 {
        self.fence_ns - self.submit_ns
    }

    pub(super) fn metering_ns(&self) -> f64 {
        self.submit_ns - self.metered_ns
    }
}

/// The query that times or counts a pass.
#[derive(Clone, Copy)]
pub(crate) struct Query<'a> {
    pub(crate) set: &'a wgpu::QuerySet,
    pub(crate) first: u32,
}

impl<'a> Query<'a> {
    /// Timestamps of a compute pass.
    pub(crate) fn of_compute(self) -> wgpu::ComputePassTimestampWrites<'a> {
        wgpu::ComputePassTimestampWrites {
            query_set: self.set,
            beginning_of_pass_write_index: Some(self.first),
            end_of_pass_write_index: Some(self.first + 1),
        }
    }

    /// Timestamps of a render pass that is the first of a series, the last, or both.
    pub(crate) fn of_render(self, first: bool, last: bool) -> wgpu::RenderPassTimestampWrites<'a> {
        wgpu::RenderPassTimestampWrites {
            query_set: self.set,
            beginning_of_pass_write_index: first.then_some(self.first),
            end_of_pass_write_index: last.then_some(self.first + 1),
        }
    }
}

impl<'a> StageScope<'a> {
    /// Index of this [iteration](TimedStage::iterations) of the stage.
    pub fn iteration(&self) -> u32 {
        self.iteration
    }

    /// A compute pass.
    pub fn compute(&mut self, f: impl FnOnce(&mut wgpu::ComputePass<'_>)) {
        let label = Some(self.name);
        let (encoder, [timestamps, statistics]) = self.begin(PassKind::Compute);
        let timestamp_writes = timestamps.map(Query::of_compute);
        let descriptor = wgpu::ComputePassDescriptor { label, timestamp_writes };
        let mut pass = encoder.begin_compute_pass(&descriptor);
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
        let mut f = Some(f);
        self.render_series(std::slice::from_ref(targets), |_, pass| {
            if let Some(f) = f.take() {
                f(pass);
            }
        });
    }

    /// Render passes one after the other, timed as one: from the beginning of the first to the end of the last. Invocations are
    /// counted pass by pass. `f` is given each pass's place in the list.
    pub fn render_series(
        &mut self,
        passes: &[Targets<'_>],
        mut f: impl FnMut(usize, &mut wgpu::RenderPass<'_>),
    ) {
        let name = self.name;
        let counted = matches!(self.mode, FrameMode::Counted { .. });
        let at_once = if counted { 1 } else { passes.len().max(1) };
        for (series, begin) in passes.chunks(at_once).zip((0..).step_by(at_once)) {
            let (encoder, [timestamps, statistics]) = self.begin(PassKind::Render);
            for (place, targets) in series.iter().enumerate() {
                let (first, last) = (place == 0, place + 1 == series.len());
                let timestamps = timestamps.filter(|_| first || last);
                let timestamps = timestamps.map(|query| query.of_render(first, last));
                let mut pass = open(encoder, name, targets, timestamps);
                if let Some(Query { set, first }) = statistics {
                    pass.begin_pipeline_statistics_query(set, first);
                }
                f(begin + place, &mut pass);
                if statistics.is_some() {
                    pass.end_pipeline_statistics_query();
                }
            }
            self.end(PassKind::Render);
            let pass = self.recorder.passes.last_mut().filter(|_| counted);
            pass.into_iter().for_each(|pass| pass.targets = series[0].records());
        }
    }

    /// Copies and clears. `f` must not open passes of its own: they would count as copying.
    pub fn copy(&mut self, f: impl FnOnce(&mut wgpu::CommandEncoder)) {
        let (encoder, [timestamps, _]) = self.begin(PassKind::Copy);
        if let Some(Query { set, first }) = timestamps {
            encoder.write_timestamp(set, first);
        }
        f(encoder);
        if let Some(Query { set, first }) = timestamps {
            encoder.write_timestamp(set, first + 1);
        }
        self.end(PassKind::Copy);
    }

    /// Work of the CPU, such as writing uniforms, timed by the host clock. As always with wgpu, buffers are written before the
    /// frame's first pass, whatever the order of the stages.
    pub fn host(&mut self, f: impl FnOnce(&wgpu::Queue)) {
        let clock = self.recorder.clock;
        let start_ns = clock.now_ns();
        f(&self.gpu.queue);
        let ns = clock.now_ns() - start_ns;
        self.recorder.host.push(HostWork { stage: self.stage, ns, submits: false });
    }

    /// Records a pass, and returns the encoder to open it in and its queries: of timestamps, and of statistics.
    fn begin(&mut self, kind: PassKind) -> (&mut wgpu::CommandEncoder, [Option<Query<'a>>; 2]) {
        if self.mode.fences(kind) {
            self.recorder.close(false);
        }
        let query = self.recorder.add(self.mode, self.stage, kind);
        let counted = matches!(self.mode, FrameMode::Counted { .. });
        let queries = if counted { [None, query] } else { [query, None] };
        let encoder = self.recorder.encoder.get_or_insert_with(|| {
            self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
        });
        (encoder, queries)
    }

    fn end(&mut self, kind: PassKind) {
        if self.mode.fences(kind) {
            self.recorder.close(true);
        }
    }
}
