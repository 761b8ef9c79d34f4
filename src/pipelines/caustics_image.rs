//! Caustics of a measured cell against a photon map: irradiance of what each pixel shows, as figures and as pictures.

use std::sync::Arc;

use super::occlusion::signed_color;
use super::settings::Animation;
use super::{ErrorPicture, Errors, Judge, JudgeError, Judging};
use fathom_base::statistics::median;
use fathom_gpu::Pixels;
use fathom_record::{ErrorSpan, PictureScale};
use fathom_reference::image::Image;
use fathom_reference::photon_map::{Lighting, PhotonMap};
use fathom_reference::rays::PixelRays;
use fathom_scene::{Object, Optics};
use fathom_stages::uniforms::View;
use image::{Rgb, RgbImage};

/// Name of the error that asks for the photon map.
pub const IMAGE_ERROR: &str = "caustics_image_error";

/// Blocks of pixels that are compared at most: more pixels are compared in larger blocks, so that the map costs the same.
const MAX_BLOCKS: u64 = 32_768;
/// Photons of each half of the map for each block: in scene port the map's own error is then 6 % of its mean.
const PHOTONS_PER_BLOCK: f64 = 40.0;
/// Error in units of the mean irradiance that a picture shows in full colour.
const PICTURE_FULL: f64 = 1.0;

/// Irradiance of what the pixels of a picture show, W/m², as a frame has left it.
pub struct FrameCaustics {
    pub irradiance: Judging<Image>,
    /// The stage that left it.
    pub stage: &'static str,
    pub view: View,
}

/// One channel of a texture that was read.
pub fn channel(pixels: &Pixels, channel: usize) -> Image {
    let values = pixels.data.iter().skip(channel).step_by(pixels.channels as usize);
    let values = values.map(|value| f64::from(*value)).collect();
    Image::from_data([pixels.width, pixels.height], values)
}

/// Irradiance that was found and that of the photon map, over the same blocks of pixels.
pub struct CausticsPair {
    pub measured: Image,
    pub exact: Image,
    /// Distance from the viewer to what each block shows, metres; infinite where that is nothing.
    distance_m: Image,
    stage: &'static str,
    block_px: u32,
    noise: f64,
}

impl CausticsPair {
    /// # Errors
    /// A scene that the reference does not know: one with mirrors or glass.
    pub fn new(judge: &Judge<'_>, found: FrameCaustics) -> Result<Self, JudgeError> {
        let passes_on = |object: &&Object| object.material.optics != Optics::Diffuse;
        if let Some(object) = judge.scene.objects.iter().find(passes_on) {
            return Err(JudgeError::Specular(object.name.clone()));
        }
        let FrameCaustics { irradiance, stage, view } = found;
        let irradiance = irradiance(judge)?;
        let size = irradiance.size();
        let block_px = block_px(size);
        let map = map(judge, &view, size, block_px);
        Ok(Self {
            measured: irradiance.downsample(block_px),
            exact: map.irradiance(),
            distance_m: distances_m(judge, &view, size, block_px),
            stage,
            block_px,
            noise: map.noise(),
        })
    }

    /// `caustics_image_error`: Σ |I − I_ref| / Σ I_ref over the pixels; `caustics_image_rms_error`: the root of the mean square
    /// difference over the mean of I_ref. Beside them `caustics_image_level`, Σ I / Σ I_ref, `…_level_near` and `…_level_far`, the same of
    /// the nearer and of the farther half of what is seen, `caustics_reference_noise`, the first error of the map itself, and
    /// `caustics_image_block_px`, the side of the blocks of pixels that were compared.
    pub fn errors(&self) -> Errors {
        let pairs = || self.measured.data().iter().zip(self.exact.data());
        let count = self.exact.data().len() as f64;
        let sum = self.exact.sum();
        let absolute: f64 = pairs().map(|(found, exact)| (found - exact).abs()).sum();
        let square: f64 = pairs().map(|(found, exact)| (found - exact).powi(2)).sum();
        let errors = [
            (IMAGE_ERROR, absolute / sum, "1"),
            ("caustics_image_rms_error", (square / count).sqrt() * count / sum, "1"),
        ];
        let [near, far] = self.levels_near_and_far();
        let quantities = [
            ("caustics_image_level", self.measured.sum() / sum),
            ("caustics_image_level_near", near),
            ("caustics_image_level_far", far),
            ("caustics_reference_noise", self.noise),
            ("caustics_image_block_px", f64::from(self.block_px)),
        ];
        Errors::new(self.stage, errors, quantities)
    }

    /// Σ I / Σ I_ref over the blocks nearer than the median of those that show something, and over the others.
    fn levels_near_and_far(&self) -> [f64; 2] {
        let distances = self.distance_m.data();
        let visible_m: Vec<f64> = distances.iter().copied().filter(|d| d.is_finite()).collect();
        let middle_m = median(&visible_m);
        [true, false].map(|near| {
            let sum = |image: &Image| -> f64 {
                let blocks = image.data().iter().zip(distances);
                let of_half = blocks.filter(|(_, d)| d.is_finite() && (**d < middle_m) == near);
                of_half.map(|(value, _)| value).sum()
            };
            sum(&self.measured) / sum(&self.exact)
        })
    }

    /// The signed error: red where too bright, blue where too dark, in full colour from ± the mean irradiance on.
    pub fn error_picture(&self) -> ErrorPicture {
        let mean = self.exact.mean();
        let errors = Image::from_fn(self.exact.size(), |x, y| {
            let at = |image: &Image| image.clamped(x.into(), y.into());
            (at(&self.measured) - at(&self.exact)) / mean
        });
        let [width, height] = errors.size().map(|side| side * self.block_px);
        let color = |x: u32, y: u32| {
            let error = errors.clamped((x / self.block_px).into(), (y / self.block_px).into());
            Rgb(signed_color(error / PICTURE_FULL))
        };
        let picture = RgbImage::from_fn(width, height, color);
        let span = ErrorSpan::new(PICTURE_FULL, errors.data().iter().copied());
        (picture, PictureScale::IrradianceError(span))
    }
}

/// Side of the blocks that a picture is compared in.
fn block_px([width, height]: [u32; 2]) -> u32 {
    let fits = |side: &u32| {
        u64::from(width.div_ceil(*side)) * u64::from(height.div_ceil(*side)) <= MAX_BLOCKS
    };
    (1..).find(fits).unwrap_or(1)
}

/// Distances from the viewer along the rays through the blocks' middles.
fn distances_m(judge: &Judge<'_>, view: &View, size: [u32; 2], block_px: u32) -> Image {
    let tracer = judge.references.geometry.tracer(judge.scene, &Animation::default());
    let [width, height] = size;
    let matrix = view.camera.view_projection(view.aspect());
    let rays = PixelRays::of_matrix(matrix, width, height);
    Image::from_fn(size.map(|side| side.div_ceil(block_px)), |x, y| {
        let middle = |block: u32| (f64::from(block) + 0.5) * f64::from(block_px);
        let (origin, direction, length_m) = rays.ray_at(middle(x), middle(y));
        let hit = tracer.cast(origin, direction, 0.0, length_m);
        hit.map_or(f64::INFINITY, |hit| hit.position.distance(view.camera.position()))
    })
}

/// The photon map of a view, from an earlier cell or run where it is known.
fn map(judge: &Judge<'_>, view: &View, size: [u32; 2], block_px: u32) -> Arc<PhotonMap> {
    let blocks: f64 = size.iter().map(|side| f64::from(side.div_ceil(block_px))).product();
    let columns = (blocks * PHOTONS_PER_BLOCK).sqrt().ceil() as u32;
    // Photons of the whole frustum: those that the grid leaves out must be missed.
    let frame = view.light.frame(&view.camera, view.aspect(), &view.bounds, &view.water, false);
    let View { light, water, camera, .. } = view;
    let asked = (&frame, light, water, camera, view.aspect(), (size, block_px, columns));
    let content = judge.question("photon map", &asked);
    judge.references.kept_answer(content, || {
        let lighting = Lighting {
            frame: &frame,
            intensity_w_sr: light.intensity_w_sr,
            water,
            tracer: &judge.references.geometry.tracer(judge.scene, &Animation::default()),
            camera,
            aspect: view.aspect(),
        };
        PhotonMap::new(&lighting, size, columns).downsample(block_px)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compared(found: [f64; 4]) -> Errors {
        let image = |data: [f64; 4]| Image::from_data([2, 2], data.into());
        let exact = image([1.0, 3.0, 0.0, 4.0]);
        let distance_m = image([2.0, 1.0, f64::INFINITY, 3.0]);
        let found = image(found);
        CausticsPair { measured: found, exact, distance_m, stage: "a/b", block_px: 1, noise: 0.01 }
            .errors()
    }

    #[test]
    fn errors_are_relative_to_the_exact_irradiance() {
        let figures = |judged: &Errors| judged.errors.iter().map(|e| e.value).collect::<Vec<_>>();
        assert_eq!(figures(&compared([1.0, 3.0, 0.0, 4.0])), [0.0, 0.0]);
        let bright = compared([1.5, 4.5, 0.0, 6.0]);
        assert_eq!((figures(&bright)[0], bright.quantities["caustics_image_level"]), (0.5, 1.5));
        let moved = compared([3.0, 1.0, 0.0, 4.0]);
        assert_eq!((figures(&moved)[0], moved.quantities["caustics_image_level"]), (0.5, 1.0));
        assert!((figures(&moved)[1] - 2f64.sqrt() / 2.0).abs() < 1e-12);
        let far = compared([0.5, 4.5, 9.0, 6.0]);
        assert_eq!(far.quantities["caustics_image_level_near"], 1.5);
        assert_eq!(far.quantities["caustics_image_level_far"], 6.5 / 5.0);
    }

    #[test]
    fn large_pictures_are_compared_in_blocks() {
        assert_eq!(block_px([200, 150]), 1);
        assert_eq!(block_px([800, 600]), 4);
        assert_eq!(block_px([1, 1]), 1);
    }
}
