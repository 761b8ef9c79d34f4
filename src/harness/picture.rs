//! A pipeline's final image, as a PNG file.

use std::fmt::Display;
use std::path::Path;

use anyhow::{Result, anyhow};

use fathom_base::folder::{self, Dir};
use fathom_gpu::{Gpu, GpuError, Pixels, read_texture};
use fathom_pipelines::AnyPipeline;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{Rgb, RgbImage};

/// Exponent of display values, as in `shaders/shared/shading.wgsl`.
const GAMMA: f32 = 2.2;

/// The image of the last frame, drawn first where the frame does not.
pub fn read(gpu: &Gpu, pipeline: &AnyPipeline) -> Result<Pixels, GpuError> {
    let presenting = pipeline.presenting();
    if !presenting.is_empty() {
        gpu.run(&presenting)?;
    }
    read_texture(gpu, pipeline.image())
}

/// The image that was read, opaque, row 0 at the top, and `factor` times smaller: each pixel is the mean of a square of them. Light is
/// averaged as light, visibility as it is.
pub fn downscaled(pixels: &Pixels, shows_visibility: bool, factor: u32) -> RgbImage {
    let gamma = if shows_visibility { 1.0 } else { GAMMA };
    let pixel = |x: u32, y: u32| {
        let square = (0..factor).flat_map(|j| (0..factor).map(move |i| (i, j)));
        let texels = square.map(|(i, j)| pixels.texel(x * factor + i, y * factor + j));
        Rgb(mean(texels, gamma))
    };
    RgbImage::from_fn(pixels.width / factor, pixels.height / factor, pixel)
}

/// The mean of display values of this gamma, as bytes. A single value is not changed.
fn mean<'t>(texels: impl Iterator<Item = &'t [f32]>, gamma: f32) -> [u8; 3] {
    let texels: Vec<_> = texels.collect();
    if let [texel] = texels.as_slice() {
        return std::array::from_fn(|channel| {
            (texel[channel].clamp(0.0, 1.0) * 255.0).round() as u8
        });
    }
    let byte = |channel: usize| {
        let values = texels.iter().map(|texel| texel[channel].clamp(0.0, 1.0));
        let sum: f32 = values.map(|value| value.powf(gamma)).sum();
        ((sum / texels.len() as f32).powf(1.0 / gamma) * 255.0).round() as u8
    };
    std::array::from_fn(byte)
}

pub fn write(image: &RgbImage, folder: &Dir, name: &Path) -> Result<()> {
    let path = folder.path().join(name);
    if !name.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png")) {
        return Err(write_error(&path, "pictures are PNG files, so their names end in `.png`"));
    }
    let mut bytes = Vec::new();
    let (compression, filter) = (CompressionType::Default, FilterType::Adaptive);
    let encoder = PngEncoder::new_with_quality(&mut bytes, compression, filter);
    image.write_with_encoder(encoder).map_err(|error| write_error(&path, error))?;
    folder.write_own(name, &bytes).map_err(|error| write_error(&path, error))
}

/// Writes a picture to a path that the user names.
pub fn write_to(image: &RgbImage, path: &Path) -> Result<()> {
    let (folder, name) = folder::open_parent(path).map_err(|error| write_error(path, error))?;
    write(image, &folder, name)
}

pub fn write_error(path: &Path, reason: impl Display) -> anyhow::Error {
    anyhow!("cannot write {}: {reason}", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_averaged_as_light_and_visibility_as_it_is() {
        let (black, white) = ([0.0; 4], [1.0; 4]);
        let half = |gamma| mean([&black[..], &white[..]].into_iter(), gamma);
        // Half the light of white: 255 · 0.5^(1/2.2).
        assert_eq!(half(GAMMA), [186; 3]);
        assert_eq!(half(1.0), [128; 3]);
        for value in 0..=255u8 {
            let texel = [f32::from(value) / 255.0; 4];
            assert_eq!(mean([&texel[..]].into_iter(), GAMMA), [value; 3]);
        }
    }
}
