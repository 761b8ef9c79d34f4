//! Parameters of the scalar fields' pipeline, their defaults with sources, and their ranges.

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::Parameters;
use crate::settings::{Attenuation, Viewport, VolumeCells};
use fathom_base::choices;
use fathom_base::parameter::{ParamError, check_range};
use fathom_base::settings;
use fathom_scene::{Camera, Light, SceneFile, Volume};
use fathom_stages::ray_cast::CastUniforms;
use fathom_stages::scalar::isosurface::RayRules;
use fathom_stages::scalar_field;

/// Of scene smoke.
const SMOKE_TIMES_TANK: f64 = 0.177_734_375;

/// View steps along a field's diagonal at most: a frame beyond it takes seconds on any adapter.
const MAX_VIEW_STEPS: f64 = 8192.0;

settings! {
    pub struct Params from file: SceneFile {
        view: Viewport = Viewport::default();
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 1e-5 ..= 1e5, "m";
        volume: VolumeCells = VolumeCells::from(&file.volume.clone().unwrap_or_default());
        scalar: Scalar = {
            let times = file.tank_scale() / SMOKE_TIMES_TANK;
            let default = Scalar::default();
            Scalar { density_per_m: default.density_per_m / times, ..default }
        };
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

/// What a ray from an isosurface gathers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Gather {
    /// ρ of the place where it ends. VAO §5.2.1, §5.1.
    End,
    /// γ of Eq. 7 over the samples up to there: with `scalar.rejection` as the paper shades isosurfaces. It begins at the surface, and
    /// there is no ρ. VAO §5.2.3, Fig. 7a, b and d.
    Opacity,
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

choices!(Mode, Stop, Gather, Law);

settings! {
    /// The stage, its marching and its transfer function.
    pub struct Scalar {
        /// The stage of family `scalar` that runs.
        mode: Mode = Mode::Isosurface;
        /// d_iso, value of the isosurface. Between air and casting of scene engine.
        iso: f64 = 0.4 => 0.0 ..= 1.0, "1";
        /// d_tol. VAO §5.2.1 calls it volume-dependent and gives none: it must be less than the values fall within half a
        /// cell's diagonal, or the surface occludes itself. Tuned on scene engine.
        tolerance: f64 = 0.1 => 1e-4 ..= 1.0, "1";
        /// What ends a ray from an isosurface.
        stop: Stop = Stop::Threshold;
        /// What a ray from an isosurface gathers on its way.
        gather: Gather = Gather::End;
        /// How occluders weigh by their distance where rays from an isosurface gather their end.
        attenuation: Attenuation = Attenuation::Linear;
        /// Rays from each shaded point. VAO §5.2.4: 20.
        rays: u32 = 20 => 1 ..= 4096, "1";
        /// N_samples of a ray at most. VAO §6.3: 8 in Fig. 7.
        samples: u32 = 8 => 1 ..= 1024, "1";
        /// Length of the rays; 0: `r_max_share` times the longest side of the scene.
        r_max_m: f64 = 0.0 => 0.0 ..= 1e5, "m";
        /// VAO gives none; tuned on scene engine.
        r_max_share: f64 = 0.25 => 1e-3 ..= 4.0, "1";
        /// What values of the field mean in a medium.
        law: Law = Law::Opacity;
        /// Whether samples of falling value count for nothing where opacity is gathered. VAO Eq. 4.
        rejection: bool = true;
        /// V_thres: isosurfaces: value that stops a ray; media: opacity of a voxel beyond which a ray ends, 1: none does.
        /// VAO §6.5: best within 0.2 to 0.8.
        threshold: f64 = 0.4 => 1e-3 ..= 1.0, "1";
        /// σ at the end of the window where `law` is `beer`. Tuned on scene smoke; in others so that their diagonals are as opaque.
        density_per_m: f64 = 20.0 => 0.0 ..= 1e6, "1/m";
        /// Values at which opacity begins and is full; V of the paper's equations runs from 0 to 1 between them.
        window: [f64; 2] = [0.0, 1.0] => 0.0 ..= 1.0, "1";
        /// Opacity of a voxel at the end of the window where `law` is `opacity`.
        opacity: f64 = 1.0 => 0.0 ..= 1.0, "1";
        /// Whether strata longer than a voxel read coarser levels of an average pyramid. VAO §5.2.3.
        pyramid: bool = true;
        /// Step along view rays. The Nyquist rate of a grid is two samples a cell; one is what ray casters commonly take.
        view_step_voxels: f64 = 1.0 => 0.05 ..= 16.0, "voxels";
        /// Share of the light that comes evenly from all sides.
        ambient: f64 = 0.5 => 0.0 ..= 1.0, "1";
        /// Colour at the window's beginning, linear RGB.
        low_color: [f32; 3] = [0.85, 0.78, 0.7] => 0.0 ..= 1.0, "1";
        /// Colour at the window's end, linear RGB.
        high_color: [f32; 3] = [0.95, 0.93, 0.9] => 0.0 ..= 1.0, "1";
    }
}

impl Parameters for Params {
    fn check_consistent(&self) -> Result<(), ParamError> {
        let [low, high] = self.scalar.window;
        check_range("scalar.window[0]", low, 0.0, 0.999)?;
        check_range("scalar.window[1]", high, low + 1e-3, 1.0)
    }

    fn upscaled(&self, factor: u32) -> Option<Self> {
        Some(Self { view: self.view.upscaled(factor), ..self.clone() })
    }
}

impl Scalar {
    /// Rays from an isosurface.
    pub fn surface_rays(&self) -> RayRules {
        RayRules {
            at_isosurface: self.stop == Stop::Isosurface,
            linear: self.attenuation == Attenuation::Linear,
            opacity: self.gather == Gather::Opacity,
            rejection: self.rejection,
        }
    }

    /// Whether rays of this length and view steps suit the volume.
    ///
    /// # Errors
    /// Rays shorter than a voxel, and view steps too many.
    pub fn check_volume(&self, volume: &Volume, r_max_m: f64) -> Result<(), ParamError> {
        let voxel_m = scalar_field::voxel_m(volume.spacing_m);
        if r_max_m < voxel_m {
            let name = if self.r_max_m > 0.0 { "r_max_m" } else { "r_max_share" };
            return Err(ParamError::Unfit(format!(
                "scalar.{name} makes rays of {r_max_m:.4} m: they must be at least a voxel long, {voxel_m:.4} m"
            )));
        }
        let steps = self.view_steps(volume);
        if steps > MAX_VIEW_STEPS {
            return Err(ParamError::Unfit(format!(
                "scalar.view_step_voxels is {}: {steps:.0} steps through the volume, at most {MAX_VIEW_STEPS}",
                self.view_step_voxels
            )));
        }
        Ok(())
    }

    /// Along the volume's diagonal.
    fn view_steps(&self, volume: &Volume) -> f64 {
        let voxel_m = scalar_field::voxel_m(volume.spacing_m);
        volume.bounds().size().length() / (self.view_step_voxels * voxel_m)
    }

    /// Look-ups of a pixel whose ray crosses the volume: half of the steps along the view ray meet something, and each of
    /// these takes all its occlusion rays. On an isosurface one point does.
    pub fn typical_fetches(&self, volume: &Volume) -> u64 {
        let steps = (self.view_steps(volume) / 2.0).ceil() as u64;
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
    pub fn uniforms(&self, size_px: [u32; 2], voxel_m: f64, r_max_m: f64) -> CastUniforms {
        let stratum_m = r_max_m / f64::from(self.samples);
        CastUniforms {
            size_px: size_px.into(),
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
