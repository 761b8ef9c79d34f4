//! Parameters of the pipeline `volume_ao`, their defaults with sources, and their ranges.

use crate::Parameters;
use crate::occlusion::Model;
use crate::settings::{
    self, Animation, Attenuation, Compose, Filter, Method, R_MAX_SHARE, Shadow, View, Voxel,
};
use fathom_base::parameter::ParamError;
use fathom_base::settings;
use fathom_scene::{Camera, Grid, Light, Scene, SceneFile};
use fathom_stages::marching::{Estimator, Guard, Hit, Marching, Occluder, Sampling, Step, Storage};

settings! {
    /// Everything that can be set. The dotted paths of `--set` are these fields' names.
    pub struct Params from file: SceneFile {
        view: View = View::default();
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 0.01 ..= 1000.0, "m";
        /// Only the first objects of the scene file; 0: all.
        objects: u32 = 0 => 0 ..= 1_000_000, "1";
        voxel: Voxel = Voxel { method: Method::Overlap, ..Voxel::default() };
        animation: Animation = Animation::default();
        shadow: Shadow = Shadow::default();
        ao: Ao = Ao::default();
        filter: Filter = Filter::default();
        compose: Compose = Compose::default();
    }
}

settings! {
    /// How rays are marched from surface points.
    pub struct Ao {
        /// N_dir. With 8 samples each, 50 rays take the 400 samples of VAO Fig. 8.
        rays: u32 = 50 => 1 ..= 65536, "1";
        /// N_samples where `step` is `paper`. VAO §6.3: 8 to 12.
        samples: u32 = 8 => 1 ..= 65536, "1";
        /// Distance up to which geometry occludes; 0: `r_max_share`.
        r_max_m: f64 = 0.0 => 0.0 ..= 1e4, "m";
        /// The same as a share of the scene's longest side.
        r_max_share: f64 = R_MAX_SHARE => 1e-3 ..= 4.0, "1";
        /// How occluders weigh by their distance.
        attenuation: Attenuation = Attenuation::Linear;
        /// What the rays' mean estimates.
        estimator: Estimator = Estimator::Unbiased;
        /// V_thres. VAO §6.5: 0.2 to 0.8, for volumes from slicemaps. The default is for the thicker shells of `voxel.method`
        /// overlap, which leave no gap at any slant. It was chosen from the map of errors, by the worst orientation and scene:
        /// docs/volume-ao.md.
        /// Above 1 no sample ends a ray: each takes all its samples, as memory is measured by.
        threshold: f64 = 0.9 => 0.01 ..= 2.0, "1";
        /// Where the first sample of a ray lies.
        guard: Guard = Guard::Variable;
        /// Whether each ray's samples are moved along it by a random share of a step, which turns bands into noise. VAO §5.2.3.
        jitter: bool = false;
        /// What the step follows.
        step: Step = Step::Voxel;
        /// Step where `step` is `voxel`. At more than one, rays pass through walls of one voxel. The default was chosen from the map of
        /// errors, by the worst orientation and scene: docs/volume-ao.md.
        step_voxels: f64 = 1.0 => 0.01 ..= 100.0, "voxels";
        /// How far along its normal a surface's rays begin: VAO §6.1's small offset. It keeps coarse or curved surfaces from
        /// occluding themselves at low thresholds. VAO §5.1 has none: 0. The default was chosen from the map of errors, by the worst
        /// orientation and scene: docs/volume-ao.md.
        offset_voxels: f64 = 0.1 => 0.0 ..= 100.0, "voxels";
        /// Where a hit is taken to lie. The default was chosen from the map of errors, by the worst orientation and scene:
        /// docs/volume-ao.md.
        hit: Hit = Hit::Peak;
        /// How directions are drawn.
        sampling: Sampling = Sampling::Stratified;
        /// Draws other directions at every pixel.
        seed: u32 = 0 => 0 ..= 4_294_967_295u32, "1";
        /// What samples read.
        storage: Storage = Storage::Texture;
        /// Whether rays leave empty cells of an occupancy pyramid in one go. VAO §6.3.
        skipping: bool = false;
        /// What a sample above the threshold does.
        occluder: Occluder = Occluder::Binary;
        /// Size of the occlusion buffer relative to the viewport. VAO §6.2: ½ in Fig. 11.
        scale: f64 = 1.0 => 0.05 ..= 1.0, "1";
        /// Whether the buffer is smoothed and brought to the viewport's size.
        filter: bool = true;
    }
}

/// Samples of a pixel and a volume at most, so that a frame ends.
const MAX_SAMPLES: u64 = 1 << 20;
/// The pyramid's level that rays are led by has cells of 4³ voxels.
const LEAST_PYRAMID: u32 = 4;

impl Ao {
    /// For a scene.
    pub fn marching(&self, scene: &Scene) -> Marching {
        self.marching_to(settings::r_max_m(scene, self.r_max_m, self.r_max_share))
    }

    /// For a given r_max, metres.
    pub fn marching_to(&self, r_max_m: f64) -> Marching {
        Marching {
            rays: self.rays,
            samples: self.samples,
            step_voxels: self.step_voxels,
            r_max_m,
            threshold: self.threshold,
            seed: self.seed,
            offset_voxels: self.offset_voxels,
            attenuation: self.attenuation,
            estimator: self.estimator,
            guard: self.guard,
            jitter: self.jitter,
            step: self.step,
            sampling: self.sampling,
            storage: self.storage,
            skipping: self.skipping,
            occluder: self.occluder,
            hit: self.hit,
        }
    }
}

impl Parameters for Params {
    const SEED: Option<&str> = Some("ao.seed");

    fn consistent(&self) -> Result<(), ParamError> {
        self.voxel.consistent()?;
        if self.ao.storage == Storage::Bits && self.voxel.method == Method::MaxAlpha {
            let fault = "ao.storage is bits: the volumes of voxel.method max_alpha hold opacities, use texture";
            return Err(ParamError::Unfit(fault.into()));
        }
        Ok(())
    }

    fn enlarged(&self, factor: u32) -> Option<Self> {
        let mut larger = Self { view: self.view.enlarged(factor), ..self.clone() };
        larger.ao.scale /= f64::from(factor);
        Some(larger)
    }
}

impl Params {
    /// Whether marching through these grids makes sense and comes to an end.
    ///
    /// # Errors
    /// One line naming the parameter at fault.
    pub fn fits(&self, scene: &Scene, grids: &[Grid]) -> Result<(), ParamError> {
        let marching = self.ao.marching(scene);
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
            if self.ao.skipping && longest < LEAST_PYRAMID {
                return Err(ParamError::Unfit(format!(
                    "ao.skipping needs a volume of {LEAST_PYRAMID} voxels along its longest side: this one has {longest}"
                )));
            }
        }
        Ok(())
    }

    /// What rays make of surfaces.
    pub(super) fn model(&self) -> Model {
        match (self.ao.occluder, self.voxel.method) {
            (Occluder::Binary, _) => Model::First(self.ao.attenuation),
            (Occluder::Opacity, Method::MaxAlpha) => Model::Through,
            (Occluder::Opacity, _) => Model::ThroughOpaque,
        }
    }

    /// Pixels of the occlusion buffer.
    pub fn buffer_px(&self) -> [u32; 2] {
        settings::scaled([self.view.width, self.view.height], self.ao.scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_buffer_follows_the_viewport() {
        let mut params = Params::from(&SceneFile::load("plane").unwrap());
        params.ao.scale = 0.5;
        assert_eq!(params.buffer_px(), [300, 300]);
    }
}
