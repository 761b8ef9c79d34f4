//! Ambient occlusion as engines have it: horizons in slices (GTAO) or visibility bitmasks. Jimenez et al. 2016; Therrien et al. 2023.

mod parameters;

use std::collections::BTreeMap;

use super::lighting::{LitImage, VisibleScene};
use super::occlusion::{OcclusionBuffers, RayModel};
use super::{CountedReads, Pipeline, PipelineInstance, settings, to_map};
use fathom_gpu::kit::Resources;
use fathom_gpu::{Gpu, GpuError};
use fathom_scene::Scene;
use fathom_stages::counters;
use fathom_stages::geometry::Geometry;
use fathom_stages::gtao::filter;
use fathom_stages::gtao::gather::{self, GatherMethod, GatherUniforms};

pub use parameters::{Gather, Params};

/// Ambient occlusion of slices over the depth buffer, lit and composed.
pub struct Gtao {
    seen: VisibleScene,
    composed: LitImage,
    uniforms: GatherUniforms,
    method: GatherMethod,
    buffers: OcclusionBuffers,
}

impl Pipeline for Gtao {
    const NAME: &'static str = "gtao";
    const ABOUT: &'static str = "ambient occlusion by horizons (GTAO) or visibility bitmasks over the depth buffer, lit and composed";
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
        let r_max_m = settings::r_max_m(scene, params.gtao.r_max_m, params.gtao.r_max_share);
        let uniforms = params.gtao.uniforms(params.buffer_px(), r_max_m);
        let method = params.gtao.method();
        let of_buffer = resources.with_size_hint("view × gtao.scale");
        let textures = &seen.gbuffer;
        let gather = gather::new(&of_buffer, &seen.shared, textures, &uniforms, method, None)?;
        let gather = of_buffer.push(gather);
        let filter = params.gtao.filter.then_some((&filter::INFO, &params.filter, method.window));
        let composed =
            LitImage::new(resources, &seen, scene, &geometry, &gather, filter, &params.compose)?;
        let buffers = OcclusionBuffers {
            gbuffer: textures.clone(),
            raw: (gather::INFO.name, gather.clone()),
            filtered: composed.filtered.clone(),
            camera: params.camera.clone(),
            r_max_m,
            model: RayModel::First(settings::Attenuation::Hard),
            animation: params.animation.clone(),
        };
        Ok(Self { seen, composed, uniforms, method, buffers })
    }
}

impl PipelineInstance for Gtao {
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
            gather::new(resources, shared, gbuffer, uniforms, self.method, Some(counters))
        })?;
        Ok(Some(CountedReads::of_buffer(gather::INFO.name, counts, uniforms.size_px)))
    }

    fn occlusion(&self) -> Option<&OcclusionBuffers> {
        Some(&self.buffers)
    }
}
