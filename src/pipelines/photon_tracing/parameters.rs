//! Parameters of screen-space photon tracing, their defaults with sources, and their ranges.

use glam::DVec3;

use crate::Parameters;
use crate::screen_tracing::{Composition, LayeredDepth, RaySettings};
use crate::settings::{Shadow, TransferGrid, Viewport};
use fathom_base::parameter::ParamError;
use fathom_base::{choices, settings};
use fathom_scene::{Camera, Light, SceneFile, Water};
use serde::{Deserialize, Serialize};

settings! {
    pub struct Params from file: SceneFile {
        // SPT §5: 800 × 600.
        view: Viewport = Viewport { width: 800, height: 600 };
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        water: Water = file.water.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 1e-5 ..= 1e5, "m";
        shadow: Shadow = Shadow::default();
        surface: SurfaceSettings = SurfaceSettings::default();
        transfer: TransferGrid = TransferGrid::default();
        specular: Specular = Specular::default();
        ldi: LayeredDepth = LayeredDepth::default();
        rays: RaySettings = RaySettings::from(file);
        sprites: SpriteSettings = SpriteSettings::from(file);
        shafts: ShaftSettings = ShaftSettings::from(file);
        compose: Composition = Composition::default();
    }
}

settings! {
    /// The water's surface.
    pub struct SurfaceSettings {
        /// Whether the camera sees it: lines of sight are refracted and reflected there. SPT §4.
        draw: bool = true;
        /// Quads per side of the grid that draws it as the light sees it.
        cells: u32 = 128 => 1 ..= 8192, "1";
    }
}

settings! {
    /// Mirrors and glass. SPT §2.3.
    pub struct Specular {
        /// Whether photons go on from them. They end there otherwise.
        follow: bool = false;
        /// How many of their surfaces a photon can leave behind the water.
        bounces: u32 = 4 => 1 ..= 16, "1";
    }
}

/// The plane in which a sprite lies. SPT §3.1, Fig. 6.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpritePlane {
    /// The receiver's tangent plane, which SPT casts rays against.
    Receiver,
    /// The screen's, as of point sprites.
    Screen,
}

choices!(SpritePlane);

settings! {
    /// Sprites on the receivers. SPT §3.1.
    pub struct SpriteSettings from file: SceneFile {
        /// The plane in which they lie.
        plane: SpritePlane = SpritePlane::Receiver;
        /// s of Eq. 1: distance from the hit at which nothing is left. SPT gives none. Tuned on scene tank
        /// at the default grid, where it is 10 cm, and a share of the scene.
        radius_m: f64 = 0.1 * file.tank_scale() => 1e-6 ..= 1e4, "m";
        /// A pixel is lit when what it shows lies this near to the sprite's plane, along its line of sight. SPT says
        /// "close together". A share of the scene, 10 cm in scene tank.
        visible_m: f64 = 0.1 * file.tank_scale() => 1e-6 ..= 1e3, "m";
        /// Intersections of a photon's ray that are lit at most, each with the photon's whole flux. 1: the photon ends at the first, SPT §2.1.
        /// More: it goes on, as in SPT Fig. 3 (`photons_full_rate`: share of those that have as many or more).
        max_hits: u32 = 1 => 1 ..= 64, "1";
    }
}

settings! {
    /// Shafts of light. SPT §3.2.
    pub struct ShaftSettings from file: SceneFile {
        /// Whether they are drawn.
        draw: bool = true;
        /// Standard deviation of the blur. SPT gives none.
        sigma_px: f64 = 2.0 => 0.1 ..= 64.0, "px";
        /// Scattering coefficient that scales the composed shafts: less than the attenuation, 0.1 where that is 0.13.
        scattering_per_m: f64 = 0.1 * (file.water.attenuation_per_m / 0.13) => 0.0 ..= 1e3, "1/m";
    }
}

impl Params {
    /// Ways of a photon behind the water.
    pub fn path_segments(&self) -> u32 {
        if self.specular.follow { 1 + self.specular.bounces } else { 1 }
    }

    /// Distance of the middle of the view.
    pub fn middle_m(&self) -> f64 {
        DVec3::from(self.camera.target_m).distance(DVec3::from(self.camera.position_m))
    }
}

impl Parameters for Params {
    fn check_consistent(&self) -> Result<(), ParamError> {
        if self.sprites.max_hits > 1 && (self.specular.follow || self.shafts.draw) {
            let message = "sprites.max_hits above 1 lets photons end nowhere: specular.follow and shafts.draw must be false";
            return Err(ParamError::Unfit(message.to_owned()));
        }
        self.rays.fits(
            self.transfer.photons(),
            self.path_segments(),
            "transfer.grid, specular.bounces",
        )
    }
}
