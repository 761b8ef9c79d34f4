//! Screen-space photon tracing: Krüger, Bürger and Westermann, *Interactive Screen-Space Accurate Photon Tracing on GPUs* (SPT).

mod measure;
mod parameters;

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::Path;
use std::rc::Rc;

use glam::UVec2;

use super::caustics_image::{Compared, IMAGE_ERROR};
use super::settings::VIEWPORT;
use super::{Judge, JudgeError, Judged, Pipeline};
use crate::gpu::{Gpu, GpuError};
use crate::scene::Scene;
use crate::stages::frame::{Frame, Shared, View};
use crate::stages::gbuffer::GbufferTextures;
use crate::stages::geometry::Geometry;
use crate::stages::kit::{Resources, linear_workgroups};
use crate::stages::photon::Photons;
use crate::stages::screen_ray::{FragmentLists, Layers, Rays, Walked, group_each};
use crate::stages::shafts::blur::Blur;
use crate::stages::shafts::lines::Lines;
use crate::stages::sprites::compose::Compose;
use crate::stages::sprites::draw::{Sprite, Sprites};
use crate::stages::transfer::map::{Map, MapUniforms};
use crate::stages::{ldi, rays, scene, shadow};

pub use parameters::{LayerMethod, LayeredDepth, Method, Params};

/// Photons traced through layered depth, drawn as sprites.
pub struct PhotonTracing {
    params: Params,
    pub view: View,
    pub photons: Photons,
    lists: Option<FragmentLists>,
    /// W/m² on what each pixel shows.
    irradiance: wgpu::Texture,
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
        let settings = MapUniforms { grid: UVec2::new(x, y) };
        let map = of_grid.push(Map::new(of_grid, shared, mask.texture(), &settings)?);

        let size_px = view.size_px.to_array();
        let of_view = &resources.sized_by(VIEWPORT);
        let gbuffer =
            of_view.push(scene::gbuffer::Gbuffer::new(of_view, shared, geometry, size_px)?);
        let of_layers = &resources.sized_by("view × ldi.layers");
        let (layers, lists) = layers(of_layers, shared, geometry, size_px, &params.ldi)?;

        let traced = Rays {
            transfers: &map.transfers,
            layers: &layers,
            bounds: scene.solid_bounds(),
            walking: params.rays.walking(resources.gpu.limits.max_texture_dimension_2d),
        };
        let photons = trace(resources, shared, &traced, params.rays.method)?;
        let sprite = sprite(params, &view);
        let sprites = Sprites::new(of_view, shared, &photons, &layers, &sprite)?;
        let sprites = of_view.push(sprites);
        let seen = &gbuffer.textures;
        let drawn = if params.shafts.draw {
            Some(shafts(of_view, shared, &photons, seen, params, &view)?)
        } else {
            None
        };
        let shafts = drawn.as_ref().map(|(blur, scale)| (blur.texture(), *scale));
        let exposure = params.compose.exposure;
        let compose = Compose::new(of_view, shared, seen, &sprites.irradiance, shafts, exposure)?;
        let compose = of_view.push(compose);
        let irradiance = sprites.irradiance.clone();
        Ok(Self { params: params.clone(), view, photons, lists, irradiance, compose })
    }

    fn image(&self) -> &wgpu::Texture {
        self.compose.texture()
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        self.measured_quantities(gpu)
    }

    fn judge(&self, judge: &mut Judge<'_>) -> Result<Judged, JudgeError> {
        let mut judged = self.landing_errors(judge.gpu, judge.scene)?;
        if judge.asks_for(IMAGE_ERROR) {
            judged.add(self.caustics(judge)?.judged());
        }
        Ok(judged)
    }

    fn caustics(&self, judge: &mut Judge<'_>) -> Result<Compared, JudgeError> {
        let found = self.found_caustics(judge.gpu)?;
        Compared::new(judge, &self.view, &found)
    }

    fn error_picture(&self, judge: &mut Judge<'_>, path: &Path) -> Result<(), JudgeError> {
        self.caustics(judge)?.error_picture(path)
    }
}

/// Pushes the stages that find the layers; the lists, where there are any.
fn layers(
    resources: &Resources<'_>,
    shared: &Shared,
    geometry: &Geometry,
    size_px: [u32; 2],
    settings: &LayeredDepth,
) -> Result<(Layers, Option<FragmentLists>), GpuError> {
    let count = settings.layers;
    match settings.method {
        LayerMethod::Peel => {
            let peel = ldi::peel::LayeredDepth::new(resources, shared, geometry, size_px, count)?;
            Ok((resources.push(peel).layers.clone(), None))
        }
        LayerMethod::Lists => {
            let room = settings.fragments_per_pixel;
            let lists = ldi::lists::Lists::new(resources, shared, geometry, size_px, room)?;
            let lists = resources.push(lists).lists.clone();
            let sort = ldi::sort::Sort::new(resources, &lists, count)?;
            Ok((resources.push(sort).layers.clone(), Some(lists)))
        }
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

/// Pushes the stages that draw shafts; their sum in each pixel, and the radiance for each W of it.
fn shafts(
    of_view: &Resources<'_>,
    shared: &Shared,
    photons: &Photons,
    seen: &GbufferTextures,
    params: &Params,
    view: &View,
) -> Result<(Rc<Blur>, f64), GpuError> {
    let pixel_m = view.pixel_tangent(params.view.height) * params.middle_m();
    let photon_w = photon_w(params, view);
    let length_px = params.floor_depth_m / pixel_m;
    let lines = Lines::new(of_view, shared, photons, &seen.depth, (photon_w, length_px))?;
    let lines = of_view.push(lines);
    let blur =
        of_view.push(Blur::new(of_view, (&lines.target, Lines::column()), params.shafts.sigma_px)?);
    // A photon of the flux Φ along a line scatters σ Φ / 4π for each metre and steradian. Its line is a pixel wide.
    let scale = params.shafts.scattering_per_m / (4.0 * PI * pixel_m);
    Ok((blur, scale))
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

/// Flux that each photon has of the light's.
fn photon_w(params: &Params, view: &View) -> f64 {
    view.light_frame().emitted_w / f64::from(params.photons())
}

fn sprite(params: &Params, view: &View) -> Sprite {
    let radius_m = params.sprites.radius_m;
    Sprite {
        radius_m,
        visible_m: params.sprites.visible_m,
        photon_w: photon_w(params, view),
        side_px: 2.0 * radius_m / (view.pixel_tangent(params.view.height) * params.middle_m()),
    }
}
