//! `fathom render`: one frame of a scene as a PNG file.

use anyhow::{Context as _, Result};
use image::RgbImage;

use super::picture;
use super::subject::Subject;
use fathom_gpu::{Gpu, GpuError};
use fathom_pipelines::{AnyPipeline, PixelComparison};

/// Builds the subject's pipeline and runs one frame, untimed.
pub fn frame(gpu: &Gpu, subject: &Subject) -> Result<Box<AnyPipeline>, GpuError> {
    let pipeline = subject.build(gpu)?;
    gpu.run(&pipeline.stages())?;
    Ok(pipeline)
}

/// A subject's frame, drawn larger by a factor in each direction so that pixels are means.
pub struct RenderedFrame {
    pub pipeline: Box<AnyPipeline>,
    factor: u32,
}

impl RenderedFrame {
    /// With so many `samples` of a pixel, a square number. A pipeline that has no larger picture gets one sample.
    pub fn new(gpu: &Gpu, subject: &Subject, samples: u32) -> Result<Self> {
        let factor = samples.isqrt();
        let larger = subject.upscaled(factor).filter(|_| factor > 1);
        let factor = if larger.is_some() { factor } else { 1 };
        let pipeline = frame(gpu, larger.as_ref().unwrap_or(subject))?;
        Ok(Self { pipeline, factor })
    }

    pub fn image(&self, gpu: &Gpu) -> Result<RgbImage> {
        let pixels = picture::read(gpu, self.pipeline.as_ref())?;
        Ok(picture::downscaled(&pixels, self.pipeline.shows_visibility(), self.factor))
    }

    /// See [`PipelineInstance::compare_pixels`](fathom_pipelines::PipelineInstance::compare_pixels).
    pub fn compare_pixels(&self, gpu: &Gpu, subject: &Subject) -> Result<PixelComparison> {
        let compared = self.pipeline.compare_pixels(gpu, &subject.scene)?;
        compared.with_context(|| format!("pipeline {} has no such panel", subject.kind.name))
    }
}
