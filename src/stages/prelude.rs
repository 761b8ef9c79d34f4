//! What a stage is written with.

pub use crate::uniforms::Shared;
pub use fathom_gpu::kit::{
    self, Bind, Bindings, Buffer, Depth, Dispatch, DrawPass, RenderSpec, Resources,
};
pub use fathom_gpu::{Column, GpuError, Stage, StageDump, StageInfo, shader_struct};
pub use fathom_record::Work;
