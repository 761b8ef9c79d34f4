//! `fathom render`: one frame of a scene as a PNG file.

use std::path::Path;

use image::RgbImage;

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

/// Renders the subject, each pixel as the mean of `samples`, a square number. A pipeline that has no larger picture gets one sample.
pub fn picture(gpu: &Gpu, subject: &Subject, samples: u32) -> Result<RgbImage, PictureError> {
    let factor = samples.isqrt();
    match subject.enlarged(factor).filter(|_| factor > 1) {
        Some(larger) => picture::read(gpu, frame(gpu, &larger)?.as_ref(), factor),
        None => picture::read(gpu, frame(gpu, subject)?.as_ref(), 1),
    }
}

/// Renders the subject and writes its final image to `path`.
pub fn render(
    gpu: &Gpu,
    subject: &Subject,
    samples: u32,
    path: &Path,
) -> Result<(), PictureError> {
    picture::write(&picture(gpu, subject, samples)?, path)
}
