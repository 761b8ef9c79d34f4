//! A pipeline's final image as a PNG file.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::gpu::{Gpu, GpuError, read_texture};
use crate::pipelines::AnyPipeline;

#[derive(Debug, Error)]
pub enum PictureError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: image::ImageError },
}

/// Reads the image of the last frame, drawing it first where the frame does not, and writes it, opaque, row 0 at the top.
pub fn save(gpu: &Gpu, pipeline: &dyn AnyPipeline, path: &Path) -> Result<(), PictureError> {
    let presenting = pipeline.presenting();
    if !presenting.is_empty() {
        gpu.run(&presenting)?;
    }
    let pixels = read_texture(gpu, pipeline.image())?;
    let byte = |value: &f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let rgb = pixels.data.chunks_exact(pixels.channels as usize);
    let rgb: Vec<u8> = rgb.flat_map(|texel| texel[..3].iter().map(byte)).collect();
    let format = image::ExtendedColorType::Rgb8;
    image::save_buffer(path, &rgb, pixels.width, pixels.height, format)
        .map_err(|source| PictureError::Write { path: path.to_owned(), source })
}
