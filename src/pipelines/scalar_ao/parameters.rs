//! Parameters of the scalar fields' pipeline, their defaults with sources, and their ranges.

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::pipelines::settings::{Attenuation, View, within};
use crate::scene::{Camera, Light, SceneFile, Volume, VolumeFile};
use crate::stages::ray_cast::MarchUniforms;
use crate::stages::scalar_field;

/// View steps along a field's diagonal at most: a frame beyond it takes seconds on any adapter.
const MAX_VIEW_STEPS: f64 = 8192.0;

/// Everything that can be set. The dotted paths of `--set` are these fields' names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Params {
    pub view: View,
    pub camera: Camera,
    pub light: Light,
    /// Depth of the scene's floor under the resting water, metres.
    pub floor_depth_m: f64,
    pub volume: Cells,
    pub scalar: Scalar,
}

/// How finely the scene's volume is sampled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Cells {
    /// Cells along x, y and z of a generated volume; all 0: the generator's own number.
    pub cells: [u32; 3],
    /// Each axis has so many times fewer cells.
    pub reduce: u32,
}

impl Default for Cells {
    fn default() -> Self {
        let VolumeFile { cells, reduce, .. } = VolumeFile::default();
        Self { cells, reduce }
    }
}

impl Cells {
    /// The scene's volume with these cells.
    ///
    /// # Errors
    /// Cells that a file or an asset gives itself.
    pub fn put_into(&self, volume: &VolumeFile) -> Result<VolumeFile, String> {
        if self.cells != volume.cells && volume.generator.is_none() {
            return Err(format!(
                "volume.cells is {:?}: the scene's volume is not generated, only volume.reduce changes its cells",
                self.cells
            ));
        }
        let volume = VolumeFile { cells: self.cells, reduce: self.reduce, ..volume.clone() };
        volume.validate()?;
        Ok(volume)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// VAO §5.2.1.
    Isosurface,
    /// VAO §5.2.2.
    Direct,
    /// VAO §5.2.4.
    Positional,
}

/// What ends a ray from an isosurface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// |V − iso| < tolerance. VAO §5.2.1. A step can pass over so thin a layer.
    Isosurface,
    /// V ≥ threshold, as for surfaces. VAO §5.1.
    Threshold,
}

/// What values of the field mean in a medium.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// Opacities of a voxel. VAO Eq. 7.
    Opacity,
    /// Densities. VAO Eq. 5.
    Beer,
}

/// The stage, its marching and its transfer function.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scalar {
    pub mode: Mode,
    /// d_iso, value of the isosurface. Between air and casting of scene engine.
    pub iso: f64,
    /// d_tol. VAO §5.2.1 calls it volume-dependent and gives none: it must be less than the values fall within half a cell's
    /// diagonal, or the surface occludes itself. Tuned on scene engine.
    pub tolerance: f64,
    pub stop: Stop,
    pub attenuation: Attenuation,
    /// Rays from each shaded point. VAO §5.2.4: 20.
    pub rays: u32,
    /// N_samples of a ray at most. VAO §6.3: 8 in Fig. 7.
    pub samples: u32,
    /// Length of the rays, metres; 0: `r_max_share` times the longest side of the scene.
    pub r_max_m: f64,
    /// VAO gives none; tuned on scene engine.
    pub r_max_share: f64,
    pub law: Law,
    /// Whether samples of falling value count for nothing. VAO Eq. 4.
    pub rejection: bool,
    /// V_thres: isosurfaces: value that stops a ray; media: opacity of a voxel beyond which a ray ends, 1: none does.
    /// VAO §6.5: best within 0.2 to 0.8.
    pub threshold: f64,
    /// σ at the end of the window where `law` is `beer`, 1/m. Tuned on scene smoke.
    pub density_per_m: f64,
    /// Values at which opacity begins and is full; V of the paper's equations runs from 0 to 1 between them.
    pub window: [f64; 2],
    /// Opacity of a voxel at the end of the window where `law` is `opacity`.
    pub opacity: f64,
    /// Whether strata longer than a voxel read coarser levels of an average pyramid. VAO §5.2.3.
    pub pyramid: bool,
    /// Step along view rays, voxels. The Nyquist rate of a grid is two samples a cell; one is what ray casters commonly take.
    pub view_step_voxels: f64,
    /// Share of the light that comes evenly from all sides.
    pub ambient: f64,
    /// Colours at the ends of the window, linear RGB.
    pub low_color: [f32; 3],
    pub high_color: [f32; 3],
}

impl Default for Scalar {
    fn default() -> Self {
        Self {
            mode: Mode::Isosurface,
            iso: 0.4,
            tolerance: 0.1,
            stop: Stop::Threshold,
            attenuation: Attenuation::Linear,
            rays: 20,
            samples: 8,
            r_max_m: 0.0,
            r_max_share: 0.25,
            law: Law::Opacity,
            rejection: true,
            threshold: 0.4,
            density_per_m: 20.0,
            window: [0.0, 1.0],
            opacity: 1.0,
            pyramid: true,
            view_step_voxels: 1.0,
            ambient: 0.5,
            low_color: [0.85, 0.78, 0.7],
            high_color: [0.95, 0.93, 0.9],
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
            volume: file.volume.as_ref().map_or_else(Cells::default, |volume| Cells {
                cells: volume.cells,
                reduce: volume.reduce,
            }),
            scalar: Scalar::default(),
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
        params.camera.validate()?;
        params.light.validate()?;
        params.view.validate()?;
        params.scalar.validate()?;
        Ok(params)
    }
}

impl Scalar {
    fn validate(&self) -> Result<(), String> {
        let scalar =
            |name: &str, value: f64, low: f64, high: f64| within("scalar", name, value, low, high);
        scalar("iso", self.iso, 0.0, 1.0)?;
        scalar("tolerance", self.tolerance, 1e-4, 1.0)?;
        scalar("rays", f64::from(self.rays), 1.0, 4096.0)?;
        scalar("samples", f64::from(self.samples), 1.0, 1024.0)?;
        scalar("r_max_m", self.r_max_m, 0.0, 1e5)?;
        scalar("r_max_share", self.r_max_share, 1e-3, 4.0)?;
        scalar("threshold", self.threshold, 1e-3, 1.0)?;
        scalar("density_per_m", self.density_per_m, 0.0, 1e6)?;
        scalar("window[0]", self.window[0], 0.0, 0.999)?;
        scalar("window[1]", self.window[1], self.window[0] + 1e-3, 1.0)?;
        scalar("opacity", self.opacity, 0.0, 1.0)?;
        scalar("view_step_voxels", self.view_step_voxels, 0.05, 16.0)?;
        scalar("ambient", self.ambient, 0.0, 1.0)?;
        for (name, color) in [("low_color", self.low_color), ("high_color", self.high_color)] {
            for c in color {
                scalar(name, f64::from(c), 0.0, 1.0)?;
            }
        }
        Ok(())
    }

    /// Length of the rays in a scene whose longest side is `longest_m`, metres.
    pub fn reach_m(&self, longest_m: f64) -> f64 {
        if self.r_max_m > 0.0 { self.r_max_m } else { self.r_max_share * longest_m }
    }

    /// Whether rays and steps suit the volume.
    ///
    /// # Errors
    /// Rays shorter than a voxel, and view steps too many.
    pub fn suits(&self, volume: &Volume, longest_m: f64) -> Result<(), String> {
        let voxel_m = scalar_field::voxel_m(volume.spacing_m);
        let r_max_m = self.reach_m(longest_m);
        if r_max_m < voxel_m {
            let name = if self.r_max_m > 0.0 { "r_max_m" } else { "r_max_share" };
            return Err(format!(
                "scalar.{name} makes rays of {r_max_m:.4} m: they must be at least a voxel long, {voxel_m:.4} m"
            ));
        }
        let steps = volume.bounds().size().length() / (self.view_step_voxels * voxel_m);
        if steps > MAX_VIEW_STEPS {
            return Err(format!(
                "scalar.view_step_voxels is {}: {steps:.0} steps through the volume, at most {MAX_VIEW_STEPS}",
                self.view_step_voxels
            ));
        }
        Ok(())
    }

    /// Look-ups of a pixel whose ray crosses the volume: half of the steps along the view ray meet something, and each of
    /// these takes all its occlusion rays. On an isosurface one point does.
    pub fn typical_fetches(&self, volume: &Volume) -> u64 {
        let voxel_m = scalar_field::voxel_m(volume.spacing_m);
        let steps = volume.bounds().size().length() / (self.view_step_voxels * voxel_m);
        let steps = (steps / 2.0).ceil() as u64;
        let occlusion = u64::from(self.rays) * u64::from(self.samples);
        match self.mode {
            Mode::Isosurface => steps + occlusion,
            Mode::Direct | Mode::Positional => steps.saturating_mul(1 + occlusion),
        }
    }

    /// Whether the field needs levels above the first: isosurfaces are marched at the first alone.
    pub fn needs_pyramid(&self) -> bool {
        self.pyramid && self.mode != Mode::Isosurface
    }

    /// The shader's settings for cells of edge `voxel_m` and rays of `r_max_m`.
    pub fn uniforms(&self, size_px: [u32; 2], voxel_m: f64, r_max_m: f64) -> MarchUniforms {
        let stratum_m = r_max_m / f64::from(self.samples);
        MarchUniforms {
            size_px: Vec2::from(size_px.map(|n| n as f32)),
            window: Vec2::from(self.window.map(|v| v as f32)),
            low_color: Vec3::from(self.low_color),
            ambient: self.ambient as f32,
            high_color: Vec3::from(self.high_color),
            view_step_m: (self.view_step_voxels * voxel_m) as f32,
            iso: self.iso as f32,
            tolerance: self.tolerance as f32,
            threshold: self.stopping_value(voxel_m) as f32,
            rays: self.rays,
            samples: self.samples,
            r_max_m: r_max_m as f32,
            stratum_m: stratum_m as f32,
            level: if self.pyramid {
                scalar_field::pyramid_level(stratum_m, voxel_m) as f32
            } else {
                0.0
            },
            opacity: self.opacity as f32,
            density_per_m: self.density_per_m as f32,
        }
    }

    /// The value that ends a ray: V_thres itself for isosurfaces; for media the one whose opacity over a voxel is V_thres,
    /// so that it means the same under both laws.
    fn stopping_value(&self, voxel_m: f64) -> f64 {
        /// Beyond all values.
        const NEVER: f64 = 2.0;
        let value = match (self.mode, self.law) {
            (Mode::Isosurface, _) => return self.threshold,
            (_, Law::Opacity) => self.threshold / self.opacity,
            (_, Law::Beer) => -(1.0 - self.threshold).ln() / (self.density_per_m * voxel_m),
        };
        // NaN and infinity where nothing is opaque.
        if self.threshold < 1.0 && value < NEVER { value } else { NEVER }
    }
}
