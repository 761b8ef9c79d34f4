//! Frames and their timing.
//!
//! A stage opens passes only through its [`StageScope`], which writes the timestamps, so every pass is timed. The whole frame is
//! encoded before the first submission, so neither stages nor gaps contain the CPU time of encoding.
//!
//! Passes of a kind with sound timestamps share a command buffer with their neighbours. A pass on the fenced host clock has a command
//! buffer of its own, which is submitted alone and waited for, between two readings of the host clock. The cost of a submission is
//! subtracted; it is measured between the segments of the same frame (see `meter`). The command buffers of a frame are its *segments*.
//! Each is submitted when the one before has finished. A call that submits by itself is run while the frame is encoded, and waited for: it
//! counts as a host stage whose time is fenced.
//!
//! Accounting: the *envelope* is the host time from the first submission to the last fence, plus the host stages. *Gaps* are the time
//! between passes of a segment by timestamps, the time between segments by the host clock, and one submission cost per
//! segment. Commands of a caller's encoder beside its timed passes belong to the gaps. Stages + gaps = envelope then holds only if timestamps and host clock agree.

#[cfg(test)]
pub(crate) mod clock_fault;
mod encoder;
mod host_clock;
mod meter;
mod probe;
mod scope;
mod stage;
mod targets;
pub(crate) mod timer;

pub use host_clock::HostClock;
pub use meter::CostMeter;
pub(super) use probe::Probe;
pub(super) use scope::{FrameMode, Query, Recorder};
pub use scope::{HostTime, StageScope};
pub use stage::{StageTime, TimedStage};
pub use targets::{ColorTarget, DepthTarget, Targets};
pub use timer::{EncodeCost, FrameSample, FrameTimer, RejectedTime};
