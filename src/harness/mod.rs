//! Runs experiments: plans cells, samples their frames, writes records; renders and dumps single frames.
//!
//! [`plan`] resolves parameters and checks limits, [`schedule`] says which cells come next, [`sample`] schedules their frames over
//! an [`Executor`](sample::Executor), [`executor`] is that on a device, [`run`] strings them together.

pub mod assets;
pub mod beside;
pub mod catalog;
pub mod ceilings;
pub mod cell_progress;
pub mod difference;
pub mod dump;
pub mod executor;
pub mod figures;
mod host;
pub mod memory;
pub mod outcome;
pub mod picture;
pub mod plan;
pub mod progress;
pub mod render;
pub mod repetitions;
pub mod reports;
pub mod run;
pub mod sample;
pub mod schedule;
pub mod shard;
pub mod sheet;
pub mod subject;
pub mod sweep;

pub use fathom_record::{calendar, output};
pub use fathom_verify as verify;
pub mod views;

/// Most passes of a frame that are timed or counted: voxelization slice by slice has three for each slice.
pub const MAX_PASSES: u32 = 2048;
