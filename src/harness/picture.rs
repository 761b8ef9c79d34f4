//! A pipeline's final image as a PNG file.

use std::path::{Path, PathBuf};

use image::RgbImage;
use thiserror::Error;

use super::scale;
use crate::gpu::{Gpu, GpuError, read_texture};
use crate::pipelines::AnyPipeline;

#[derive(Debug, Error)]
pub enum PictureError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: image::ImageError },
}

/// The image of the last frame, opaque, row 0 at the top, drawn first where the frame does not; visibility gets a scale below.
pub fn of(gpu: &Gpu, pipeline: &dyn AnyPipeline) -> Result<RgbImage, PictureError> {
    let presenting = pipeline.presenting();
    if !presenting.is_empty() {
        gpu.run(&presenting)?;
    }
    let pixels = read_texture(gpu, pipeline.image())?;
    let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let image = RgbImage::from_fn(pixels.width, pixels.height, |x, y| {
        let texel = pixels.texel(x, y);
        image::Rgb([0, 1, 2].map(|k| byte(texel[k])))
    });
    if pipeline.shows_visibility() {
        return Ok(scale::below(&image, &scale::VISIBILITY));
    }
    Ok(image)
}

pub fn write(image: &RgbImage, path: &Path) -> Result<(), PictureError> {
    image.save(path).map_err(|source| PictureError::Write { path: path.to_owned(), source })
}

/// Reads the image of the last frame and writes it: see [`of`].
pub fn save(gpu: &Gpu, pipeline: &dyn AnyPipeline, path: &Path) -> Result<(), PictureError> {
    write(&of(gpu, pipeline)?, path)
}
