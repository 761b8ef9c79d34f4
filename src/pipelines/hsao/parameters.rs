//! Parameters of the horizon-split pipeline, their defaults with sources, and their ranges.

use glam::Vec2;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::pipelines::settings::{
    Attenuation, Compose, Filter, R_MAX_SHARE, Shadow, View, scaled, within,
};
use crate::scene::{Camera, Light, SceneFile};
use crate::stages::hsao::march::MarchUniforms;

/// Everything that can be set. The dotted paths of `--set` are these fields' names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Params {
    pub view: View,
    pub camera: Camera,
    pub light: Light,
    /// Depth of the scene's floor under the resting water, metres.
    pub floor_depth_m: f64,
    /// Objects of the scene file that stand, from the first on; 0: all.
    pub objects: u32,
    pub shadow: Shadow,
    pub hsao: Hsao,
    pub filter: Filter,
    pub compose: Compose,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Hsao {
    /// Directions around a pixel in which the horizon is sought. VAO Fig. 9: 16.
    pub directions: u32,
    /// Samples of depth along each. VAO Fig. 9: 16.
    pub steps: u32,
    /// Rays marched above the horizon, shared among the directions. With the defaults a pixel takes at most `directions ×
    /// steps + rays × ray_steps` = 400 samples of depth, as in VAO Fig. 8; more rays and fewer steps have larger errors on
    /// scenes bunny_dry, sponza and corner.
    pub rays: u32,
    /// Samples of depth along each ray.
    pub ray_steps: u32,
    /// Distance up to which geometry occludes, metres; 0: `r_max_share`.
    pub r_max_m: f64,
    /// The same as a share of the scene's longest side.
    pub r_max_share: f64,
    pub attenuation: Attenuation,
    /// Difference of depth beyond which samples belong to another layer of surfaces, share of r_max: such samples do not
    /// raise the horizon, and rays pass behind such layers. VAO §6 gives none; tuned on scenes bunny_dry and sponza.
    pub layer_share: f64,
    /// Size of the occlusion buffer relative to the viewport.
    pub scale: f64,
    /// Whether the buffer is smoothed and brought to the viewport's size.
    pub filter: bool,
}

impl Default for Hsao {
    fn default() -> Self {
        Self {
            directions: 16,
            steps: 16,
            rays: 18,
            ray_steps: 8,
            r_max_m: 0.0,
            r_max_share: R_MAX_SHARE,
            attenuation: Attenuation::Linear,
            layer_share: 0.5,
            scale: 1.0,
            filter: true,
        }
    }
}

impl Hsao {
    fn validate(&self) -> Result<(), String> {
        let counts = [
            ("directions", self.directions, 1.0),
            ("steps", self.steps, 1.0),
            ("rays", self.rays, 0.0),
            ("ray_steps", self.ray_steps, 1.0),
        ];
        for (name, count, least) in counts {
            within("hsao", name, f64::from(count), least, 4096.0)?;
        }
        within("hsao", "r_max_m", self.r_max_m, 0.0, 1e4)?;
        within("hsao", "r_max_share", self.r_max_share, 1e-3, 4.0)?;
        within("hsao", "layer_share", self.layer_share, 1e-3, 100.0)?;
        within("hsao", "scale", self.scale, 0.05, 1.0)
    }

    pub fn uniforms(&self, buffer_px: [u32; 2], r_max_m: f64) -> MarchUniforms {
        MarchUniforms {
            size_px: Vec2::from(buffer_px.map(|side| side as f32)),
            r_max_m: r_max_m as f32,
            layer_m: (self.layer_share * r_max_m) as f32,
            directions: self.directions,
            steps: self.steps,
            rays: self.rays,
            ray_steps: self.ray_steps,
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
            shadow: Shadow::default(),
            hsao: Hsao::default(),
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
        self.shadow.validate()?;
        self.hsao.validate()?;
        self.filter.validate()?;
        self.compose.validate()
    }

    /// Pixels of the occlusion buffer.
    pub fn buffer_px(&self) -> [u32; 2] {
        scaled(&self.view, self.hsao.scale)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::pipelines::params;

    fn defaults() -> Value {
        Params::from_scene(&SceneFile::load("tank").unwrap()).to_value()
    }

    fn with(path: &str, value: Value) -> Result<Params, String> {
        let mut tree = defaults();
        params::set(&mut tree, path, value).unwrap();
        Params::from_value(&tree)
    }

    #[test]
    fn defaults_take_as_many_samples_as_the_paper() {
        let params = Params::from_value(&defaults()).unwrap();
        let uniforms = params.hsao.uniforms(params.buffer_px(), 1.0);
        assert_eq!(uniforms.samples_per_pixel(), 400);
    }

    #[test]
    fn bad_values_are_named() {
        let bad = [
            ("hsao.directions", json!(0)),
            ("hsao.ray_steps", json!(0)),
            ("hsao.layer_share", json!(0.0)),
            ("hsao.scale", json!(1.5)),
            ("filter.sigma_px", json!(0.0)),
            ("compose.exposure", json!(-1.0)),
            ("shadow.size", json!(0)),
        ];
        for (path, value) in bad {
            let error = with(path, value).unwrap_err();
            assert!(error.starts_with(path), "{error}");
        }
    }

    #[test]
    fn the_buffer_follows_the_viewport() {
        let params = with("hsao.scale", json!(0.5)).unwrap();
        assert_eq!(params.buffer_px(), [300, 300]);
    }
}
