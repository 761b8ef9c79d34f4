//! Parameters of caustics on planar receivers, their defaults with sources, and their ranges.

use crate::Parameters;
use crate::settings::{Shadow, TransferGrid, Viewport, WaterGrid};
use fathom_base::settings;
use fathom_scene::{Camera, Light, SceneFile, Water};
use fathom_stages::planar::compose::PlanarView;
use fathom_stages::pool::Pool;

settings! {
    pub struct Params from file: SceneFile {
        // SPT Fig. 2: 1K × 1K.
        view: Viewport = Viewport { width: 1024, height: 1024 };
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        water: Water = file.water.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 1e-5 ..= 1e5, "m";
        shadow: Shadow = Shadow::default();
        surface: WaterGrid = WaterGrid::default();
        transfer: TransferGrid = TransferGrid::default();
        planar: Receivers = Receivers::default();
        compose: PlanarPicture = PlanarPicture::default();
    }
}

settings! {
    /// The illumination map of the pool's floor and walls. SPT §1.1.
    pub struct Receivers {
        /// Texels per side of each of the five faces. SPT Fig. 2: 128.
        texels: u32 = 128 => 1 ..= 16384, "1";
    }
}

settings! {
    /// How the picture is made.
    pub struct PlanarPicture {
        /// Radiance is mapped by 1 − exp(−exposure × radiance). As in pipeline underwater.
        exposure: f64 = 0.4 => 0.0 ..= 1e6, "1";
        /// What the picture shows.
        show: PlanarView = PlanarView::Image;
    }
}

impl Params {
    /// The pool below the water; its walls reach up to the highest wave.
    pub fn pool(&self) -> Pool {
        Pool {
            floor_depth_m: self.floor_depth_m as f32,
            top_m: self.water.bound_m() as f32,
            texels: self.planar.texels,
        }
    }
}

impl Parameters for Params {
    /// The illumination map keeps its size.
    fn upscaled(&self, factor: u32) -> Option<Self> {
        Some(Self { view: self.view.upscaled(factor), ..self.clone() })
    }
}
