//! Parameters of screen-space photon tracing, their defaults with sources, and their ranges.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::parameter::ParamError;
use crate::pipelines::Parameters;
use crate::pipelines::settings::{Shadow, Transfer, View, WaterGrid};
use crate::scene::{Camera, Light, SceneFile, Water};
use crate::stages::screen_ray::{HitTest, Walking};
use crate::{choices, settings};

settings! {
    /// Everything that can be set. The dotted paths of `--set` are these fields' names.
    pub struct Params from file: SceneFile {
        // SPT §5: 800 × 600.
        view: View = View { width: 800, height: 600 };
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        water: Water = file.water.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 0.01 ..= 1000.0, "m";
        shadow: Shadow = Shadow::default();
        surface: WaterGrid = WaterGrid::default();
        transfer: Transfer = Transfer::default();
        ldi: LayeredDepth = LayeredDepth::default();
        rays: RaySettings = RaySettings::default();
        sprites: SpriteSettings = SpriteSettings::default();
        shafts: ShaftSettings = ShaftSettings::default();
        compose: Composition = Composition::default();
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LayerMethod {
    /// A pass for each layer. SPT §2.2.
    Peel,
    /// One pass into lists, sorted pixel by pixel.
    Lists,
}

settings! {
    /// The layered depth image. SPT §2.2.
    pub struct LayeredDepth {
        /// What finds the layers. Both find the same, as long as the lists have room.
        method: LayerMethod = LayerMethod::Peel;
        /// Room of the lists, fragments a pixel on average. What finds none is lost, and told.
        fragments_per_pixel: u32 = 8 => 1 ..= 256, "1";
        /// Layers. SPT §2.2: "usually sufficient to only consider up to eight depth layers".
        layers: u32 = 8 => 1 ..= 64, "1";
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// A line for each photon, and a reduction of its row. SPT §2.1.
    Lines,
    /// An invocation walks each ray. SPT §2.1: about half as fast in 2006.
    March,
    /// A workgroup walks each ray.
    Group,
}

choices!(Method, HitTest, LayerMethod);

settings! {
    /// How rays are followed. SPT §2.1.
    pub struct RaySettings {
        /// What walks the rays. All find the same hits.
        method: Method = Method::Lines;
        /// What counts as a hit. `tolerance` is the paper's, and loses rays whose depth changes by more than twice the tolerance
        /// from pixel to pixel.
        test: HitTest = HitTest::Crossing;
        /// Distance that counts as a hit with the test `tolerance`. SPT §5: 0.01.
        tolerance_m: f64 = 0.01 => 1e-6 ..= 1e3, "m";
        /// Nothing is hit nearer to a ray's start than this.
        start_m: f64 = 0.0 => 0.0 ..= 1e3, "m";
        /// Fewest pixels of a ray's line. SPT §2.1 enforces a minimum and does not give it.
        least_px: u32 = 8 => 1 ..= 4096, "px";
        /// Most rows of the target that lines are drawn into; 0: as many as the adapter has. More photons take several passes.
        rows: u32 = 0 => 0 ..= 1_000_000, "1";
    }
}

/// Most rows by default: 8192 × 801 texels are 25 MiB.
const ROWS: u32 = 8192;

/// Most tiles: each is two passes of a frame, of which 2,048 are timed.
const MOST_TILES: u32 = 1024;

impl RaySettings {
    /// On an adapter with textures of so many rows at most.
    pub fn walking(&self, most_rows: u32) -> Walking {
        Walking {
            test: self.test,
            tolerance_m: self.tolerance_m,
            start_m: self.start_m,
            least: self.least_px,
            rows: if self.rows == 0 { most_rows.min(ROWS) } else { self.rows },
        }
    }
}

settings! {
    /// Sprites on the receivers. SPT §3.1.
    pub struct SpriteSettings {
        /// s of Eq. 1: distance from the hit at which nothing is left. SPT gives none. Tuned on scene tank
        /// at the default grid.
        radius_m: f64 = 0.1 => 1e-4 ..= 100.0, "m";
        /// A pixel is lit when what it shows lies this near to the receiver's tangent plane, along its line of sight. SPT says
        /// "close together".
        visible_m: f64 = 0.1 => 1e-6 ..= 1e3, "m";
    }
}

settings! {
    /// Shafts of light. SPT §3.2.
    pub struct ShaftSettings {
        /// Whether they are drawn.
        draw: bool = true;
        /// Standard deviation of the blur. SPT gives none.
        sigma_px: f64 = 2.0 => 0.1 ..= 64.0, "px";
        /// Scattering coefficient that scales the composed shafts: less than the attenuation of the paper on caustics, 0.13.
        scattering_per_m: f64 = 0.1 => 0.0 ..= 1e3, "1/m";
    }
}

settings! {
    /// How the picture is made.
    pub struct Composition {
        /// Radiance is mapped by 1 − exp(−exposure × radiance). As in pipeline underwater.
        exposure: f64 = 0.4 => 0.0 ..= 1e6, "1";
    }
}

impl Params {
    pub fn photons(&self) -> u32 {
        self.transfer.photons()
    }

    /// Distance of the middle of the view.
    pub fn middle_m(&self) -> f64 {
        DVec3::from(self.camera.target_m).distance(DVec3::from(self.camera.position_m))
    }
}

impl Parameters for Params {
    fn staged(&self, file: &SceneFile) -> Result<SceneFile, ParamError> {
        Ok(SceneFile {
            floor_depth_m: self.floor_depth_m,
            camera: self.camera.clone(),
            light: self.light.clone(),
            water: self.water.clone(),
            ..file.clone()
        })
    }

    fn consistent(&self) -> Result<(), ParamError> {
        self.camera.validate()?;
        self.light.validate()?;
        self.water.validate()?;
        let rows = if self.rays.rows == 0 { ROWS } else { self.rays.rows };
        let tiles = self.photons().div_ceil(rows);
        if self.rays.method == Method::Lines && tiles > MOST_TILES {
            return Err(ParamError::Unfit(format!(
                "transfer.grid and rays.rows give {tiles} tiles of photons: at most {MOST_TILES} are drawn"
            )));
        }
        Ok(())
    }

    fn camera_mut(&mut self) -> &mut Camera {
        &mut self.camera
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::{parameter, pipelines};

    fn with(settings: &[(&str, Value)]) -> Result<Params, ParamError> {
        let mut tree = parameter::tree(&Params::from(&SceneFile::load("tank").unwrap()));
        for (path, value) in settings {
            parameter::set(&mut tree, path, value.clone()).unwrap();
        }
        pipelines::read(&tree)
    }

    #[test]
    fn more_tiles_than_are_timed_are_refused_in_one_line() {
        for settings in
            [vec![("rays.rows", json!(1))], vec![("transfer.grid", json!([16384, 16384]))]]
        {
            let error = with(&settings).unwrap_err().to_string();
            assert!(error.contains("rays.rows") && !error.contains('\n'), "{error}");
        }
        assert!(with(&[("rays.rows", json!(64))]).is_ok());
        assert!(with(&[("rays.rows", json!(1)), ("rays.method", json!("march"))]).is_ok());
    }
}
