//! What a stage is written with.

pub use crate::kit::{
    self, Bind, Bindings, Buffer, Depth, Dispatch, DrawPass, RenderSpec, Resources,
};
pub use crate::shader_struct;
pub use crate::uniforms::Shared;
pub use fathom_gpu::{Column, GpuError, Stage, StageDump, StageInfo};
pub use fathom_record::Work;
