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

/// A texture that the first present of the named stages leaves: the one of that name, or the first.
pub fn texture<S: AsRef<str>>(
    pipeline: &dyn AnyPipeline,
    stages: &[S],
    output: Option<&str>,
) -> Option<wgpu::Texture> {
    let present = pipeline.stages();
    let stage = stages
        .iter()
        .find_map(|name| present.iter().find(|stage| stage.name() == name.as_ref()))?;
    stage.outputs.iter().find_map(|of_stage| match &of_stage.data {
        OutputData::Texture(texture) if output.is_none_or(|name| name == of_stage.name) => {
            Some(texture.clone())
        }
        _ => None,
    })
}

/// Its texels.
pub fn image<S: AsRef<str>>(
    gpu: &Gpu,
    pipeline: &dyn AnyPipeline,
    stages: &[S],
    output: Option<&str>,
) -> Result<Pixels, ReadoutError> {
    match texture(pipeline, stages, output) {
        Some(texture) => Ok(read_texture(gpu, &texture)?),
        None => {
            let names: Vec<&str> = stages.iter().map(AsRef::as_ref).collect();
            Err(ReadoutError::NoTexture(names.join(", ")))
        }
    }
}
