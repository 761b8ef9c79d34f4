//! Parameters of the pipeline `volume_ao`, their defaults with sources, and their ranges.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::pipelines::settings::{
    self, Animation, Attenuation, Compose, Filter, Method, R_MAX_SHARE, Shadow, View, Voxel, within,
};
use crate::scene::{Camera, Grid, Light, Scene, SceneFile};
use crate::stages::marching::{Estimator, Guard, Hit, Marching, Occluder, Sampling, Step, Storage};

/// Everything that can be set. The dotted paths of `--set` are these fields' names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Params {
    pub view: View,
    pub camera: Camera,
    pub light: Light,
    /// Depth of the scene's floor under the resting water, metres.
    pub floor_depth_m: f64,
    /// Only the first objects of the scene file; 0: all.
    pub objects: u32,
    pub voxel: Voxel,
    pub animation: Animation,
    pub shadow: Shadow,
    pub ao: Ao,
    pub filter: Filter,
    pub compose: Compose,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ao {
    /// N_dir. With 8 samples each, 50 rays take the 400 samples of VAO Fig. 8.
    pub rays: u32,
    /// N_samples where `step` is `paper`. VAO §6.3: 8 to 12.
    pub samples: u32,
    /// Distance up to which geometry occludes, metres; 0: `r_max_share`.
    pub r_max_m: f64,
    /// The same as a share of the scene's longest side.
    pub r_max_share: f64,
    pub attenuation: Attenuation,
    pub estimator: Estimator,
    /// V_thres. VAO §6.5: 0.2 to 0.8, for volumes from slicemaps. The default is for the thicker shells of `voxel.method` overlap,
    /// which leave no gap at any slant. It was chosen with the offset and `hit` by the worst orientation: docs/volume-ao.md.
    pub threshold: f64,
    pub guard: Guard,
    /// Whether each ray's samples are moved along it by a random share of a step, which turns bands into noise. VAO §5.2.3.
    pub jitter: bool,
    pub step: Step,
    /// Step where `step` is `voxel`, voxels. At more than one, rays pass through walls of one voxel.
    pub step_voxels: f64,
    /// How far along its normal a surface's rays begin, voxels: VAO §6.1's small offset. It keeps coarse or curved surfaces
    /// from occluding themselves at low thresholds. VAO §5.1 has none: 0.
    pub offset_voxels: f64,
    pub hit: Hit,
    pub sampling: Sampling,
    pub storage: Storage,
    /// Whether rays leave empty cells of an occupancy pyramid in one go. VAO §6.3.
    pub skipping: bool,
    pub occluder: Occluder,
    /// Size of the occlusion buffer relative to the viewport. VAO §6.2: ½ in Fig. 11.
    pub scale: f64,
    /// Whether the buffer is smoothed and brought to the viewport's size.
    pub filter: bool,
}

impl Default for Ao {
    fn default() -> Self {
        Self {
            rays: 50,
            samples: 8,
            r_max_m: 0.0,
            r_max_share: R_MAX_SHARE,
            attenuation: Attenuation::Linear,
            estimator: Estimator::Unbiased,
            threshold: 0.9,
            guard: Guard::Variable,
            jitter: false,
            step: Step::Voxel,
            step_voxels: 1.0,
            offset_voxels: 0.1,
            hit: Hit::Peak,
            sampling: Sampling::Stratified,
            storage: Storage::Texture,
            skipping: false,
            occluder: Occluder::Binary,
            scale: 1.0,
            filter: true,
        }
    }
}

/// Samples of a pixel and a volume at most, so that a frame ends.
const MAX_SAMPLES: u64 = 1 << 20;
/// The pyramid's level that rays are led by has cells of 4³ voxels.
const LEAST_PYRAMID: u32 = 4;

impl Ao {
    fn validate(&self) -> Result<(), String> {
        within("ao", "rays", f64::from(self.rays), 1.0, 65536.0)?;
        within("ao", "samples", f64::from(self.samples), 1.0, 65536.0)?;
        within("ao", "r_max_m", self.r_max_m, 0.0, 1e4)?;
        within("ao", "r_max_share", self.r_max_share, 1e-3, 4.0)?;
        within("ao", "threshold", self.threshold, 0.01, 1.0)?;
        within("ao", "step_voxels", self.step_voxels, 0.01, 100.0)?;
        within("ao", "offset_voxels", self.offset_voxels, 0.0, 100.0)?;
        within("ao", "scale", self.scale, 0.05, 1.0)
    }

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

impl Params {
    /// Defaults with what the scene file says of camera, light and floor.
    pub fn from_scene(file: &SceneFile) -> Self {
        Self {
            view: View::default(),
            camera: file.camera.clone(),
            light: file.light.clone(),
            floor_depth_m: file.floor_depth_m,
            objects: 0,
            voxel: Voxel { method: Method::Overlap, ..Voxel::default() },
            animation: Animation::default(),
            shadow: Shadow::default(),
            ao: Ao::default(),
            filter: Filter::default(),
            compose: Compose::default(),
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
        params.validate()?;
        Ok(params)
    }

    fn validate(&self) -> Result<(), String> {
        self.camera.validate()?;
        self.light.validate()?;
        self.view.validate()?;
        self.voxel.validate()?;
        self.animation.validate()?;
        self.shadow.validate()?;
        self.ao.validate()?;
        self.filter.validate()?;
        self.compose.validate()?;
        if self.ao.storage == Storage::Bits && self.voxel.method == Method::MaxAlpha {
            return Err(
                "ao.storage is bits: the volumes of voxel.method max_alpha hold opacities, \
                use texture"
                    .into(),
            );
        }
        Ok(())
    }

    /// Whether marching through these grids makes sense and comes to an end.
    ///
    /// # Errors
    /// One line naming the parameter at fault.
    pub fn fits(&self, scene: &Scene, grids: &[Grid]) -> Result<(), String> {
        let marching = self.ao.marching(scene);
        let r_max = match self.ao.r_max_m > 0.0 {
            true => "ao.r_max_m",
            false => "ao.r_max_share × the scene's longest side",
        };
        for grid in grids {
            if marching.r_max_m < grid.voxel_m {
                return Err(format!(
                    "{r_max} is {:.3e} m, less than a voxel of {:.3e} m: raise it, or voxel.resolution",
                    marching.r_max_m, grid.voxel_m
                ));
            }
            let samples = f64::from(marching.rays) * marching.samples_in(grid);
            if samples > MAX_SAMPLES as f64 {
                return Err(format!(
                    "ao.rays × samples of a ray is {samples:.0}: at most {MAX_SAMPLES} samples are taken for a pixel"
                ));
            }
            let longest = grid.cells.into_iter().max().unwrap_or(0);
            if self.ao.skipping && longest < LEAST_PYRAMID {
                return Err(format!(
                    "ao.skipping needs a volume of {LEAST_PYRAMID} voxels along its longest side: this one has {longest}"
                ));
            }
        }
        Ok(())
    }

    /// Pixels of the occlusion buffer.
    pub fn buffer_px(&self) -> [u32; 2] {
        settings::scaled(&self.view, self.ao.scale)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::pipelines::params;

    fn with(changes: &[(&str, Value)]) -> Result<Params, String> {
        let mut tree = Params::from_scene(&SceneFile::load("plane").unwrap()).to_value();
        for (path, value) in changes {
            params::set(&mut tree, path, value.clone()).unwrap();
        }
        Params::from_value(&tree)
    }

    #[test]
    fn bad_values_are_named() {
        let bad = [
            ("ao.rays", json!(0)),
            ("ao.samples", json!(0)),
            ("ao.threshold", json!(0.0)),
            ("ao.threshold", json!(1.5)),
            ("ao.step_voxels", json!(0.0)),
            ("ao.offset_voxels", json!(-1.0)),
            ("ao.r_max_share", json!(0.0)),
            ("ao.scale", json!(2.0)),
            ("ao.guard", json!("thick")),
            ("voxel.resolution", json!(2)),
        ];
        for (path, value) in bad {
            let error = with(&[(path, value)]).unwrap_err();
            assert!(error.starts_with(path), "{error}");
        }
        let mut params = with(&[]).unwrap();
        params.ao.r_max_m = f64::NAN;
        let error = params.validate().unwrap_err();
        assert!(error.starts_with("ao.r_max_m is NaN"), "{error}");
    }

    #[test]
    fn bits_hold_no_opacities() {
        let changes = [("voxel.method", json!("max_alpha")), ("ao.storage", json!("bits"))];
        assert!(with(&changes).unwrap_err().starts_with("ao.storage is bits"));
    }

    #[test]
    fn what_does_not_fit_the_volume_is_named() {
        let file = SceneFile::load("plane").unwrap();
        let scene = Scene::build(&file).unwrap();
        let fault = |changes: &[(&str, Value)]| {
            let params = with(changes).unwrap();
            let still = Animation::default();
            let grids = params.voxel.grids(&scene, &params.camera, &still).unwrap();
            params.fits(&scene, &grids)
        };
        assert_eq!(fault(&[]), Ok(()));
        let error = fault(&[("ao.r_max_m", json!(0.01))]).unwrap_err();
        assert!(error.starts_with("ao.r_max_m is 1.000e-2 m, less than a voxel"), "{error}");
        let error = fault(&[("ao.r_max_share", json!(0.001))]).unwrap_err();
        assert!(error.starts_with("ao.r_max_share"), "{error}");
        let error = fault(&[("ao.rays", json!(65536))]).unwrap_err();
        assert!(error.starts_with("ao.rays"), "{error}");
        let small = [
            ("voxel.cells", json!([3, 3, 3])),
            ("voxel.origin_m", json!([-1.0, -4.0, -1.0])),
            ("voxel.voxel_m", json!(1.0)),
            ("ao.skipping", json!(true)),
        ];
        assert!(fault(&small).unwrap_err().starts_with("ao.skipping"));
    }

    #[test]
    fn the_buffer_follows_the_viewport() {
        let params = with(&[("ao.scale", json!(0.5))]).unwrap();
        assert_eq!(params.buffer_px(), [300, 300]);
    }
}
