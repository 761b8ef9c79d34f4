//! The clock of one program: which frame is timed next, what is sampled, and the records of it.

mod pass;
mod records;
mod told;

pub use pass::TimedPass;

use std::time::Instant;

use super::{
    Audit, ClockError, FrameSample, FrameTimer, MachineReader, Samples, Stopped, WarmUp,
    WatchedDevice, audit, fault, frame_pair,
};
use fathom_record::{Addition, Cell, PassKind};

/// Features of the device that timestamps need.
const FEATURES: wgpu::Features =
    wgpu::Features::TIMESTAMP_QUERY.union(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);
/// Passes of a frame that can have timestamps.
const MOST_PASSES: u32 = 1024;
/// Pairs of frames at the first look at their precision, and at the last: as fathom's own runs.
const LEAST_PAIRS: usize = 12;
const MOST_PAIRS: usize = 192;

/// The features of this adapter that timestamps need, for `required_features` of the device. Without them every pass is timed by a
/// fenced host clock.
pub fn features(adapter: &wgpu::Adapter) -> wgpu::Features {
    adapter.features() & FEATURES
}

/// When a cell has enough samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Half the width of the frame time's 95 % interval over its median.
    pub precision: f64,
    /// Seconds after which no more frames are asked for, once there are 12 pairs.
    pub budget_s: f64,
}

impl Default for Sampling {
    /// 2 %, 30 s.
    fn default() -> Self {
        Self { precision: 0.02, budget_s: 30.0 }
    }
}

/// An audited clock around the frames of a program, and what was sampled of them.
///
/// Frames with per-pass timing alternate with frames without: the second give the frame time, and both together what timing costs.
/// Both wait for the GPU, so frames do not overlap.
pub struct FrameClock {
    gpu: WatchedDevice,
    audit: Audit,
    timer: FrameTimer,
    machine: Option<MachineReader>,
    sampling: Sampling,
    current: Sampled,
    cells: Vec<Cell>,
    totals: Totals,
    /// Number of the next pair of frames of the run.
    round: u32,
}

/// Times of the whole run.
struct Totals {
    started_at: String,
    begun: Instant,
    audit_s: f64,
    frames_ns: f64,
}

/// What was sampled since the last cell ended.
struct Sampled {
    samples: Samples,
    warm_up: WarmUp,
    timed: Option<FrameSample>,
    untimed_ns: Option<f64>,
    begun: Instant,
    /// Pairs at which the precision is looked at next.
    target: usize,
}

impl Sampled {
    fn begin() -> Self {
        Self {
            samples: Samples { stopped: Stopped::Interrupted, ..Samples::default() },
            warm_up: WarmUp::default(),
            timed: None,
            untimed_ns: None,
            begun: Instant::now(),
            target: LEAST_PAIRS,
        }
    }
}

impl FrameClock {
    /// Audits the timestamps of this adapter, which takes a second, and some seconds on a software adapter.
    ///
    /// # Errors
    /// A fault of the device.
    pub fn new(
        adapter: &wgpu::Adapter,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
    ) -> Result<Self, ClockError> {
        let (started_at, begun) = (fathom_record::calendar::now(), Instant::now());
        let gpu = WatchedDevice::new(adapter, device.clone(), queue.clone());
        let audit = audit(&gpu)?;
        let timer = FrameTimer::new(&gpu, audit.plan, MOST_PASSES)?;
        let audit_s = begun.elapsed().as_secs_f64();
        Ok(Self {
            machine: MachineReader::open(&gpu.adapter),
            gpu,
            audit,
            timer,
            sampling: Sampling::default(),
            current: Sampled::begin(),
            cells: Vec::new(),
            totals: Totals { started_at, begun, audit_s, frames_ns: 0.0 },
            round: 0,
        })
    }

    /// The same with another precision or budget.
    #[must_use]
    pub fn with(mut self, sampling: Sampling) -> Self {
        self.sampling = sampling;
        self
    }

    /// Which clock times which kind of pass, and why.
    pub fn audit(&self) -> &Audit {
        &self.audit
    }

    /// More frames are needed: fewer than 12 pairs were sampled, or the frame time is not precise yet and there is time. Frames
    /// rendered beyond that are sampled as well.
    pub fn wants_frame(&mut self) -> bool {
        let Sampled { samples, begun, target, .. } = &mut self.current;
        let pairs = samples.pairs();
        let late = begun.elapsed().as_secs_f64() > self.sampling.budget_s;
        if samples.verdict_on_rejections().is_some() {
            return false;
        }
        if pairs < LEAST_PAIRS || !late && pairs < *target {
            return true;
        }
        let precise = samples.relative_half_width() <= self.sampling.precision;
        samples.stopped = match (precise, late) {
            (true, _) => Stopped::Precise,
            (_, true) => Stopped::OutOfTime,
            _ if pairs >= MOST_PAIRS => Stopped::EnoughPairs,
            _ => {
                *target *= 2;
                return true;
            }
        };
        false
    }

    /// Begins a frame. It ends with [`Frame::submit`].
    pub fn frame(&mut self) -> Frame<'_> {
        self.timer.begin();
        let timed = self.times_next();
        Frame { clock: self, timed, names: Vec::new() }
    }

    /// The kind of frame that a pair begins with is that of a Thue–Morse sequence, so that a steady drift favours neither.
    fn times_next(&self) -> bool {
        let Sampled { warm_up, timed, untimed_ns, .. } = &self.current;
        if !warm_up.is_over() {
            return warm_up.is_timed();
        }
        match (timed, untimed_ns) {
            (None, None) => self.round.count_ones().is_multiple_of(2),
            (timed, _) => timed.is_none(),
        }
    }

    fn add(&mut self, timed: Option<FrameSample>, wall_ns: f64) {
        self.totals.frames_ns += wall_ns;
        let Sampled { samples, warm_up, timed: of_pair, untimed_ns, .. } = &mut self.current;
        if !warm_up.is_over() {
            warm_up.add(wall_ns);
            if warm_up.is_over() {
                samples.warm_up_frames = warm_up.frames();
                samples.unsteady = !warm_up.is_steady();
            }
            return;
        }
        match timed {
            Some(frame) => *of_pair = Some(frame),
            None => *untimed_ns = Some(wall_ns),
        }
        if let (Some(frame), Some(ns)) = (&*of_pair, *untimed_ns) {
            let rejected = fault(frame, ns, &samples.stages);
            let mut pair = frame_pair(frame, ns, (self.round, records::unix_s()));
            pair.machine = self.machine.as_ref().and_then(MachineReader::read);
            let pair = rejected.is_none().then_some(pair);
            samples.add(&Addition { rejected, pair, ..Addition::default() });
            (*of_pair, *untimed_ns) = (None, None);
            self.round += 1;
        }
    }
}

/// One frame of a program. Its passes are opened in the program's own encoder.
///
/// A name stands for the time of all passes that bear it in a frame. Every frame opens the same names in the same order.
pub struct Frame<'a> {
    clock: &'a mut FrameClock,
    timed: bool,
    names: Vec<&'static str>,
}

impl Frame<'_> {
    /// A compute pass of this name, in place of [`wgpu::CommandEncoder::begin_compute_pass`]. The encoder may be replaced by an
    /// empty one where the pass must be alone in a submission.
    pub fn compute_pass<'f>(
        &'f mut self,
        encoder: &'f mut wgpu::CommandEncoder,
        name: &'static str,
        descriptor: &wgpu::ComputePassDescriptor<'_>,
    ) -> TimedPass<'f, wgpu::ComputePass<'static>> {
        let timestamp_writes = self.compute(encoder, name);
        let descriptor = wgpu::ComputePassDescriptor { timestamp_writes, ..descriptor.clone() };
        let pass = encoder.begin_compute_pass(&descriptor).forget_lifetime();
        self.guard(encoder, pass)
    }

    /// A render pass of this name, in place of [`wgpu::CommandEncoder::begin_render_pass`]; see [`Self::compute_pass`].
    pub fn render_pass<'f>(
        &'f mut self,
        encoder: &'f mut wgpu::CommandEncoder,
        name: &'static str,
        descriptor: &wgpu::RenderPassDescriptor<'_>,
    ) -> TimedPass<'f, wgpu::RenderPass<'static>> {
        let timestamp_writes = self.render(encoder, name);
        let descriptor = wgpu::RenderPassDescriptor { timestamp_writes, ..descriptor.clone() };
        let pass = encoder.begin_render_pass(&descriptor).forget_lifetime();
        self.guard(encoder, pass)
    }

    /// Copies and clears under this name. `f` must not open passes.
    pub fn copies(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
        f: impl FnOnce(&mut wgpu::CommandEncoder),
    ) {
        let query = self.open(encoder, name, PassKind::Copy).map(|(set, at)| (set.clone(), at));
        if let Some((set, first)) = &query {
            encoder.write_timestamp(set, *first);
        }
        f(encoder);
        if let Some((set, first)) = &query {
            encoder.write_timestamp(set, *first + 1);
        }
        drop(self.guard(encoder, ()));
    }

    /// The `timestamp_writes` of a compute pass of this name that the caller opens next in this encoder. Where the pass must be
    /// alone in a submission, what is encoded up to the next call counts as its work.
    pub fn compute(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
    ) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let (query_set, first) = self.open(encoder, name, PassKind::Compute)?;
        Some(wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// The same for a render pass.
    pub fn render(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
    ) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let (query_set, first) = self.open(encoder, name, PassKind::Render)?;
        Some(wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// Submits the encoder's commands in place of [`wgpu::Queue::submit`], waits for them, and samples the frame.
    ///
    /// # Errors
    /// A fault of the device, such as a command that it refused, or more than 1,024 passes with timestamps. The frame is then not
    /// sampled.
    pub fn submit(self, encoder: wgpu::CommandEncoder) -> Result<(), ClockError> {
        let Self { clock, timed, names } = self;
        let FrameClock { gpu, timer, .. } = &mut *clock;
        if timed {
            let frame = timer.run_timed(gpu, encoder, &names)?;
            let envelope_ns = frame.envelope_ns;
            clock.add(Some(frame), envelope_ns);
        } else {
            let wall_ns = timer.run_untimed(gpu, encoder)?;
            clock.add(None, wall_ns);
        }
        Ok(())
    }

    fn open(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
        kind: PassKind,
    ) -> Option<(&wgpu::QuerySet, u32)> {
        if !self.timed {
            return None;
        }
        let known = self.names.iter().position(|known| *known == name);
        let stage = known.unwrap_or_else(|| {
            self.names.push(name);
            self.names.len() - 1
        });
        let FrameClock { gpu, timer, .. } = &mut *self.clock;
        timer.open(gpu, encoder, (stage, kind))
    }

    fn guard<'f, P>(
        &'f mut self,
        encoder: &'f mut wgpu::CommandEncoder,
        pass: P,
    ) -> TimedPass<'f, P> {
        let FrameClock { gpu, timer, .. } = &mut *self.clock;
        TimedPass::new(pass, self.timed.then_some((timer, &*gpu)), encoder)
    }
}
