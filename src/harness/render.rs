//! `fathom render`: one frame of a scene as a PNG file.

use anyhow::Result;
use image::RgbImage;

use super::picture;
use super::subject::Subject;
use fathom_gpu::{Gpu, GpuError};
use fathom_pipelines::caustics_image::CausticsPair;
use fathom_pipelines::{AnyPipeline, Judge, ReferenceCache};

/// Builds the subject's pipeline and runs one frame, untimed.
pub fn frame(gpu: &Gpu, subject: &Subject) -> Result<Box<AnyPipeline>, GpuError> {
    let pipeline = subject.build(gpu)?;
    gpu.run(&pipeline.stages())?;
    Ok(pipeline)
}

/// Renders the subject, each pixel as the mean of `samples`, a square number. A pipeline that has no larger picture gets one sample.
/// Also tells whether its greys are visibility.
pub fn image(gpu: &Gpu, subject: &Subject, samples: u32) -> Result<(RgbImage, bool)> {
    let factor = samples.isqrt();
    let larger = subject.upscaled(factor).filter(|_| factor > 1);
    let factor = if larger.is_some() { factor } else { 1 };
    let pipeline = frame(gpu, larger.as_ref().unwrap_or(subject))?;
    let image = picture::read_downscaled(gpu, pipeline.as_ref(), factor)?;
    Ok((image, pipeline.shows_visibility()))
}

/// The subject's caustics, or those of the photon map in their place; see [`CausticsPair::picture`].
pub fn caustics(
    gpu: &Gpu,
    subject: &Subject,
    references: &mut ReferenceCache,
    exact: bool,
) -> Result<RgbImage> {
    let pipeline = frame(gpu, subject)?;
    let mut judge = Judge { gpu, scene: &subject.scene, references, requested: &[] };
    let compared: CausticsPair = pipeline.caustics(&mut judge)?;
    Ok(compared.picture(exact))
}
