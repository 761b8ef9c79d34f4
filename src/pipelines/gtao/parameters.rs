//! Parameters of the pipeline `gtao`, their defaults with sources, and their ranges.

use crate::Parameters;
use crate::settings::{Animation, Compose, Filter, R_MAX_SHARE, Shadow, Viewport, scaled};
use fathom_base::settings;
use fathom_scene::{Camera, Light, SceneFile};
use fathom_stages::bilateral::Window;
use fathom_stages::gtao::gather::{GatherMethod, GatherUniforms, Occluders, Sectors};

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
        gtao: Gather = Gather::default();
        filter: Filter = Filter::default();
        compose: Compose = Compose::default();
    }
}

settings! {
    /// How slices are searched for occluders.
    pub struct Gather {
        /// What occludes a slice.
        occluders: Occluders = Occluders::Bitmask;
        /// How the sectors of a bitmask lie in a slice.
        sectors: Sectors = Sectors::Cosine;
        /// Slices of a pixel. XeGTAO and Bevy, quality "high": 3.
        slices: u32 = 3 => 1 ..= 4096, "1";
        /// Samples of depth on each side of a slice. XeGTAO and Bevy, quality "high": 3.
        steps: u32 = 3 => 1 ..= 4096, "1";
        /// Distance up to which geometry occludes; 0: `r_max_share`.
        r_max_m: f64 = 0.0 => 0.0 ..= 1e4, "m";
        /// The same as a share of the scene's longest side.
        r_max_share: f64 = R_MAX_SHARE => 1e-3 ..= 4.0, "1";
        /// How far what is seen reaches along the view, share of r_max; bitmasks only. Therrien et al. leave it to the user. Of 0.25, 0.5, 1 and 2 it
        /// errs least, or by at most a third more, in five of the six scenes of `today-ao`; foliage asks for 0.25.
        thickness_share: f64 = 0.5 => 0.0 ..= 100.0, "1";
        /// Share by which a lower sample pulls the horizon down, so that thin occluders hide less; horizons only. GTAO §4.3 gives none; 0, as in
        /// XeGTAO: horizons do not fall.
        fall: f64 = 0.0 => 0.0 ..= 1.0, "1";
        /// Draws other rotations and offsets at every pixel.
        seed: u32 = 0 => 0 ..= 4_294_967_295u32, "1";
        /// Size of the occlusion buffer relative to the viewport. GTAO §4.3: ½.
        scale: f64 = 1.0 => 0.05 ..= 1.0, "1";
        /// Whether the buffer is smoothed and brought to the viewport's size.
        filter: bool = true;
        /// What the filter takes. With `square` rotations repeat in tiles of 4 × 4 texels, which it averages.
        window: Window = Window::Disc;
    }
}

impl Gather {
    pub fn uniforms(&self, buffer_px: [u32; 2], r_max_m: f64) -> GatherUniforms {
        GatherUniforms {
            size_px: buffer_px.into(),
            r_max_m: r_max_m as f32,
            thickness_m: (self.thickness_share * r_max_m) as f32,
            fall: self.fall as f32,
            slices: self.slices,
            steps: self.steps,
            seed: self.seed,
        }
    }

    pub fn method(&self) -> GatherMethod {
        let Self { occluders, sectors, window, .. } = *self;
        GatherMethod { occluders, sectors, window }
    }
}

impl Parameters for Params {
    const SEED: Option<&str> = Some("gtao.seed");

    fn upscaled(&self, factor: u32) -> Option<Self> {
        let mut larger = Self { view: self.view.upscaled(factor), ..self.clone() };
        larger.gtao.scale /= f64::from(factor);
        Some(larger)
    }
}

impl Params {
    /// Pixels of the occlusion buffer.
    pub fn buffer_px(&self) -> [u32; 2] {
        scaled([self.view.width, self.view.height], self.gtao.scale)
    }
}
