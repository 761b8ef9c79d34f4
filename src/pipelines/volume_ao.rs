//! Volume ambient occlusion: Papaioannou, Menexi and Papadopoulos, *Real-time Volume-based Ambient Occlusion* (VAO).

mod measure;
mod parameters;

use std::collections::BTreeMap;

use glam::UVec2;
use serde_json::Value;

use super::settings::{
    self, COMPOSE_FETCHES, DEPTH_BYTES, GBUFFER_BYTES, IMAGE_BYTES, Update, VIEWPORT,
    VISIBILITY_BYTES, filter_fetches, pass_demand,
};
use super::voxelization::{self, Voxelization};
use super::{Kind, Pipeline};
use crate::gpu::{Demand, Gpu, GpuError};
use crate::record::Work;
use crate::scene::{Grid, Scene};
use crate::stages::frame::{Frame, Shared, View};
use crate::stages::geometry::Geometry;
use crate::stages::kit::Resources;
use crate::stages::marching::Marching;
use crate::stages::scene::deform::Deform;
use crate::stages::voxels::Voxels;
use crate::stages::{self, Stage, ao, bilateral, scene, shadow};

pub use measure::occlusion_at;
pub use parameters::{Ao, Params};

pub const KIND: Kind = Kind {
    name: "volume_ao",
    about: "volume ambient occlusion (VAO): voxelization, rays marched through the volume, filter, composition",
    stages: &[
        stages::frame::INFO,
        stages::scene::deform::INFO,
        stages::voxel::clear::INFO,
        stages::voxel::slicemap::INFO_X,
        stages::voxel::slicemap::INFO_Y,
        stages::voxel::slicemap::INFO_Z,
        stages::voxel::combine::INFO,
        stages::voxel::slice::INFO,
        stages::voxel::overlap::INFO,
        stages::voxel::alpha::INFO,
        stages::voxel::unpack::INFO,
        stages::voxel::mips::INFO,
        stages::shadow::depth::INFO,
        stages::scene::gbuffer::INFO,
        stages::ao::march::INFO,
        stages::ao::bilateral::INFO,
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
        Ok(Box::new(VolumeAo::new(gpu, scene, params)?))
    },
};

fn demand(params: &Value, scene: &Scene) -> Result<Demand, String> {
    scene.needs_objects("volume_ao")?;
    let params = Params::from_value(params)?;
    let (voxel, animation) = (&params.voxel, &params.animation);
    let grids = voxel.grids(scene, &params.camera, animation)?;
    params.fits(scene, &grids)?;
    let samples = samples(&params, scene, &grids);
    let size_px = [params.view.width, params.view.height];
    let shadow = [params.shadow.size; 2];
    let taps = filter_fetches(params.ao.filter, &params.filter);
    let filter_bytes = u64::from(params.ao.filter) * VISIBILITY_BYTES;
    let view_bytes = GBUFFER_BYTES + IMAGE_BYTES + filter_bytes;
    let demand = pass_demand(size_px, VIEWPORT, view_bytes, COMPOSE_FETCHES + taps)
        .and(pass_demand(params.buffer_px(), "ao.rays × samples", VISIBILITY_BYTES, samples))
        .and(pass_demand(shadow, "shadow.size", DEPTH_BYTES, 0))
        .and(settings::picture_demand(size_px))
        .and(settings::shared_demand())
        .and(settings::geometry_demand(scene))
        .color_targets("scene/gbuffer", 2, 12);
    let demand = settings::deform_demand(demand, scene, animation);
    let pyramid = params.ao.skipping;
    voxelization::demand(demand, scene, &params.camera, voxel, animation, pyramid)
}

/// Samples of a point at most, in all volumes.
fn samples(params: &Params, scene: &Scene, grids: &[Grid]) -> u64 {
    let marching = params.ao.marching(scene);
    let samples = |grid| u64::from(marching.rays) * marching.samples_in(grid) as u64;
    grids.iter().map(samples).sum()
}

/// What asking for so many points takes, beside the volumes.
///
/// # Errors
/// Settings that give no grid.
pub fn query_demand(params: &Params, scene: &Scene, points: u64) -> Result<Demand, String> {
    let (voxel, animation) = (&params.voxel, &params.animation);
    let grids = voxel.grids(scene, &params.camera, animation)?;
    let work = Work {
        texel_fetches: points.saturating_mul(samples(params, scene, &grids)),
        ..Work::default()
    };
    Ok(ao::query::demand(points).takes("points × ao.rays × samples", work))
}

/// A scene's geometry, what moves it, and its volumes.
struct Solids {
    geometry: Geometry,
    deform: Option<Deform>,
    voxelization: Voxelization,
}

impl Solids {
    /// Volumes that are made once are filled on return.
    fn new(
        resources: &Resources<'_>,
        scene: &Scene,
        params: &Params,
        update: Update,
    ) -> Result<Self, GpuError> {
        let geometry = Geometry::new(resources, scene);
        let deform = settings::deform(resources, &geometry, scene, &params.animation)?;
        let voxelization = Voxelization::new(
            resources,
            &geometry,
            scene,
            &params.camera,
            &params.voxel,
            &params.animation,
            params.ao.skipping,
        )?;
        let solids = Self { geometry, deform, voxelization };
        if update == Update::Once {
            let stages: Vec<&dyn Stage> = solids.moving().chain(solids.filling()).collect();
            resources.gpu.run(&stages)?;
        }
        Ok(solids)
    }

    fn moving(&self) -> impl Iterator<Item = &dyn Stage> {
        self.deform.iter().map(|deform| deform as &dyn Stage)
    }

    fn filling(&self) -> impl Iterator<Item = &dyn Stage> {
        self.voxelization.stages().into_iter()
    }
}

/// The stages of a frame, in order.
pub struct VolumeAo {
    params: Params,
    marching: Marching,
    shared: Shared,
    frame: Frame,
    solids: Solids,
    shadow: shadow::depth::Depth,
    gbuffer: scene::gbuffer::Gbuffer,
    seen: ao::march::Inputs,
    march: ao::march::March,
    filter: Option<ao::bilateral::Bilateral>,
    compose: ao::compose::Compose,
    allocated_bytes: u64,
}

impl VolumeAo {
    /// Builds all resources and pipelines; `scene` gives geometry and water, `params` all else.
    ///
    /// # Errors
    /// What the GPU reports, and a scene or settings that give no grid.
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
        let solids = Solids::new(resources, scene, &params, params.voxel.update)?;
        let geometry = &solids.geometry;
        let shadow = shadow::depth::Depth::new(resources, &shared, geometry, params.shadow.size)?;
        let size_px = view.size_px.to_array();
        let gbuffer = scene::gbuffer::Gbuffer::new(resources, &shared, geometry, size_px)?;

        let marching = params.ao.marching(scene);
        let seen = ao::march::Inputs {
            depth: gbuffer.depth.clone(),
            normal: gbuffer.normal.clone(),
            view_projection: view.camera.view_projection(view.aspect()),
        };
        let volumes = &solids.voxelization.volumes;
        let buffer_px = params.buffer_px();
        let march =
            ao::march::March::new(resources, &shared, volumes, &seen, &marching, buffer_px)?;
        let guided = bilateral::Inputs { visibility: march.texture(), depth: &gbuffer.depth };
        let filter = params
            .ao
            .filter
            .then(|| {
                let settings = params.filter.uniforms(&view, buffer_px);
                ao::bilateral::Bilateral::new(resources, &shared, &guided, &settings)
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
            params,
            marching,
            frame: Frame::new(view, &shared),
            shared,
            solids,
            shadow,
            gbuffer,
            seen,
            march,
            filter,
            compose,
            allocated_bytes: resources.allocated_bytes(),
        })
    }

    /// The volumes that are marched through.
    pub fn volumes(&self) -> &[Voxels] {
        &self.solids.voxelization.volumes
    }

    /// Visibility 1 − A before the filter.
    pub fn visibility(&self) -> &wgpu::Texture {
        self.march.texture()
    }

    pub fn gbuffer(&self) -> &scene::gbuffer::Gbuffer {
        &self.gbuffer
    }
}

impl Pipeline for VolumeAo {
    fn stages(&self) -> Vec<&dyn Stage> {
        let mut stages: Vec<&dyn Stage> = vec![&self.frame];
        stages.extend(self.solids.moving());
        if self.params.voxel.update == Update::EveryFrame {
            stages.extend(self.solids.filling());
        }
        stages.extend([&self.shadow as &dyn Stage, &self.gbuffer, &self.march]);
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

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        self.measured_quantities(gpu)
    }
}
