//! What the stages of a pipeline left behind in the last frame.

use thiserror::Error;

use fathom_gpu::{Gpu, GpuError, Pixels, read_texture};
use fathom_pipelines::AnyPipeline;
use fathom_stages::OutputData;

/// Why nothing can be told of images that stages left behind.
#[derive(Debug, Error)]
pub enum ReadoutError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("no stage of {0} leaves a texture")]
    NoTexture(String),
    #[error("the cell's image has {0} × {1} pixels, the reference's {2} × {3}")]
    Size(u32, u32, u32, u32),
    #[error("the reference is black")]
    BlackReference,
    #[error("the repetitions' images differ in size")]
    Sizes,
    #[error("the image is black")]
    Black,
}

/// Texels of the first texture that the first present of the named stages leaves.
pub fn image(
    gpu: &Gpu,
    pipeline: &dyn AnyPipeline,
    stages: &[String],
) -> Result<Pixels, ReadoutError> {
    let present = pipeline.stages();
    let named = |name: &String| present.iter().find(|stage| stage.name() == name);
    let mut outputs = stages.iter().find_map(named).into_iter().flat_map(|stage| stage.outputs());
    let texture = outputs.find_map(|output| match output.data {
        OutputData::Texture(texture) => Some(texture),
        _ => None,
    });
    let texture = texture.ok_or_else(|| ReadoutError::NoTexture(stages.join(", ")))?;
    Ok(read_texture(gpu, &texture)?)
}
