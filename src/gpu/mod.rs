//! The GPU layer: adapter and device, the audited clock, timed frames, counters, shader linking and
//! read-back.
//!
//! Nothing here panics on a fault of the device: validation errors, exhausted memory and a lost device
//! come back as [`GpuError`] from the call that caused them.

mod adapter;
mod audit;
mod capacity;
mod ceilings;
mod counters;
mod error;
mod frame;
mod layout;
mod limits;
mod machine;
mod pipelines;
mod readback;
mod shader;
mod stage;

pub use adapter::{Gpu, Options};
pub use audit::{
    Audit, MOST_LOOP_TURNS, audit, audit_cpu_time, audit_table, loop_turns, turns_line,
};
pub use capacity::Capacity;
pub use ceilings::{CopyCheck, ceilings, compare_copies, limits, measure};
pub use counters::{StageCounters, count};
pub use error::GpuError;
pub use frame::{
    ClockPlan, ColorTarget, CostMeter, DepthTarget, Fault, FrameSample, FrameTimer, HostClock,
    HostTime, StageSample, StageScope, SubmitCost, Targets,
};
pub use layout::{BoundStruct, Member, StructLayout};
pub use limits::Demand;
pub use machine::MachineReader;
pub use pipelines::{CodeKey, GroupKey, KernelKey, RasterKey};
pub use readback::{Pixels, Texels, read_buffer, read_texture, read_volume, texture_bytes};
pub use shader::{Shader, compilation_options, default_defs, link, shader_paths};
pub use stage::{Column, Output, OutputData, ReadRow, Stage, StageInfo};
