//! A pipeline's final image, as a PNG file.

use std::path::{Path, PathBuf};

use image::RgbImage;
use thiserror::Error;

use crate::gpu::{Gpu, GpuError, read_texture};
use crate::pipelines::AnyPipeline;

/// Exponent of display values, as in `shaders/shared/shading.wgsl`.
const GAMMA: f32 = 2.2;

#[derive(Debug, Error)]
pub enum PictureError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: image::ImageError },
}

/// Reads the image of the last frame, drawing it first where the frame does not, and writes it, opaque, row 0 at the top.
pub fn save(gpu: &Gpu, pipeline: &dyn AnyPipeline, path: &Path) -> Result<(), PictureError> {
    write(&read(gpu, pipeline, 1)?, path)
}

/// The image of the last frame, `factor` times smaller: each pixel is the mean of a square of them, in linear light.
pub fn read(gpu: &Gpu, pipeline: &dyn AnyPipeline, factor: u32) -> Result<RgbImage, PictureError> {
    let presenting = pipeline.presenting();
    if !presenting.is_empty() {
        gpu.run(&presenting)?;
    }
    let pixels = read_texture(gpu, pipeline.image())?;
    let reduced = |x: u32, y: u32| {
        let square = (0..factor).flat_map(|j| (0..factor).map(move |i| (i, j)));
        let texels = square.map(|(i, j)| pixels.texel(x * factor + i, y * factor + j));
        mean(texels)
    };
    let (width, height) = (pixels.width / factor, pixels.height / factor);
    Ok(RgbImage::from_fn(width, height, |x, y| image::Rgb(reduced(x, y))))
}

/// The mean of display values in linear light, as bytes. A single value is not changed.
fn mean<'t>(texels: impl Iterator<Item = &'t [f32]>) -> [u8; 3] {
    let texels: Vec<_> = texels.collect();
    let byte = |channel: usize| {
        let values = texels.iter().map(|texel| texel[channel].clamp(0.0, 1.0));
        let sum: f32 = values.map(|value| value.powf(GAMMA)).sum();
        ((sum / texels.len() as f32).powf(1.0 / GAMMA) * 255.0).round() as u8
    };
    std::array::from_fn(byte)
}

pub fn write(picture: &RgbImage, path: &Path) -> Result<(), PictureError> {
    picture.save(path).map_err(|source| PictureError::Write { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_taken_in_linear_light() {
        let (black, white) = ([0.0; 4], [1.0; 4]);
        // Half the light of white: 255 · 0.5^(1/2.2).
        assert_eq!(mean([&black[..], &white[..]].into_iter()), [186; 3]);
        for value in 0..=255u8 {
            let texel = [f32::from(value) / 255.0; 4];
            assert_eq!(mean([&texel[..]].into_iter()), [value; 3]);
        }
    }
}
