//! Screen-space photon tracing: Krüger, Bürger and Westermann, *Interactive Screen-Space Accurate Photon Tracing on GPUs* (SPT).

mod measure;
mod parameters;

use std::collections::BTreeMap;
use std::rc::Rc;

use glam::{DVec3, UVec2};

use super::settings::VIEWPORT;
use super::{Judge, JudgeError, Judged, Pipeline};
use crate::gpu::{Gpu, GpuError};
use crate::scene::Scene;
use crate::stages::frame::{Frame, Shared, View};
use crate::stages::geometry::Geometry;
use crate::stages::kit::{Resources, linear_workgroups};
use crate::stages::photon::Photons;
use crate::stages::screen_ray::{Rays, Transfers, Walked, group_each};
use crate::stages::sprites::compose::Compose;
use crate::stages::sprites::draw::{Sprite, Sprites};
use crate::stages::transfer::map::{Map, MapUniforms};
use crate::stages::{ldi, rays, scene, shadow};

pub use parameters::{Method, Params};

/// Photons traced through layered depth, drawn as sprites.
pub struct PhotonTracing {
    params: Params,
    pub view: View,
    pub transfers: Transfers,
    pub photons: Photons,
    compose: Rc<Compose>,
}

impl Pipeline for PhotonTracing {
    const NAME: &'static str = "photon_tracing";
    const ABOUT: &'static str =
        "screen-space photon tracing (SPT): rays through layered depth, drawn as oriented sprites";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        scene.needs_objects(Self::NAME).map_err(GpuError::Unusable)?;
        let view = view(params, scene);
        let shared = &Shared::new(resources, &view);
        resources.push(Frame::new(view.clone(), shared));
        let geometry = &Geometry::new(resources, scene);

        let of_light = &resources.sized_by("shadow.size");
        let depth = shadow::depth::Depth::new(of_light, shared, geometry, params.shadow.size)?;
        let depth = of_light.push(depth);
        let cells = params.surface.cells;
        let mask =
            of_light.push(shadow::mask::Mask::new(of_light, shared, depth.texture(), cells)?);

        let of_grid = &resources.sized_by("transfer.grid");
        let [x, y] = params.transfer.grid;
        let settings = MapUniforms { grid: UVec2::new(x, y), masked: 1 };
        let map = of_grid.push(Map::new(of_grid, shared, mask.texture(), &settings)?);

        let size_px = view.size_px.to_array();
        let of_view = &resources.sized_by(VIEWPORT);
        let gbuffer =
            of_view.push(scene::gbuffer::Gbuffer::new(of_view, shared, geometry, size_px)?);
        let of_layers = &resources.sized_by("view × ldi.layers");
        let layers =
            ldi::peel::LayeredDepth::new(of_layers, shared, geometry, size_px, params.ldi.layers)?;
        let layers = &of_layers.push(layers).layers;

        let traced = Rays {
            transfers: &map.transfers,
            layers,
            bounds: scene.solid_bounds(),
            walking: params.rays.walking(resources.gpu.limits.max_texture_dimension_2d),
        };
        let photons = trace(resources, shared, &traced, params.rays.method)?;
        let sprite = sprite(params, &view);
        let sprites = Sprites::new(of_view, shared, &photons, layers, &sprite)?;
        let sprites = of_view.push(sprites);
        let irradiance = &sprites.irradiance;
        let exposure = params.compose.exposure;
        let compose = Compose::new(of_view, shared, &gbuffer.textures, irradiance, exposure)?;
        let compose = of_view.push(compose);
        let transfers = map.transfers.clone();
        Ok(Self { params: params.clone(), view, transfers, photons, compose })
    }

    fn image(&self) -> &wgpu::Texture {
        self.compose.texture()
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        self.measured_quantities(gpu)
    }

    fn judge(&self, judge: &mut Judge<'_>) -> Result<Judged, JudgeError> {
        self.landing_errors(judge.gpu, judge.scene)
    }
}

/// Pushes the stages that find where rays end.
fn trace(
    resources: &Resources<'_>,
    shared: &Shared,
    traced: &Rays<'_>,
    method: Method,
) -> Result<Photons, GpuError> {
    let of_rays = &resources.sized_by("transfer.grid");
    let photons = traced.transfers.count;
    let walked = |info, workgroups| {
        let stage = Walked::new(of_rays, info, shared, traced, workgroups)?;
        Ok(of_rays.push(stage).photons.clone())
    };
    match method {
        Method::Lines => {
            let of_tile = &resources.sized_by("view × rays.rows");
            let drawn = rays::rasterize::Rasterize::new(of_tile, shared, traced)?;
            let drawn = of_tile.push(drawn);
            let reduce = rays::reduce::Reduce::new(of_tile, &drawn.hits, traced.transfers)?;
            Ok(of_tile.push(reduce).photons.clone())
        }
        Method::March => walked(&rays::march::INFO, linear_workgroups(photons.into())),
        Method::Group => walked(&rays::group::INFO, group_each(photons)),
    }
}

fn view(params: &Params, scene: &Scene) -> View {
    View {
        camera: params.camera.clone(),
        light: params.light.clone(),
        water: params.water.with_tile_of(&scene.water),
        bounds: scene.bounds,
        size_px: UVec2::new(params.view.width, params.view.height),
        // The light's depth is read for the mask alone.
        edge_m: 0.1,
    }
}

fn sprite(params: &Params, view: &View) -> Sprite {
    let target = DVec3::from(params.camera.target_m);
    let middle_m = target.distance(DVec3::from(params.camera.position_m));
    let radius_m = params.sprites.radius_m;
    Sprite {
        radius_m,
        visible_m: params.sprites.visible_m,
        photon_w: view.light_frame().emitted_w / f64::from(params.photons()),
        side_px: 2.0 * radius_m / (view.pixel_tangent(params.view.height) * middle_m),
    }
}
