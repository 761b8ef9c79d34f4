//! Screen-space photon tracing: Krüger, Bürger and Westermann, *Interactive Screen-Space Accurate Photon Tracing on GPUs* (SPT).

mod measure;
mod parameters;

use std::f64::consts::PI;

use super::Pipeline;
use super::screen_tracing;
use super::settings::{self, VIEWPORT};
use fathom_gpu::GpuError;
use fathom_gpu::kit::{Buffer, Resources};
use fathom_scene::{Bounds, Scene};
use fathom_stages::gbuffer::GBuffer;
use fathom_stages::geometry::{Geometry, Objects};
use fathom_stages::ldi::peel;
use fathom_stages::photon::Photons;
use fathom_stages::picture::Shafts;
use fathom_stages::refraction::surface::{self, DryView};
use fathom_stages::scene;
use fathom_stages::screen_ray::{Layers, RayInputs, WalkUniforms, walk_uniforms};
use fathom_stages::shafts::blur;
use fathom_stages::shafts::lines;
use fathom_stages::sprites::compose::{self, SpriteOutput};
use fathom_stages::sprites::draw::{self, Sprite};
use fathom_stages::uniforms::{Shared, View};

use parameters::SpritePlane;

pub use parameters::Params;

/// Photons traced through layered depth, drawn as sprites.
pub struct PhotonTracing {
    params: Params,
    pub view: View,
    pub photons: Photons,
    layers: Layers,
    /// W/m² on what each pixel shows.
    irradiance: wgpu::Texture,
    image: wgpu::Texture,
}

impl Pipeline for PhotonTracing {
    const NAME: &'static str = "photon_tracing";
    const ABOUT: &'static str =
        "screen-space photon tracing (SPT): rays through layered depth, drawn as oriented sprites";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        scene.needs_objects(Self::NAME).map_err(GpuError::Unusable)?;
        let view = settings::view(&params.view, &params.camera, &params.light, scene);
        let shared = &settings::begin(resources, &view);
        let geometry = &Geometry::new(resources, scene);

        let (shadow_px, cells, grid) = (params.shadow.size, params.surface.cells, &params.transfer);
        let map = screen_tracing::transfers(resources, shared, geometry, shadow_px, cells, grid)?;

        let size_px = view.size_px.to_array();
        let of_view = &resources.with_size_hint(VIEWPORT);
        let gbuffer = of_view.push(scene::gbuffer::new(of_view, shared, geometry, size_px)?);
        let of_layers = &resources.with_size_hint("view × ldi.layers");
        let (of, layers) = (Objects::Solid, params.ldi.layers);
        let peel = peel::new(of_layers, shared, scene, geometry, of, size_px, layers)?;
        let layers = of_layers.push(peel);

        let [segments, max_hits] = [params.path_segments(), params.sprites.max_hits];
        let traced = RayInputs {
            transfers: &map.transfers,
            layers: &layers,
            bounds: under_water(scene),
            walking: params.rays.walking(resources.gpu, segments, max_hits),
        };
        let of_grid = &resources.with_size_hint("transfer.grid");
        let photons = screen_tracing::trace(of_grid, shared, &traced, params.rays.method)?;
        let (weights, seen) = (&map.weights, &gbuffer);
        let sprite = sprite(params, &view);
        let sprites = draw::new(of_view, shared, &photons, weights, &layers, &seen.depth, &sprite)?;
        let irradiance = of_view.push(sprites);
        let drawn = if params.shafts.draw {
            Some(shafts(of_view, shared, &photons, weights, seen, params, &view)?)
        } else {
            None
        };
        let shafts = drawn.as_ref().map(|(flux, scale)| Shafts { flux, scale: *scale });
        let exposure = params.compose.exposure;
        let compose = |composed: &SpriteOutput<'_>| -> Result<wgpu::Texture, GpuError> {
            let stage = compose::new(of_view, shared, seen, &irradiance, composed)?;
            Ok(of_view.push(stage))
        };
        let image = if params.surface.draw {
            let radiance = &compose(&SpriteOutput::Dry)?;
            let dry = DryView { layers: &layers, depth: &seen.depth, radiance };
            let walk = WalkUniforms {
                start_m: (START_M * scene.solid_bounds().tank_scale()) as f32,
                ..walk_uniforms(&layers, scene.solid_bounds(), params.rays.least_px)
            };
            let water = &view.water;
            of_view.push(surface::new(of_view, shared, &dry, &walk, water, shafts, exposure)?)
        } else {
            compose(&SpriteOutput::Picture { shafts, exposure })?
        };
        Ok(Self { params: params.clone(), view, photons, layers, irradiance, image })
    }
}

/// Lines of sight meet nothing nearer to the water's surface than this, metres in scene tank.
const START_M: f64 = 1e-3;

/// The box of what photons meet: they stay under water.
fn under_water(scene: &Scene) -> Bounds {
    let bounds = scene.solid_bounds();
    let top = bounds.max.y.min(scene.water.bound_m()).max(bounds.min.y);
    Bounds { max: bounds.max.with_y(top), ..bounds }
}

/// Pushes the stages that draw shafts; their sum in each pixel, and the radiance for each W of it.
fn shafts(
    of_view: &Resources<'_>,
    shared: &Shared,
    photons: &Photons,
    weights: &Buffer,
    seen: &GBuffer,
    params: &Params,
    view: &View,
) -> Result<(wgpu::Texture, f64), GpuError> {
    let pixel_m = view.pixel_tangent(view.size_px.into()) * params.middle_m();
    let photon_w = photon_w(params, view);
    let length_px = params.floor_depth_m / pixel_m;
    let lines = lines::new(of_view, shared, photons, weights, &seen.depth, photon_w, length_px)?;
    let lines = of_view.push(lines);
    let blur = of_view.push(blur::new(of_view, &lines, params.shafts.sigma_px)?);
    // A photon of the flux Φ along a line scatters σ Φ / 4π for each metre and steradian. Its line is a pixel wide.
    let scale = params.shafts.scattering_per_m / (4.0 * PI * pixel_m);
    Ok((blur, scale))
}

/// Flux of a photon of weight 1.
fn photon_w(params: &Params, view: &View) -> f64 {
    view.weighted_flux_w() / f64::from(params.transfer.photons())
}

fn sprite(params: &Params, view: &View) -> Sprite {
    let radius_m = params.sprites.radius_m;
    Sprite {
        radius_m,
        visible_m: params.sprites.visible_m,
        facing: params.sprites.plane == SpritePlane::Screen,
        photon_w: photon_w(params, view),
        side_px: 2.0 * radius_m / (view.pixel_tangent(view.size_px.into()) * params.middle_m()),
    }
}
