//! Errors of the GPU layer. Each message says what to do where something can be done.

use thiserror::Error;

use fathom_base::parameter::ParamError;

#[derive(Debug, Error)]
pub enum GpuError {
    #[error(
        "no GPU adapter found{tried}: install a Vulkan driver \
         (Debian/Ubuntu: `apt-get install libvulkan1 mesa-vulkan-drivers`)"
    )]
    NoAdapter {
        /// What narrowed the search, such as ` (WGPU_BACKEND=dx12)`; empty if nothing did.
        tried: String,
    },
    #[error("no adapter matches `{asked}`; there are: {available}")]
    UnknownAdapter { asked: String, available: String },
    #[error(
        "adapter `{adapter}` lacks {missing}, which fathom needs; choose another with --adapter"
    )]
    Missing { adapter: String, missing: String },
    #[error("adapter `{adapter}` could not be opened: {reason}")]
    Open { adapter: String, reason: String },
    #[error("no shader `{0}` under shaders/")]
    UnknownShader(String),
    #[error("shader `{path}` does not link:\n{message}")]
    Shader { path: String, message: String },
    #[error("beyond what the adapter can take: {0}")]
    Limit(String),
    /// The request makes no sense on any adapter; the text says why.
    #[error("{0}")]
    Unusable(String),
    #[error("the GPU refused a call: {0}")]
    Validation(String),
    #[error("out of GPU memory: {0}")]
    OutOfMemory(String),
    #[error("internal error of the GPU driver: {0}")]
    Internal(String),
    #[error("the GPU device was lost: {0}")]
    Lost(String),
    #[error("reading back from the GPU failed: {0}")]
    ReadBack(String),
    #[error("the frame opens more than {0} timed passes")]
    TooManyPasses(u32),
}

impl From<ParamError> for GpuError {
    fn from(error: ParamError) -> Self {
        Self::Unusable(error.to_string())
    }
}

impl From<wgpu::Error> for GpuError {
    fn from(error: wgpu::Error) -> Self {
        match error {
            wgpu::Error::OutOfMemory { source } => Self::OutOfMemory(source.to_string()),
            wgpu::Error::Validation { description, .. } => Self::Validation(description),
            wgpu::Error::Internal { description, .. } => Self::Internal(description),
        }
    }
}
