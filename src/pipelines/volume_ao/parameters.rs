//! Parameters of the pipeline `volume_ao`, their defaults with sources, and their ranges.

use crate::Parameters;
use crate::occlusion::RayModel;
use crate::settings::{self, Animation, Compose, Filter, Shadow, Viewport, Voxel, VoxelMethod};
use fathom_base::parameter::ParamError;
use fathom_base::settings;
use fathom_scene::{Camera, Grid, Light, Scene, SceneFile};
use fathom_stages::marching::{Marching, Occluder};

settings! {
    pub struct Params from file: SceneFile {
        view: Viewport = Viewport::default();
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 1e-5 ..= 1e5, "m";
        /// Only the first objects of the scene file; 0: all.
        objects: u32 = 0 => 0 ..= 1_000_000, "1";
        voxel: Voxel = Voxel { method: VoxelMethod::Overlap, ..Voxel::default() };
        animation: Animation = Animation::default();
        shadow: Shadow = Shadow::default();
        ao: Marching = Marching::default();
        filter: Filter = Filter::default();
        compose: Compose = Compose::default();
    }
}

/// Samples of a pixel and a volume at most, so that a frame ends.
const MAX_SAMPLES: u64 = 1 << 20;
/// The pyramid's level that rays are led by has cells of 4³ voxels.
const MIN_PYRAMID: u32 = 4;

impl Parameters for Params {
    const SEED: Option<&str> = Some("ao.seed");

    fn check_consistent(&self) -> Result<(), ParamError> {
        self.voxel.consistent()
    }

    fn upscaled(&self, factor: u32) -> Option<Self> {
        let mut larger = Self { view: self.view.upscaled(factor), ..self.clone() };
        larger.ao.scale /= f64::from(factor);
        Some(larger)
    }
}

impl Params {
    /// How rays are marched in a scene, with the distance that they reach.
    pub fn marching(&self, scene: &Scene) -> Marching {
        let r_max_m = settings::r_max_m(scene, self.ao.r_max_m, self.ao.r_max_share);
        Marching { r_max_m, ..self.ao.clone() }
    }

    /// Whether marching through these grids makes sense and comes to an end.
    ///
    /// # Errors
    /// One line naming the parameter at fault.
    pub fn fits(&self, scene: &Scene, grids: &[Grid]) -> Result<(), ParamError> {
        let marching = self.marching(scene);
        let r_max = if self.ao.r_max_m > 0.0 {
            "ao.r_max_m"
        } else {
            "ao.r_max_share × the scene's longest side"
        };
        for grid in grids {
            if marching.r_max_m < grid.voxel_m {
                return Err(ParamError::Unfit(format!(
                    "{r_max} is {:.3e} m, less than a voxel of {:.3e} m: raise it, or voxel.resolution",
                    marching.r_max_m, grid.voxel_m
                )));
            }
            let samples = f64::from(marching.rays) * marching.samples_in(grid);
            if samples > MAX_SAMPLES as f64 {
                return Err(ParamError::Unfit(format!(
                    "ao.rays × samples of a ray is {samples:.0}: at most {MAX_SAMPLES} samples are taken for a pixel"
                )));
            }
            let longest = grid.cells.into_iter().max().unwrap_or(0);
            if self.ao.skipping && longest < MIN_PYRAMID {
                return Err(ParamError::Unfit(format!(
                    "ao.skipping needs a volume of {MIN_PYRAMID} voxels along its longest side: this one has {longest}"
                )));
            }
        }
        Ok(())
    }

    /// What rays make of surfaces.
    pub(super) fn model(&self) -> RayModel {
        match (self.ao.occluder, self.voxel.method) {
            (Occluder::Binary, _) => RayModel::First(self.ao.attenuation),
            (Occluder::Opacity, VoxelMethod::MaxAlpha) => RayModel::Through,
            (Occluder::Opacity, _) => RayModel::ThroughOpaque,
        }
    }

    /// Pixels of the occlusion buffer.
    pub fn buffer_px(&self) -> [u32; 2] {
        settings::scaled([self.view.width, self.view.height], self.ao.scale)
    }
}
