//! Real-time voxelization alone: Papaioannou, Menexi and Papadopoulos, *Real-time Volume-based Ambient Occlusion* (VAO), §4.

use std::collections::BTreeMap;

use glam::UVec2;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::settings::{self, Animation, DEPTH_BYTES, IMAGE_BYTES, Update, VIEWPORT, Voxel};
use super::voxelization::{self, Voxelization};
use super::{Kind, Pipeline};
use crate::gpu::{Demand, Gpu, GpuError, read_buffer, texture_bytes};
use crate::scene::{Camera, Light, Scene, SceneFile};
use crate::stages::frame::{Shared, View};
use crate::stages::geometry::Geometry;
use crate::stages::kit::Resources;
use crate::stages::scene::deform::Deform;
use crate::stages::voxel::view::CubeView;
use crate::stages::voxels::Voxels;
use crate::stages::{self, Stage};

pub const KIND: Kind = Kind {
    name: "voxelize",
    about: "real-time voxelization (VAO §4): slicemaps, slices, or triangles against voxels",
    stages: &[
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
    ],
    defaults: |file| Params::from_scene(file).to_value(),
    scene_file,
    demand,
    build: |gpu, scene, params| {
        let params = Params::from_value(params).map_err(GpuError::Limit)?;
        Ok(Box::new(Voxelize::new(gpu, scene, params)?))
    },
};

/// Step between neighbouring texels of the light's depth: this pipeline has no shadow map, and the shared uniforms take any.
const UNUSED_EDGE_M: f64 = 0.1;

/// Everything that can be set. The dotted paths of `--set` are these fields' names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// Pixels of the picture; the volume does not depend on them.
    pub view: settings::View,
    pub camera: Camera,
    pub light: Light,
    /// Depth of the scene's floor under the resting water, metres.
    pub floor_depth_m: f64,
    /// Only the first objects of the scene file; 0: all.
    pub objects: u32,
    pub voxel: Voxel,
    /// Whether the occupancy pyramid is part of the frame. VAO §6.3.
    pub pyramid: bool,
    pub animation: Animation,
}

impl Params {
    /// Defaults with what the scene file says of camera, light and floor.
    pub fn from_scene(file: &SceneFile) -> Self {
        Self {
            view: settings::View::default(),
            camera: file.camera.clone(),
            light: file.light.clone(),
            floor_depth_m: file.floor_depth_m,
            objects: 0,
            voxel: Voxel::default(),
            pyramid: false,
            animation: Animation::default(),
        }
    }

    pub fn to_value(&self) -> Value {
        serde_json::to_value(self).expect("parameters are plain numbers and names")
    }

    /// Reads and checks a parameter tree.
    ///
    /// # Errors
    /// One line naming the parameter and its range.
    pub fn from_value(value: &Value) -> Result<Self, String> {
        let params: Self = serde_path_to_error::deserialize(value)
            .map_err(|error| format!("{}: {}", error.path(), error.inner()))?;
        params.view.validate()?;
        params.camera.validate()?;
        params.light.validate()?;
        params.voxel.validate()?;
        params.animation.validate()?;
        if params.voxel.update == Update::Once {
            return Err("voxel.update is once: that leaves a frame of voxelize nothing to do; use every_frame".into());
        }
        Ok(params)
    }
}

fn scene_file(file: &SceneFile, params: &Value) -> Result<SceneFile, String> {
    let params = Params::from_value(params)?;
    let mut file = SceneFile {
        floor_depth_m: params.floor_depth_m,
        camera: params.camera,
        light: params.light,
        ..file.clone()
    };
    settings::keep_first(&mut file, params.objects);
    Ok(file)
}

fn demand(params: &Value, scene: &Scene) -> Result<Demand, String> {
    scene.needs_objects("voxelize")?;
    let params = Params::from_value(params)?;
    let [width, height] = [params.view.width, params.view.height].map(u64::from);
    // The picture and its depth are no part of the pipeline's memory, but the process has them.
    let demand = Demand::new()
        .texture_2d(VIEWPORT, width, height)
        .copies(VIEWPORT, (width * height).saturating_mul(IMAGE_BYTES + DEPTH_BYTES))
        .and(settings::picture_demand([params.view.width, params.view.height]))
        .and(settings::geometry_demand(scene));
    let demand = settings::deform_demand(demand, scene, &params.animation);
    let (voxel, animation) = (&params.voxel, &params.animation);
    voxelization::demand(demand, scene, &params.camera, voxel, animation, params.pyramid)
}

/// The stages of a frame, and what draws its volumes.
pub struct Voxelize {
    deform: Option<Deform>,
    voxelization: Voxelization,
    view: CubeView,
    allocated_bytes: u64,
}

impl Voxelize {
    /// Builds all resources and pipelines; `scene` gives the geometry, `params` all else.
    ///
    /// # Errors
    /// What the GPU reports, and a scene or settings that give no grid.
    pub fn new(gpu: &Gpu, scene: &Scene, params: Params) -> Result<Self, GpuError> {
        let resources = &Resources::new(gpu);
        let geometry = Geometry::new(resources, scene);
        let deform = settings::deform(resources, &geometry, scene, &params.animation)?;
        let voxelization = Voxelization::new(
            resources,
            &geometry,
            scene,
            &params.camera,
            &params.voxel,
            &params.animation,
            params.pyramid,
        )?;
        // What the picture takes is no part of the pipeline's memory.
        let allocated_bytes = resources.allocated_bytes();
        let size_px = [params.view.width, params.view.height];
        let shared = Shared::new(
            resources,
            &View {
                camera: params.camera,
                light: params.light,
                water: scene.water.clone(),
                bounds: scene.bounds,
                size_px: UVec2::from(size_px),
                edge_m: UNUSED_EDGE_M,
            },
        );
        let view = CubeView::new(resources, &shared, &voxelization.volumes, size_px)?;
        Ok(Self { deform, voxelization, view, allocated_bytes })
    }

    /// The volumes that a frame fills.
    pub fn volumes(&self) -> &[Voxels] {
        &self.voxelization.volumes
    }
}

impl Pipeline for Voxelize {
    fn stages(&self) -> Vec<&dyn Stage> {
        let deform = self.deform.iter().map(|deform| deform as &dyn Stage);
        deform.chain(self.voxelization.stages()).collect()
    }

    fn allocated_bytes(&self) -> u64 {
        self.allocated_bytes
    }

    fn image(&self) -> &wgpu::Texture {
        self.view.texture()
    }

    fn presenting(&self) -> Vec<&dyn Stage> {
        vec![&self.view]
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let mut occupied = 0.0;
        for voxels in self.volumes() {
            let words: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &voxels.bits)?);
            occupied += words.iter().map(|w| f64::from(w.count_ones())).sum::<f64>();
        }
        let sum = |bytes: fn(&Voxels) -> u64| self.volumes().iter().map(bytes).sum::<u64>() as f64;
        let figures = [
            ("occupied_voxels", occupied),
            ("occupied_share", occupied / sum(|v| v.grid.count())),
            ("bit_volume_bytes", sum(|v| v.bits.size())),
            ("texture_volume_bytes", sum(|v| texture_bytes(&v.texture))),
        ];
        Ok(figures.map(|(name, value)| (name.to_owned(), value)).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn params(change: impl FnOnce(&mut Params)) -> Result<Params, String> {
        let mut params = Params::from_scene(&SceneFile::load("plane").unwrap());
        change(&mut params);
        Params::from_value(&params.to_value())
    }

    #[test]
    fn faults_name_the_parameter_and_its_range() {
        assert!(params(|_| ()).is_ok());
        let fault = |change: fn(&mut Params)| params(change).unwrap_err();
        assert!(fault(|p| p.voxel.resolution = 3).contains("voxel.resolution is 3"));
        assert!(fault(|p| p.voxel.cells = [0, 4, 4]).contains("voxel.cells is 0"));
        assert!(fault(|p| p.animation.rate_hz = f64::NAN).contains("animation.rate_hz"));
        assert!(fault(|p| p.voxel.update = Update::Once).contains("voxel.update is once"));
        assert!(fault(|p| p.view.width = 0).contains("view.width is 0"));
    }

    #[test]
    fn what_an_adapter_lacks_is_named_before_anything_is_made() {
        let file = SceneFile::load("plane").unwrap();
        let scene = Scene::build(&file).unwrap();
        let limits = wgpu::Limits { max_texture_dimension_3d: 256, ..wgpu::Limits::default() };
        let beyond = |change: &dyn Fn(&mut Params)| -> String {
            let mut params = Params::from_scene(&file);
            change(&mut params);
            let demand = demand(&params.to_value(), &scene);
            demand.and_then(|d| d.check(&limits)).unwrap_err()
        };
        let message = beyond(&|p| p.voxel.resolution = 512);
        assert!(message.contains("voxel.resolution: asks 512 of max_texture_dimension_3d"));
        let message = beyond(&|p| {
            p.voxel.cells = [256; 3];
            p.voxel.origin_m = [-10.0, -4.0, -10.0];
            p.voxel.voxel_m = 0.1;
            p.voxel.method = settings::Method::MaxAlpha;
            p.view.width = 9000;
        });
        assert!(message.contains("view.width"), "{message}");
        let message = beyond(&|p| {
            p.voxel.cells = [2000, 2000, 4000];
            p.voxel.origin_m = [-10.0, -4.0, -10.0];
            p.voxel.voxel_m = 0.1;
        });
        assert!(message.contains("voxel.cells"), "{message}");
    }
}
