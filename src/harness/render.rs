//! `fathom render`: one frame of a scene as a PNG file.

use std::path::Path;

use super::MAX_PASSES;
use super::executor::encodable;
use super::picture::{self, PictureError};
use super::subject::Subject;
use crate::gpu::{ClockPlan, FrameTimer, Gpu, GpuError, SubmitCost};
use crate::pipelines::Pipeline;

/// Builds the subject's pipeline and runs one frame, untimed.
pub fn frame(gpu: &Gpu, subject: &Subject) -> Result<Box<dyn Pipeline>, GpuError> {
    let pipeline = subject.build(gpu)?;
    let mut timer = FrameTimer::new(gpu, ClockPlan::fenced(SubmitCost::default()), MAX_PASSES)?;
    timer.untimed(gpu, &encodable(pipeline.as_ref()))?;
    Ok(pipeline)
}

/// Renders the subject and writes its final image to `path`.
pub fn render(gpu: &Gpu, subject: &Subject, path: &Path) -> Result<(), PictureError> {
    let pipeline = frame(gpu, subject)?;
    picture::save(gpu, pipeline.as_ref(), path)
}
