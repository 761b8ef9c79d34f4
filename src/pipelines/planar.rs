//! Caustics on planar receivers: Krüger, Bürger and Westermann, *Interactive Screen-Space Accurate Photon Tracing on GPUs* (SPT) §1.1, Fig. 2.
//!
//! The receivers are the floor and the four walls of a rectangular pool. The pipeline builds it in place of the scene's objects: the floor
//! lies at `floor_depth_m`, and the walls at the borders of the water, `water.center_m` and `water.half_size_m`.

mod measure;
mod parameters;

use glam::{DMat4, DQuat, DVec3};

use super::Pipeline;
use super::screen_tracing;
use super::settings::{self, VIEWPORT};
use fathom_base::parameter::{FieldMeta, Setting};
use fathom_gpu::GpuError;
use fathom_gpu::kit::Resources;
use fathom_reference::pool::Basin;
use fathom_scene::{Material, Object, Scene, generators};
use fathom_stages::geometry::Geometry;
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
        let scene = &with_pool(scene).map_err(GpuError::Unusable)?;
        let basin = Basin::from_water(&scene.water, params.floor_depth_m);
        let view = settings::view(&params.view, &params.camera, &params.light, scene);
        let shared = &settings::begin(resources, &view);
        let geometry = &Geometry::new(resources, scene);

        let (shadow_px, cells, grid) = (params.shadow.size, params.surface.cells, &params.transfer);
        let map = screen_tracing::transfers(resources, shared, geometry, shadow_px, cells, grid)?;
        let transfers = map.transfers;

        let of_view = &resources.with_size_hint(VIEWPORT);
        let size_px = view.size_px.to_array();
        let gbuffer = of_view.push(scene::gbuffer::new(of_view, shared, geometry, size_px)?);

        let of_map = &resources.with_size_hint("planar.texels");
        let pool = params.pool();
        let photon_w = view.weighted_flux_w() / f64::from(params.transfer.photons());
        let map = of_map.push(points::new(of_map, shared, &transfers, &pool, photon_w)?);
        let (exposure, shown) = (params.compose.exposure, params.compose.show);
        let compose = compose::new(of_view, shared, &gbuffer, &map, &pool, exposure, shown)?;
        let image = of_view.push(compose);
        Ok(Self { params: params.clone(), view, basin, transfers, map, image })
    }
}

/// Height of the rim and thickness of the walls in a pool whose shorter side is [`SIDE_M`]; in others they are as large for its size.
const RIM_M: f64 = 0.12;
const WALL_M: f64 = 0.2;
const SIDE_M: f64 = 4.0;

/// The scene with the pool of its water and floor depth in place of its objects. It looks like the first of them.
///
/// # Errors
/// A side or a depth that is hundreds of times another.
fn with_pool(scene: &Scene) -> Result<Scene, String> {
    let [half_x, half_z] = scene.water.half_size_m;
    let scale = 2.0 * half_x.min(half_z) / SIDE_M;
    let (width_m, depth_m) = (2.0 * half_x / scale, 2.0 * half_z / scale);
    let sizes = generators::Basin { width_m, depth_m, rim_m: RIM_M, wall_m: WALL_M };
    sizes.check(FieldMeta::new("pool", "")).map_err(|error| error.to_string())?;
    let mesh = generators::basin(&sizes, scene.floor_depth_m / scale);
    mesh.validate()?;
    let [x, z] = scene.water.center_m;
    let place = DMat4::from_scale_rotation_translation(
        DVec3::splat(scale),
        DQuat::IDENTITY,
        DVec3::new(x, -scene.floor_depth_m, z),
    );
    let first = scene.objects.first();
    let material = first.map_or_else(Material::default, |object| object.material.clone());
    let pool = Object { material, ..Object::new("pool", mesh.transformed(&place)) };
    Ok(scene.with_objects(vec![pool]))
}
