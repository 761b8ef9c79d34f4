//! What can go wrong around a device, and around a measurement on it.

use std::path::PathBuf;

use fathom_record::output::OutputError;
use thiserror::Error;

/// A fault of the device, or of a frame on it.
#[derive(Debug, Error)]
pub enum DeviceError {
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

impl From<wgpu::Error> for DeviceError {
    fn from(error: wgpu::Error) -> Self {
        match error {
            wgpu::Error::OutOfMemory { source } => Self::OutOfMemory(source.to_string()),
            wgpu::Error::Validation { description, .. } => Self::Validation(description),
            wgpu::Error::Internal { description, .. } => Self::Internal(description),
        }
    }
}

/// Why a program's measurement failed.
#[derive(Debug, Error)]
pub enum ClockError {
    #[error(transparent)]
    Device(#[from] DeviceError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("{} holds records already: choose another folder", path.display())]
    Occupied { path: PathBuf },
    /// The name goes into names of files.
    #[error("experiment {0}")]
    Name(String),
}
