//! Frames and their timing.
//!
//! A stage opens passes only through the [`StageScope`] it is handed, which puts the timestamps there:
//! nobody can forget to time. The whole frame is encoded before the first submission, so that what the
//! CPU spends on encoding is in neither the stages nor the gaps.
//!
//! A pass whose kind has sound timestamps shares a command buffer with its neighbours. A pass on the
//! fenced host clock has a command buffer to itself, which is submitted alone and waited for, between
//! two readings of the host clock less the cost of a submission, which is measured between the same
//! frame's segments (see `meter`). The command buffers of a frame are its
//! *segments*, each submitted when the one before has finished.
//!
//! Accounting: the *envelope* is the host's time from the first submission to the last fence, and the
//! host stages. *Gaps* are the timestamps' gaps between passes of a segment, the host's gaps between
//! segments, and one submission cost per segment. Stages + gaps = envelope then holds only if the
//! timestamps and the host clock agree.

mod clock;
mod meter;
mod probe;
mod scope;
mod timer;

pub use clock::{ClockPlan, SubmitCost};
#[cfg(test)]
pub(crate) use meter::CostMeter;
pub(super) use probe::Probe;
pub use scope::{ColorTarget, DepthTarget, HostTime, StageScope, Targets};
pub(super) use scope::{Mode, Recorder};
pub use timer::{Fault, FrameSample, FrameTimer, StageSample};
