//! Real-time voxelization alone: Papaioannou, Menexi and Papadopoulos, *Real-time Volume-based Ambient Occlusion* (VAO), §4.

use std::collections::BTreeMap;

use super::settings::{self, Animation, Update, VIEWPORT, Voxel};
use super::voxelization;
use super::{Parameters, Pipeline, PipelineInstance, to_map};
use fathom_base::parameter::ParamError;
use fathom_gpu::kit::Resources;
use fathom_gpu::{Gpu, GpuError, Stage, read_buffer, texture_bytes};
use fathom_scene::{Camera, Light, Scene, SceneFile};
use fathom_stages::geometry::Geometry;
use fathom_stages::uniforms::Shared;
use fathom_stages::voxel::view;
use fathom_stages::voxels::Voxels;

fathom_base::settings! {
    pub struct Params from file: SceneFile {
        /// Pixels of the picture; the volume does not depend on them.
        view: settings::Viewport = settings::Viewport::default();
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 1e-5 ..= 1e5, "m";
        /// Only the first objects of the scene file; 0: all.
        objects: u32 = 0 => 0 ..= 1_000_000, "1";
        voxel: Voxel = Voxel::default();
        /// Whether the occupancy pyramid is part of the frame. VAO §6.3.
        pyramid: bool = false;
        animation: Animation = Animation::default();
    }
}

impl Parameters for Params {
    fn check_consistent(&self) -> Result<(), ParamError> {
        self.voxel.consistent()?;
        if self.voxel.update == Update::Once {
            let fault = "voxel.update is once: that leaves a frame of voxelize nothing to do; use every_frame";
            return Err(ParamError::Unfit(fault.into()));
        }
        Ok(())
    }

    fn upscaled(&self, factor: u32) -> Option<Self> {
        Some(Self { view: self.view.upscaled(factor), ..self.clone() })
    }
}

/// The volumes that a frame fills, and what draws them.
pub struct Voxelize {
    pub volumes: Vec<Voxels>,
    view: Stage,
    picture: wgpu::Texture,
}

impl Pipeline for Voxelize {
    const NAME: &'static str = "voxelize";
    const ABOUT: &'static str =
        "real-time voxelization (VAO §4): slicemaps, slices, or triangles against voxels";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        scene.needs_objects(Self::NAME).map_err(GpuError::Unusable)?;
        let geometry = Geometry::new(resources, scene);
        let volumes = voxelization::Volumes {
            grids: params.voxel.grids(scene, &params.animation)?,
            update: params.voxel.update,
            pyramid: params.pyramid,
        };
        let (voxel, animation) = (&params.voxel, &params.animation);
        let volumes =
            voxelization::voxelize(resources, &geometry, scene, voxel, animation, volumes)?;
        let picture = &resources.for_pictures().with_size_hint(VIEWPORT);
        let view = settings::view(&params.view, &params.camera, &params.light, scene);
        let shared = Shared::new(picture, &view);
        let cubes = view::new(picture, &shared, &volumes, view.size_px.to_array())?;
        let (view, cubes) = cubes.split();
        Ok(Self { volumes, view, picture: cubes.picture })
    }
}

impl PipelineInstance for Voxelize {
    fn image(&self) -> &wgpu::Texture {
        &self.picture
    }

    fn presenting(&self) -> Vec<&Stage> {
        vec![&self.view]
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let mut occupied = 0.0;
        for voxels in &self.volumes {
            let words: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &voxels.bits)?);
            occupied += words.iter().map(|w| f64::from(w.count_ones())).sum::<f64>();
        }
        let sum = |bytes: fn(&Voxels) -> u64| self.volumes.iter().map(bytes).sum::<u64>() as f64;
        Ok(to_map([
            ("occupied_voxels", occupied),
            ("occupied_share", occupied / sum(|v| v.grid.count())),
            ("bit_volume_bytes", sum(|v| v.bits.size())),
            ("texture_volume_bytes", sum(|v| texture_bytes(&v.texture))),
        ]))
    }
}
