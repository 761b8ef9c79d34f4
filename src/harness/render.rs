//! `fathom render`: one frame of a scene as a PNG file.

use std::path::Path;

use super::picture::{self, PictureError};
use super::subject::Subject;
use crate::gpu::{Gpu, GpuError};
use crate::pipelines::AnyPipeline;

/// Builds the subject's pipeline and runs one frame, untimed.
pub fn frame(gpu: &Gpu, subject: &Subject) -> Result<Box<dyn AnyPipeline>, GpuError> {
    let pipeline = subject.build(gpu)?;
    gpu.run(&pipeline.stages())?;
    Ok(pipeline)
}

/// Renders the subject and writes its final image to `path`.
pub fn render(gpu: &Gpu, subject: &Subject, path: &Path) -> Result<(), PictureError> {
    let pipeline = frame(gpu, subject)?;
    picture::save(gpu, pipeline.as_ref(), path)
}
