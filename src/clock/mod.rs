#![doc = include_str!("README.md")]

mod alone;
mod audit;
mod counters;
mod device;
mod error;
mod frame;
mod machine;
mod queries;
mod sampling;
mod session;

pub use alone::StageClock;
pub use audit::{Audit, audit, audit_all, audit_cpu_time, audit_table};
pub use counters::{StageCounters, count};
pub use device::{Device, catch_panic, describe};
pub use error::{ClockError, DeviceError};
/// What is measured, as records have it.
pub use fathom_record as record;
pub use fathom_record::ceilings::Drawing;
pub use fathom_record::{ClockPlan, SubmitCost};
pub use frame::{
    ColorTarget, CostMeter, DepthTarget, EncodeCost, FrameSample, FrameTimer, HostClock, HostTime,
    RejectedTime, StageScope, StageTime, Targets, TimedStage,
};
pub use machine::MachineReader;
pub use sampling::{
    FramePair, MAX_REJECTED_SHARE, MAX_WARM_UP_FRAMES, MIN_JUDGED_FRAMES, Samples,
    WARM_UP_TOLERANCE, WarmUp, accounting_error, frame_record, sampling_notes, stage_record,
};
pub use session::{Frame, FrameClock, TimedPass, features};
