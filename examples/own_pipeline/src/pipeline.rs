//! The pipeline `ripples`: parameters and wiring.

use std::collections::BTreeMap;

use fathom::gpu::kit::Resources;
use fathom::gpu::{Gpu, GpuError, read_texture};
use fathom::pipelines::settings::Viewport;
use fathom::pipelines::{Parameters, Pipeline, PipelineInstance};
use fathom::scene::{Camera, Scene, SceneFile, Water};

use crate::{blur, draw};

fathom::settings! {
    /// Everything that can be set.
    pub struct Params from file: SceneFile {
        view: Viewport = Viewport::default();
        camera: Camera = file.camera.clone();
        water: Water = file.water.clone();
        ripples: RippleSettings = RippleSettings::default();
    }
}

fathom::settings! {
    /// How ripples are drawn.
    pub struct RippleSettings {
        /// Rings that are added up at each pixel.
        rings: u32 = 8 => 1 ..= 4096, "1";
        /// Radius of the blur; 0: none.
        blur_px: u32 = 2 => 0 ..= 64, "px";
    }
}

impl Parameters for Params {}

/// Rings of ripples, blurred.
pub struct Ripples {
    image: wgpu::Texture,
}

impl Pipeline for Ripples {
    const NAME: &'static str = "ripples";
    const ABOUT: &'static str = "rings of ripples, drawn and blurred";
    type Params = Params;

    fn new(resources: &Resources<'_>, _: &Scene, params: &Params) -> Result<Self, GpuError> {
        let resources = &resources.with_size_hint("view.width × view.height");
        let size_px = [params.view.width, params.view.height];
        let draw = resources.push(draw::new(resources, size_px, params)?);
        let blur = blur::new(resources, &draw, params.ripples.blur_px)?;
        Ok(Self { image: resources.push(blur) })
    }
}

impl PipelineInstance for Ripples {
    fn image(&self) -> &wgpu::Texture {
        &self.image
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let pixels = read_texture(gpu, self.image())?;
        let red = pixels.data.iter().step_by(pixels.channels as usize);
        let mean = red.clone().map(|v| f64::from(*v)).sum::<f64>() / red.count() as f64;
        Ok(BTreeMap::from([("mean_height".to_owned(), mean)]))
    }
}
