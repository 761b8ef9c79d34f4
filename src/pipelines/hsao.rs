//! Horizon-split ambient occlusion (HSAO), the screen-space method that Papaioannou, Menexi and Papadopoulos, *Real-time
//! Volume-based Ambient Occlusion* (VAO), §6, compare theirs with.

mod parameters;

use std::collections::BTreeMap;

use super::lighting::{LitImage, VisibleScene};
use super::occlusion::{OcclusionBuffers, RayModel};
use super::{CountedReads, Pipeline, PipelineInstance, settings, to_map};
use fathom_gpu::kit::Resources;
use fathom_gpu::{Gpu, GpuError};
use fathom_scene::Scene;
use fathom_stages::bilateral::Window;
use fathom_stages::counters;
use fathom_stages::geometry::Geometry;
use fathom_stages::hsao::filter;
use fathom_stages::hsao::march::{self, HorizonUniforms};

pub use parameters::{Horizon, Params};

/// Horizon-split ambient occlusion over the depth buffer, lit and composed.
pub struct Hsao {
    seen: VisibleScene,
    composed: LitImage,
    uniforms: HorizonUniforms,
    hard: bool,
    buffers: OcclusionBuffers,
}

impl Pipeline for Hsao {
    const NAME: &'static str = "hsao";
    const ABOUT: &'static str =
        "horizon-split ambient occlusion over the depth buffer (VAO §6), lit and composed";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        scene.needs_objects(Self::NAME).map_err(GpuError::Unusable)?;
        let view = settings::view(&params.view, &params.camera, &params.light, scene);
        let view = settings::without_water(view, params.animation.bounds(scene));
        let shared = settings::begin(resources, &view);
        let geometry = Geometry::new(resources, scene);
        if let Some(deform) = settings::deform(resources, &geometry, scene, &params.animation)? {
            resources.push(deform);
        }
        let seen = VisibleScene::draw(resources, view, shared, &geometry, &params.shadow)?;
        let r_max_m = settings::r_max_m(scene, params.hsao.r_max_m, params.hsao.r_max_share);
        let uniforms = params.hsao.uniforms(params.buffer_px(), r_max_m);
        let hard = params.hsao.attenuation == settings::Attenuation::Hard;
        let of_buffer = resources.with_size_hint("view × hsao.scale");
        let textures = &seen.gbuffer;
        let march = march::new(&of_buffer, &seen.shared, textures, &uniforms, hard, None)?;
        let march = of_buffer.push(march);
        let filter = params.hsao.filter.then_some((&filter::INFO, &params.filter, Window::Disc));
        let composed =
            LitImage::new(resources, &seen, scene, &geometry, &march, filter, &params.compose)?;
        let buffers = OcclusionBuffers {
            gbuffer: textures.clone(),
            raw: (march::INFO.name, march.clone()),
            filtered: composed.filtered.clone(),
            camera: params.camera.clone(),
            r_max_m,
            model: RayModel::First(params.hsao.attenuation),
            animation: params.animation.clone(),
        };
        Ok(Self { seen, composed, uniforms, hard, buffers })
    }
}

impl PipelineInstance for Hsao {
    fn image(&self) -> &wgpu::Texture {
        &self.composed.image
    }

    fn shows_visibility(&self) -> bool {
        self.composed.shows_occlusion
    }

    fn quantities(&self, _gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        Ok(to_map([("samples_per_pixel_most", self.uniforms.samples_per_pixel() as f64)]))
    }

    fn counted_reads(&self, gpu: &Gpu) -> Result<Option<CountedReads>, GpuError> {
        let (shared, gbuffer, uniforms) =
            (&self.seen.shared, &self.buffers.gbuffer, &self.uniforms);
        let counts = counters::count(gpu, |resources, counters| {
            march::new(resources, shared, gbuffer, uniforms, self.hard, Some(counters))
        })?;
        Ok(Some(CountedReads::of_buffer(march::INFO.name, counts, uniforms.size_px)))
    }

    fn occlusion(&self) -> Option<&OcclusionBuffers> {
        Some(&self.buffers)
    }
}
