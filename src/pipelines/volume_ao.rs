//! Volume ambient occlusion: Papaioannou, Menexi and Papadopoulos, *Real-time Volume-based Ambient Occlusion* (VAO).

mod measure;
mod parameters;

use glam::DMat4;

use super::Pipeline;
use super::lighting::{LitImage, VisibleScene};
use super::occlusion::OcclusionBuffers;
use super::settings::{self, Update};
use super::voxelization;
use fathom_gpu::GpuError;
use fathom_gpu::kit::Resources;
use fathom_scene::Scene;
use fathom_stages::ao;
use fathom_stages::bilateral::Window;
use fathom_stages::geometry::Geometry;
use fathom_stages::marching::Marching;
use fathom_stages::voxels::Voxels;

pub use measure::occlusion_at;
pub use parameters::Params;

/// Voxelization, rays marched through the volumes, filter, composition.
pub struct VolumeAo {
    marching: Marching,
    seen: VisibleScene,
    view_projection: DMat4,
    /// What is marched through.
    pub volumes: Vec<Voxels>,
    composed: LitImage,
    /// What the frame left of occlusion and of what the camera sees.
    pub buffers: OcclusionBuffers,
}

impl Pipeline for VolumeAo {
    const NAME: &'static str = "volume_ao";
    const ABOUT: &'static str = "volume ambient occlusion (VAO): voxelization, rays marched through the volume, filter, composition";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        scene.needs_objects(Self::NAME).map_err(GpuError::Unusable)?;
        let view = settings::view(&params.view, &params.camera, &params.light, scene);
        let view = settings::without_water(view, params.animation.bounds(scene));
        let view_projection = view.camera.view_projection(view.aspect());
        let shared = settings::begin(resources, &view);
        let geometry = Geometry::new(resources, scene);
        let volumes = voxelize(resources, &geometry, scene, params, params.voxel.update)?;
        let seen = VisibleScene::draw(resources, view, shared, &geometry, &params.shadow)?;
        let marching = params.marching(scene);
        let textures = &seen.gbuffer;
        let of_buffer = resources.with_size_hint("ao.rays × samples");
        let march = ao::march::new(
            &of_buffer,
            &seen.shared,
            &volumes,
            (textures, view_projection),
            &marching,
            params.buffer_px(),
            None,
        )?;
        let march = of_buffer.push(march);
        let filter =
            params.ao.filter.then_some((&ao::bilateral::INFO, &params.filter, Window::Disc));
        let composed =
            LitImage::new(resources, &seen, scene, &geometry, &march, filter, &params.compose)?;
        let buffers = OcclusionBuffers {
            gbuffer: textures.clone(),
            raw: (ao::march::INFO.name, march.clone()),
            filtered: composed.filtered.clone(),
            camera: params.camera.clone(),
            r_max_m: marching.r_max_m,
            model: params.model(),
            animation: params.animation.clone(),
        };
        Ok(Self { marching, seen, view_projection, volumes, composed, buffers })
    }
}

/// The volumes of a scene, once rays through them are known to make sense.
fn voxelize(
    resources: &Resources<'_>,
    geometry: &Geometry,
    scene: &Scene,
    params: &Params,
    update: Update,
) -> Result<Vec<Voxels>, GpuError> {
    let grids = params.voxel.grids(scene, &params.animation)?;
    params.fits(scene, &grids)?;
    let volumes = voxelization::Volumes { grids, update, pyramid: params.ao.skipping };
    voxelization::voxelize(resources, geometry, scene, &params.voxel, &params.animation, volumes)
}
