//! The GPU layer: adapter and device, shader linking, the adapter's limits and read-back. The audited clock and the timed frames
//! are those of [`fathom_clock`].
//!
//! Nothing here panics on a fault of the device: validation errors, exhausted memory and a lost device
//! come back as [`GpuError`] from the call that caused them.

mod adapter;
mod capacity;
mod ceilings;
mod error;
pub mod kit;
mod layout;
mod limits;
mod loops;
mod mask;
mod pipelines;
mod readback;
mod shader;
mod stage;

pub use adapter::{AdapterEntry, Gpu, Options};
pub use capacity::Capacity;
pub use ceilings::{Pacer, Waker, ceilings, limits, measure};
pub use error::GpuError;
pub use fathom_clock::{
    Audit, ClockPlan, ColorTarget, CostMeter, DepthTarget, DeviceError, Drawing, EncodeCost,
    FrameSample, FrameTimer, HostClock, HostTime, MachineReader, RejectedTime, StageClock,
    StageCounters, StageScope, SubmitCost, Targets, TimedStage, audit, audit_all, audit_cpu_time,
    audit_table, count,
};
#[doc(hidden)]
pub use inventory;
pub use layout::{Binding, BindingKind};
pub use limits::Demand;
pub use loops::{MAX_ITERATIONS, describe_loop_turns, measure_loop_turns};
pub use pipelines::CodeKey;
pub use readback::{Pixels, Texels, read_buffer, read_texture, read_volume, texture_bytes};
pub use shader::{Shader, default_defs, link, shader_paths, sources, text};
pub use stage::{Column, OutputData, ReadRow, Stage, StageDump, StageInfo, stages_before};
