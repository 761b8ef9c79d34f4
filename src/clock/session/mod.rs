//! The clock of one program: which frame is timed next, what is sampled, and the records of it.

mod display;
mod pass;
mod records;
mod sampled;
#[cfg(test)]
mod tests;

pub use pass::TimedPass;

use std::time::Instant;

use self::sampled::{CellSampling, Sample, unix_s};
use super::frame::Query;
use super::{Audit, ClockError, Device, DeviceError, FrameTimer, MachineReader, audit_all};
use fathom_record::{Cell, PassKind};

/// Features of the device that timestamps need.
pub(super) const FEATURES: wgpu::Features =
    wgpu::Features::TIMESTAMP_QUERY.union(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);
/// Time for a cell, seconds: nine visits.
const BUDGET_S: f64 = 90.0;
/// Passes of a frame that can have timestamps.
const MAX_PASSES: u32 = 1024;

/// The features of this adapter that timestamps need, for `required_features` of the device. Without them every pass is timed by a
/// fenced host clock.
pub fn features(adapter: &wgpu::Adapter) -> wgpu::Features {
    adapter.features() & FEATURES
}

/// An audited clock around the frames of a program, and what was sampled of them.
///
/// Frames with per-pass timing alternate with frames without: the second give the frame time, and both together what timing costs.
/// Both wait for the GPU, so frames do not overlap.
pub struct FrameClock {
    gpu: Device,
    audit: Audit,
    timer: FrameTimer,
    machine: Option<MachineReader>,
    /// For each cell, seconds.
    budget_s: f64,
    sampled: CellSampling,
    /// When the current cell began.
    started: Instant,
    cells: Vec<Cell>,
    totals: Totals,
}

/// Times of the whole run.
struct Totals {
    started_at: String,
    started: Instant,
    audit_s: f64,
    frames_ns: f64,
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
        let gpu = Device::new(adapter, device.clone(), queue.clone());
        Self::audited(gpu, audit_all)
    }

    fn audited(
        gpu: Device,
        audit: impl FnOnce(&Device) -> Result<Audit, DeviceError>,
    ) -> Result<Self, ClockError> {
        let (started_at, started) = (fathom_record::calendar::now(), Instant::now());
        let audit = audit(&gpu)?;
        let timer = FrameTimer::new(&gpu, audit.plan, MAX_PASSES)?;
        let audit_s = started.elapsed().as_secs_f64();
        Ok(Self {
            machine: MachineReader::open(&gpu.adapter),
            gpu,
            audit,
            timer,
            budget_s: BUDGET_S,
            sampled: CellSampling::begin(0),
            started: Instant::now(),
            cells: Vec::new(),
            totals: Totals { started_at, started, audit_s, frames_ns: 0.0 },
        })
    }

    /// The same with another time for each cell than 90 s. Frames within 10 s are one visit: below four visits figures have no interval, and
    /// one of visits within less than 60 s is of these seconds alone.
    #[must_use]
    pub fn with_budget(mut self, seconds: f64) -> Self {
        self.budget_s = seconds.max(0.0);
        self
    }

    /// Which clock times which kind of pass, and why.
    pub fn audit(&self) -> &Audit {
        &self.audit
    }

    /// More frames are needed: there is time, or no pair was sampled. Of each ten seconds 12 pairs are sampled, and other frames are
    /// rendered without per-pass timing.
    pub fn wants_frame(&self) -> bool {
        self.sampled.wants_frame(self.started.elapsed().as_secs_f64() > self.budget_s)
    }

    /// Begins a frame. It ends with [`Frame::submit`].
    pub fn frame(&mut self) -> Frame<'_> {
        self.timer.begin();
        let timed = self.sampled.times_next(unix_s());
        Frame { clock: self, timed, names: Vec::new() }
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
        let query = self.open(encoder, name, PassKind::Copy);
        if let Some(Query { set, first }) = query {
            encoder.write_timestamp(set, first);
        }
        f(encoder);
        if let Some(Query { set, first }) = query {
            encoder.write_timestamp(set, first + 1);
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
        self.open(encoder, name, PassKind::Compute).map(Query::of_compute)
    }

    /// The same for a render pass.
    pub fn render(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
    ) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        self.open(encoder, name, PassKind::Render).map(|query| query.of_render(true, true))
    }

    /// Times a call that records and submits by itself, to the clock's device and queue, as vello, burn and egui do. The time is that
    /// of the host clock, from an idle device until the device is idle again, less the cost of one submission. It contains what
    /// `f` does on the CPU, and the cost of further submissions. `f` must have submitted all its work when it returns. In a
    /// frame without per-pass timing it is waited for too.
    ///
    /// `f` runs at once, as it would without a clock: before the commands of the frame's encoder, whatever was opened there before.
    /// A frame of nothing else ends with an empty encoder. A call that submits nothing is below the clock's resolution, unless the CPU takes
    /// longer than that.
    ///
    /// # Errors
    /// A fault of the device, such as a command of `f` that it refused. [`Self::submit`] then fails as well. What `f` returns is not
    /// looked at: a frame that is dropped is not sampled.
    pub fn submission<R>(
        &mut self,
        name: &'static str,
        f: impl FnOnce() -> R,
    ) -> Result<R, ClockError> {
        let stage = self.stage(name);
        let FrameClock { gpu, timer, .. } = &mut *self.clock;
        Ok(timer.run_submission(gpu, stage, f)?)
    }

    /// Submits the encoder's commands in place of [`wgpu::Queue::submit`], waits for them, and samples the frame.
    ///
    /// # Errors
    /// A fault of the device, such as a command that it refused, or more than 1,024 passes with timestamps. The frame is then not
    /// sampled.
    pub fn submit(self, encoder: wgpu::CommandEncoder) -> Result<(), ClockError> {
        let Self { clock, timed, names } = self;
        let FrameClock { gpu, timer, machine, sampled, totals, .. } = clock;
        let state = || machine.as_ref().and_then(MachineReader::read);
        let ran = match timed {
            true => Sample::Timed(timer.run_timed(gpu, encoder, &names)?),
            false => Sample::Untimed(timer.run_untimed(gpu, encoder)?),
        };
        totals.frames_ns += sampled.add(ran, unix_s(), state);
        Ok(())
    }

    fn open(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
        kind: PassKind,
    ) -> Option<Query<'_>> {
        if !self.timed {
            return None;
        }
        let stage = self.stage(name);
        let FrameClock { gpu, timer, .. } = &mut *self.clock;
        timer.open(gpu, encoder, stage, kind)
    }

    /// The place of this name among those of the frame.
    fn stage(&mut self, name: &'static str) -> usize {
        let known = self.names.iter().position(|known| *known == name);
        known.unwrap_or_else(|| {
            self.names.push(name);
            self.names.len() - 1
        })
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
