//! Caustics on planar receivers: Krüger, Bürger and Westermann, *Interactive Screen-Space Accurate Photon Tracing on GPUs* (SPT) §1.1, Fig. 2.
//!
//! The receivers are the floor and the four walls of a rectangular pool. They follow from parameters that scenes have: the floor lies at
//! `floor_depth_m`, and the walls at the borders of the water, `water.center_m` and `water.half_size_m`. Scenes whose geometry is
//! another are refused.

mod measure;
mod parameters;
mod receivers;

use super::Pipeline;
use super::screen_tracing;
use super::settings::{self, VIEWPORT};
use fathom_gpu::GpuError;
use fathom_reference::pool::Basin;
use fathom_scene::Scene;
use fathom_stages::geometry::Geometry;
use fathom_stages::kit::Resources;
use fathom_stages::planar::compose;
use fathom_stages::planar::points;
use fathom_stages::scene;
use fathom_stages::screen_ray::Transfers;
use fathom_stages::uniforms::View;

pub use parameters::Params;

/// Photons counted in an illumination map of a pool's floor and walls.
pub struct Planar {
    params: Params,
    pub view: View,
    basin: Basin,
    pub transfers: Transfers,
    /// The illumination map.
    pub map: wgpu::Texture,
    image: wgpu::Texture,
}

impl Pipeline for Planar {
    const NAME: &'static str = "planar";
    const ABOUT: &'static str = "caustics on planar receivers (SPT §1.1): photons as points in an illumination map of a pool's floor and walls";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        scene.needs_objects(Self::NAME).map_err(GpuError::Unusable)?;
        let basin = Basin::of(&scene.water, params.floor_depth_m);
        receivers::check(scene, &basin).map_err(GpuError::Unusable)?;
        let view = settings::view(&params.view, &params.camera, &params.light, scene);
        let shared = &settings::begin(resources, &view);
        let geometry = &Geometry::new(resources, scene);

        let (shadow_px, cells, grid) = (params.shadow.size, params.surface.cells, &params.transfer);
        let map = screen_tracing::transfers(resources, shared, geometry, shadow_px, cells, grid)?;
        let transfers = map.transfers;

        let of_view = &resources.sized_by(VIEWPORT);
        let size_px = view.size_px.to_array();
        let gbuffer = of_view.push(scene::gbuffer::new(of_view, shared, geometry, size_px)?);

        let of_map = &resources.sized_by("planar.texels");
        let pool = params.pool();
        let photon_w = view.weighted_flux_w() / f64::from(params.transfer.photons());
        let map = of_map.push(points::new(of_map, shared, &transfers, &pool, photon_w)?);
        let (exposure, shown) = (params.compose.exposure, params.compose.show);
        let lit = (&map, &pool);
        let compose = compose::new(of_view, shared, &gbuffer, lit, exposure, shown)?;
        let image = of_view.push(compose);
        Ok(Self { params: params.clone(), view, basin, transfers, map, image })
    }
}
