//! Parameters of the horizon-split pipeline, their defaults with sources, and their ranges.

use crate::Parameters;
use crate::settings::{
    Animation, Attenuation, Compose, Filter, R_MAX_SHARE, Shadow, Viewport, scaled,
};
use fathom_base::settings;
use fathom_scene::{Camera, Light, SceneFile};
use fathom_stages::hsao::march::HorizonUniforms;

settings! {
    pub struct Params from file: SceneFile {
        view: Viewport = Viewport::default();
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 1e-5 ..= 1e5, "m";
        /// Objects of the scene file that stand, from the first on; 0: all.
        objects: u32 = 0 => 0 ..= 1_000_000, "1";
        animation: Animation = Animation::default();
        shadow: Shadow = Shadow::default();
        hsao: Horizon = Horizon::default();
        filter: Filter = Filter::default();
        compose: Compose = Compose::default();
    }
}

settings! {
    /// How horizons are sought and rays marched above them.
    pub struct Horizon {
        /// Directions around a pixel in which the horizon is sought. VAO Fig. 9: 16.
        directions: u32 = 16 => 1 ..= 4096, "1";
        /// Samples of depth along each. VAO Fig. 9: 16.
        steps: u32 = 16 => 1 ..= 4096, "1";
        /// Rays marched above the horizon, shared among the directions. With the defaults a pixel takes at most `directions ×
        /// steps + rays × ray_steps` = 400 samples of depth, as in VAO Fig. 8; more rays and fewer steps have larger errors on
        /// scenes bunny_dry, sponza and corner.
        rays: u32 = 18 => 0 ..= 4096, "1";
        /// Samples of depth along each ray.
        ray_steps: u32 = 8 => 1 ..= 4096, "1";
        /// Distance up to which geometry occludes; 0: `r_max_share`.
        r_max_m: f64 = 0.0 => 0.0 ..= 1e4, "m";
        /// The same as a share of the scene's longest side.
        r_max_share: f64 = R_MAX_SHARE => 1e-3 ..= 4.0, "1";
        /// Draws other directions and offsets at every pixel.
        seed: u32 = 0 => 0 ..= 4_294_967_295u32, "1";
        /// How occluders weigh by their distance.
        attenuation: Attenuation = Attenuation::Linear;
        /// Difference of depth beyond which samples belong to another layer of surfaces, share of r_max: such samples do not
        /// raise the horizon, and rays pass behind such layers. VAO §6 gives none; tuned on scenes bunny_dry and sponza.
        layer_share: f64 = 0.5 => 1e-3 ..= 100.0, "1";
        /// Size of the occlusion buffer relative to the viewport.
        scale: f64 = 1.0 => 0.05 ..= 1.0, "1";
        /// Whether the buffer is smoothed and brought to the viewport's size.
        filter: bool = true;
    }
}

impl Horizon {
    pub fn uniforms(&self, buffer_px: [u32; 2], r_max_m: f64) -> HorizonUniforms {
        HorizonUniforms {
            size_px: buffer_px.into(),
            r_max_m: r_max_m as f32,
            layer_m: (self.layer_share * r_max_m) as f32,
            directions: self.directions,
            steps: self.steps,
            rays: self.rays,
            ray_steps: self.ray_steps,
            seed: self.seed,
        }
    }
}

impl Parameters for Params {
    const SEED: Option<&str> = Some("hsao.seed");

    fn upscaled(&self, factor: u32) -> Option<Self> {
        let mut larger = Self { view: self.view.upscaled(factor), ..self.clone() };
        larger.hsao.scale /= f64::from(factor);
        Some(larger)
    }
}

impl Params {
    /// Pixels of the occlusion buffer.
    pub fn buffer_px(&self) -> [u32; 2] {
        scaled([self.view.width, self.view.height], self.hsao.scale)
    }
}
