//! Frames whose passes are opened in an encoder of the caller.

use super::host_clock::HostClock;
use super::scope::{FrameMode, HostWork, Query};
use super::timer::{FrameSample, FrameTimer};
use crate::{Device, DeviceError};
use fathom_record::PassKind;

/// What a call submits by itself is not known. The cost of a submission is taken to be that of the smallest compute pass, as vello's and
/// burn's passes compute.
pub(super) const SUBMISSION: PassKind = PassKind::Compute;

impl FrameTimer {
    /// Begins a frame. What was opened of another is forgotten.
    pub(crate) fn begin(&mut self) {
        self.recorder.reset();
        self.refused = None;
    }

    /// A pass of this kind comes next in the encoder. Where it must be alone in a submission, the encoder is replaced by an
    /// empty one; else the pass has timestamps.
    pub(crate) fn open(
        &mut self,
        gpu: &Device,
        encoder: &mut wgpu::CommandEncoder,
        stage: usize,
        kind: PassKind,
    ) -> Option<Query<'_>> {
        self.close(gpu, encoder);
        if self.plan.fences(kind) {
            self.cut(gpu, encoder, false);
        }
        let sets = self.queries.as_ref().map_or(&[][..], |queries| &queries.sets);
        let mode = FrameMode::Timed { plan: &self.plan, sets, max_passes: self.max_passes };
        self.recorder.add(mode, stage, kind)
    }

    /// The pass that was opened last has ended. Where it is alone in a submission, the encoder is replaced.
    pub(crate) fn close(&mut self, gpu: &Device, encoder: &mut wgpu::CommandEncoder) {
        if self.in_fenced_pass() {
            self.cut(gpu, encoder, true);
        }
    }

    /// Ends a command buffer with what the encoder holds; the encoder is empty then. A command that is refused now is an error
    /// of the frame.
    fn cut(&mut self, gpu: &Device, encoder: &mut wgpu::CommandEncoder, fenced: bool) {
        let ended = gpu.catch(|| {
            let next = gpu.device.create_command_encoder(&Default::default());
            self.recorder.push(std::mem::replace(encoder, next), fenced);
            Ok(())
        });
        self.refused = self.refused.take().or(ended.err());
    }

    fn in_fenced_pass(&self) -> bool {
        let last = self.recorder.passes.last().filter(|_| self.recorder.has_open_passes());
        last.is_some_and(|pass| self.plan.fences(pass.kind))
    }

    /// Runs a call that submits by itself, from an idle device until the device is idle again. Where it fails, so does the frame.
    pub(crate) fn run_submission<R>(
        &mut self,
        gpu: &Device,
        stage: usize,
        f: impl FnOnce() -> R,
    ) -> Result<R, DeviceError> {
        let ran = gpu.catch(|| {
            gpu.flush()?;
            self.metering.probe(gpu, SUBMISSION)?;
            let clock = HostClock::from_plan(&self.plan);
            let start_ns = clock.now_ns();
            let result = f();
            gpu.wait()?;
            let ns = clock.now_ns() - start_ns;
            self.recorder.host.push(HostWork { stage, ns, submits: true });
            Ok(result)
        });
        if ran.is_err() {
            self.refused = Some(DeviceError::Validation("a submission of this frame".to_owned()));
        }
        ran
    }

    /// Runs the frame, of which the encoder holds the rest. Its stages have these names.
    pub(crate) fn run_timed(
        &mut self,
        gpu: &Device,
        encoder: wgpu::CommandEncoder,
        names: &[&'static str],
    ) -> Result<FrameSample, DeviceError> {
        self.refused.take().map_or(Ok(()), Err)?;
        gpu.catch(|| {
            let fenced = self.in_fenced_pass();
            self.recorder.push(encoder, fenced);
            self.recorder.check()?;
            gpu.flush()?;
            self.run_segments(gpu)
        })?;
        Ok(self.evaluate(names))
    }

    /// Runs the encoder's commands in one submission; the time in ns by the plan's host clock.
    pub(crate) fn run_untimed(
        &mut self,
        gpu: &Device,
        encoder: wgpu::CommandEncoder,
    ) -> Result<f64, DeviceError> {
        self.refused.take().map_or(Ok(()), Err)?;
        gpu.catch(|| {
            self.recorder.push(encoder, false);
            gpu.flush()?;
            Ok(self.recorder.run(gpu)?.time_ns(HostClock::from_plan(&self.plan)))
        })
    }
}
