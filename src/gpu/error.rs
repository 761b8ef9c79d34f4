//! Errors of the GPU layer. Each message says what to do where something can be done.

use thiserror::Error;

use fathom_base::parameter::ParamError;
use fathom_clock::DeviceError;

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
    #[error(transparent)]
    Device(#[from] DeviceError),
}

impl From<ParamError> for GpuError {
    fn from(error: ParamError) -> Self {
        Self::Unusable(error.to_string())
    }
}
