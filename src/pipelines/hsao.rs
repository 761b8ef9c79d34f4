//! Horizon-split ambient occlusion (HSAO), the screen-space method that Papaioannou, Menexi and Papadopoulos, *Real-time
//! Volume-based Ambient Occlusion* (VAO), §6, compare theirs with.

mod parameters;

use std::collections::BTreeMap;

use glam::UVec2;
use serde_json::Value;

use super::settings::{
    COMPOSE_FETCHES, DEPTH_BYTES, GBUFFER_BYTES, IMAGE_BYTES, VIEWPORT, VISIBILITY_BYTES,
    filter_fetches, pass_demand,
};
use super::{Kind, Pipeline, settings};
use crate::gpu::{Demand, Gpu, GpuError};
use crate::scene::Scene;
use crate::stages::frame::{Frame, Shared, View};
use crate::stages::geometry::Geometry;
use crate::stages::hsao::march::{self, MarchUniforms};
use crate::stages::kit::Resources;
use crate::stages::{self, Stage, ao, bilateral, hsao, scene, shadow};

pub use parameters::{Hsao as Settings, Params};

pub const KIND: Kind = Kind {
    name: "hsao",
    about: "horizon-split ambient occlusion over the depth buffer (VAO §6), lit and composed",
    stages: &[
        stages::frame::INFO,
        stages::shadow::depth::INFO,
        stages::scene::gbuffer::INFO,
        stages::hsao::march::INFO,
        stages::hsao::filter::INFO,
        stages::ao::compose::INFO,
    ],
    defaults: |file| Params::from_scene(file).to_value(),
    scene_file: |file, params| {
        let p = Params::from_value(params)?;
        Ok(settings::staged(file, p.floor_depth_m, p.camera, p.light, p.objects))
    },
    demand,
    build: |gpu, scene, params| {
        let params = Params::from_value(params).map_err(GpuError::Limit)?;
        Ok(Box::new(Hsao::new(gpu, scene, params)?))
    },
};

fn demand(params: &Value, scene: &Scene) -> Result<Demand, String> {
    scene.needs_objects("hsao")?;
    let params = Params::from_value(params)?;
    let size_px = [params.view.width, params.view.height];
    let shadow = [params.shadow.size; 2];
    let buffer_px = params.buffer_px();
    let samples = params.hsao.uniforms(buffer_px, 1.0).samples_per_pixel();
    let taps = filter_fetches(params.hsao.filter, &params.filter);
    let filter_bytes = u64::from(params.hsao.filter) * VISIBILITY_BYTES;
    let view_bytes = GBUFFER_BYTES + IMAGE_BYTES + filter_bytes;
    Ok(pass_demand(size_px, VIEWPORT, view_bytes, COMPOSE_FETCHES + taps)
        .and(pass_demand(buffer_px, "view × hsao.scale", VISIBILITY_BYTES, samples))
        .and(pass_demand(shadow, "shadow.size", DEPTH_BYTES, 0))
        .and(settings::picture_demand(size_px))
        .and(settings::shared_demand())
        .and(settings::geometry_demand(scene))
        .color_targets("scene/gbuffer", 2, 12))
}

/// The stages of a frame, in order.
pub struct Hsao {
    frame: Frame,
    shadow: shadow::depth::Depth,
    gbuffer: scene::gbuffer::Gbuffer,
    march: hsao::march::March,
    filter: Option<hsao::filter::Filter>,
    compose: ao::compose::Compose,
    shared: Shared,
    uniforms: MarchUniforms,
    hard: bool,
    allocated_bytes: u64,
}

impl Hsao {
    /// Builds all resources and pipelines; `scene` gives geometry and water, `params` all else.
    pub fn new(gpu: &Gpu, scene: &Scene, params: Params) -> Result<Self, GpuError> {
        let resources = &Resources::new(gpu);
        let view = View {
            camera: params.camera.clone(),
            light: params.light.clone(),
            water: scene.water.clone(),
            bounds: scene.bounds,
            size_px: UVec2::new(params.view.width, params.view.height),
            edge_m: settings::UNUSED_EDGE_M,
        };
        let shared = Shared::new(resources, &view);
        let geometry = Geometry::new(resources, scene);
        let shadow = shadow::depth::Depth::new(resources, &shared, &geometry, params.shadow.size)?;
        let size_px = view.size_px.to_array();
        let gbuffer = scene::gbuffer::Gbuffer::new(resources, &shared, &geometry, size_px)?;

        let buffer_px = params.buffer_px();
        let r_max_m = settings::r_max_m(scene, params.hsao.r_max_m, params.hsao.r_max_share);
        let uniforms = params.hsao.uniforms(buffer_px, r_max_m);
        let hard = params.hsao.attenuation == settings::Attenuation::Hard;
        let seen = march::Inputs { depth: gbuffer.depth.clone(), normal: gbuffer.normal.clone() };
        let march = march::March::new(resources, &shared, &seen, &uniforms, hard)?;
        let guided = bilateral::Inputs { visibility: march.texture(), depth: &gbuffer.depth };
        let filter = params
            .hsao
            .filter
            .then(|| {
                let settings = params.filter.uniforms(&view, buffer_px);
                hsao::filter::Filter::new(resources, &shared, &guided, &settings)
            })
            .transpose()?;
        let inputs = ao::compose::Inputs {
            albedo: &gbuffer.albedo,
            normal: &gbuffer.normal,
            depth: &gbuffer.depth,
            visibility: filter.as_ref().map_or(march.texture(), |f| f.texture()),
            shadow: shadow.texture(),
        };
        let compose = ao::compose::Compose::new(
            resources,
            &shared,
            &inputs,
            &params.compose.uniforms(&view),
            params.compose.shows_occlusion(),
        )?;
        Ok(Self {
            frame: Frame::new(view, &shared),
            shadow,
            gbuffer,
            march,
            filter,
            compose,
            shared,
            uniforms,
            hard,
            allocated_bytes: resources.allocated_bytes(),
        })
    }
}

impl Pipeline for Hsao {
    fn stages(&self) -> Vec<&dyn Stage> {
        let mut stages: Vec<&dyn Stage> =
            vec![&self.frame, &self.shadow, &self.gbuffer, &self.march];
        stages.extend(self.filter.iter().map(|filter| filter as &dyn Stage));
        stages.push(&self.compose);
        stages
    }

    fn allocated_bytes(&self) -> u64 {
        self.allocated_bytes
    }

    fn image(&self) -> &wgpu::Texture {
        self.compose.texture()
    }

    /// `samples_per_pixel_most`, and `samples_per_pixel` as taken by the pixels of the occlusion buffer where something was
    /// drawn; `covered_share` of its pixels.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let seen = march::Inputs {
            depth: self.gbuffer.depth.clone(),
            normal: self.gbuffer.normal.clone(),
        };
        let counts = march::count(gpu, &self.shared, &seen, &self.uniforms, self.hard)?;
        let pixels = f64::from(self.uniforms.size_px.x) * f64::from(self.uniforms.size_px.y);
        let covered = counts.fragments as f64;
        let figures = [
            ("samples_per_pixel_most", self.uniforms.samples_per_pixel() as f64),
            ("samples_per_pixel", counts.samples as f64 / covered.max(1.0)),
            ("covered_share", covered / pixels),
        ];
        Ok(figures.map(|(name, value)| (name.to_owned(), value)).into())
    }
}
