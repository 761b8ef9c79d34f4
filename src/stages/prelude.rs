//! What a stage is written with.

pub use crate::kit::{self, Bind, Buffer, Depth, Dispatch, Group, Pass, RenderSpec, Resources};
pub use crate::shader_struct;
pub use crate::uniforms::Shared;
pub use fathom_gpu::{Column, GpuError, Output, Stage, StageInfo};
pub use fathom_record::Work;
