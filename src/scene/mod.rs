//! What is rendered: geometry, scalar fields, camera, light and water, from scene files, procedural
//! generators and fetched assets.
//!
//! World space is right-handed, +Y up, metres; the water at rest is the plane y = 0, the floor lies
//! at y = −`floor_depth_m`. Dry scenes lie below y = 0 and draw no water.

pub mod assets;
mod bounds;
mod camera;
mod check;
#[cfg(test)]
mod documented;
mod file;
mod frustum;
pub mod generators;
mod gltf;
mod grid;
mod light;
mod light_frame;
mod mesh;
mod mesh_file;
mod noise;
mod obj;
mod photon_start;
mod placed;
mod ply;
mod polygon;
mod read;
mod samples;
mod shapes;
mod stl;
mod toml_text;
mod volume;
mod volume_file;
mod water;
mod waves;

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use bounds::Bounds;
pub use camera::Camera;
pub use file::{Anchor, ObjectFile, SceneFile, Transform};
pub use frustum::clip_polygon;
pub use grid::Grid;
pub use light::Light;
pub use light_frame::{LightFrame, LightKind};
pub use mesh::Mesh;
pub use noise::{NOISE_CELLS, pcg, tile_noise};
pub use read::{MAX_BYTES, MAX_TRIANGLES};
pub use samples::{MAX_CELLS, VolumeFormat};
pub use shapes::surface;
pub use volume::{Up, Volume};
pub use volume_file::VolumeFile;
pub use water::{NOISE_DRIFT_TILES, Water, WaterModel};
pub use waves::{MAX_WAVES, Wave, shortest_m as shortest_wave_m, texels as wave_texels};

use fathom_base::embedded::SCENES;
use fathom_base::text::line;
use fathom_base::{choices, settings};

/// Room above the water that the bounds of scene tank include, so that light starts above the waves.
const HEADROOM_M: f64 = 1.0;

/// Why a scene cannot be had. Each message says what to do about it.
#[derive(Debug, Error)]
pub enum SceneError {
    #[error("there is no scene `{name}`: {hint} (or give the path of a .toml file or a mesh)")]
    Unknown { name: String, hint: String },
    #[error("cannot read the scene file {path}: {source}")]
    Read { path: PathBuf, source: std::io::Error },
    #[error("scene file {origin}: {}", line(.message))]
    Parse { origin: String, message: String },
    /// Of a mesh file in the place of a scene.
    #[error("{}", line(.0))]
    Mesh(String),
    #[error("{}: a scene's file ends in .toml, a mesh in {}", path.display(), mesh_file::ENDINGS)]
    NoScene { path: PathBuf },
    #[error("scene `{}`: {}", line(.scene), line(.message))]
    Invalid { scene: String, message: String },
}

/// What becomes of photons and of lines of sight at a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Optics {
    /// They end there.
    Diffuse,
    /// They are reflected.
    Mirror,
    /// They are refracted; totally reflected ones stay inside.
    Glass,
}

choices!(Optics);

/// How an object moves; its `amplitude` is a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Turns about the vertical axis through the foot.
    Spin,
    /// Swings about it, the top by `amplitude` turns.
    Twist,
    /// Moves along the normal by `amplitude` of the height, one wave over the height.
    Wave,
}

settings! {
    /// How a surface looks.
    pub struct Material {
        /// Diffuse reflectance, linear RGB.
        albedo: [f32; 3] = [0.7; 3] => 0.0 ..= 1.0, "1";
        /// Colour of the joints between tiles.
        accent: [f32; 3] = [0.5; 3] => 0.0 ..= 1.0, "1";
        /// Side of a world-space tile; 0: plain.
        tile_m: f32 = 0.0 => 0.0 ..= 1000.0, "m";
        /// Opacity, which max-alpha voxelization stores (VAO Fig. 6).
        alpha: f32 = 1.0 => 0.0 ..= 1.0, "1";
        /// Reflectance of the glossy lobe (VAO §6).
        specular: f32 = 0.0 => 0.0 ..= 1.0, "1";
        /// What becomes of photons and of lines of sight that meet it, in pipelines `photon_tracing` and `refraction`: they end, are reflected,
        /// or refracted; `glass` needs an `alpha` below 1. SPT §2.3.
        optics: Optics = Optics::Diffuse;
        /// Whether rays of pipeline `shadow_rays` start here where its `receivers_only` is set. SPT §5.
        receiver: bool = false;
        /// Of glass, against air.
        refractive_index: f32 = 1.5 => 1.0 ..= 4.0, "1";
    }
}

impl Material {
    /// One cannot see through it.
    pub fn is_opaque(&self) -> bool {
        self.alpha >= 1.0
    }

    fn validate(&self) -> Result<(), String> {
        if self.optics == Optics::Glass && self.is_opaque() {
            return Err("material.optics is glass: material.alpha must be less than 1".to_owned());
        }
        check::within_ranges("material", self)
    }
}

/// A mesh in world space and its look.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// As in the scene file.
    pub name: String,
    /// In world space, metres.
    pub mesh: Mesh,
    pub material: Material,
}

/// A scene ready to render.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// As in the scene file.
    pub name: String,
    /// One line.
    pub description: String,
    /// What stands in it, in the order of the file.
    pub objects: Vec<Object>,
    /// Holds all objects, the volume, and the water's rectangle with some room above it.
    pub bounds: Bounds,
    pub camera: Camera,
    pub light: Light,
    pub water: Water,
    /// Depth of the floor below the water at rest, metres.
    pub floor_depth_m: f64,
    pub volume: Option<Volume>,
    /// Assets that were absent, each with the stand-in used.
    pub stand_ins: Vec<String>,
    /// See [`SceneFile::digests`].
    pub digests: BTreeMap<String, String>,
}

impl Object {
    /// An object of the default material.
    pub fn new(name: &str, mesh: Mesh) -> Object {
        Object { name: name.to_owned(), mesh, material: Material::default() }
    }
}

impl Scene {
    /// The names of the built-in scenes, sorted.
    pub fn names() -> Vec<String> {
        SCENES.texts(".toml").into_iter().map(|(name, _)| name).collect()
    }

    /// A built-in scene by name, or a scene file by path.
    pub fn load(name_or_path: &str) -> Result<Scene, SceneError> {
        Scene::build(&SceneFile::load(name_or_path)?)
    }

    /// Makes the geometry that `file` describes.
    pub fn build(file: &SceneFile) -> Result<Scene, SceneError> {
        let invalid = |message: String| SceneError::Invalid { scene: file.name.clone(), message };
        file.validate().map_err(invalid)?;
        let mut stand_ins = Vec::new();
        let mut remaining = MAX_TRIANGLES;
        let mut objects = Vec::new();
        for object in &file.objects {
            let built = object
                .build(file, remaining, &mut stand_ins)
                .map_err(|m| invalid(format!("object `{}`: {m}", object.name)))?;
            remaining -= built.iter().map(|object| object.mesh.triangle_count()).sum::<usize>();
            objects.extend(built);
        }
        let volume = file.volume.as_ref().map(|v| v.build(file, &mut stand_ins)).transpose();
        let volume = volume.map_err(|m| invalid(format!("[volume]: {m}")))?;
        let scene = Scene {
            name: file.name.clone(),
            description: file.description.clone(),
            bounds: Bounds::EMPTY,
            objects,
            camera: file.camera.clone(),
            light: file.light.clone(),
            water: file.water.clone(),
            floor_depth_m: file.floor_depth_m,
            volume,
            stand_ins,
            digests: file.digests().map_err(invalid)?,
        };
        Ok(scene.with_bounds())
    }

    /// The same with these objects in place of its own.
    #[must_use]
    pub fn with_objects(&self, objects: Vec<Object>) -> Scene {
        Scene { objects, ..self.clone() }.with_bounds()
    }

    fn with_bounds(self) -> Scene {
        let (solid, mut water) = (self.solid_bounds(), self.water.bounds());
        water.max.y += HEADROOM_M * solid.tank_scale();
        Scene { bounds: solid.union(water), ..self }
    }

    /// The box that holds all objects and the volume, without the water.
    pub fn solid_bounds(&self) -> Bounds {
        let objects = self.objects.iter().map(|object| object.mesh.bounds());
        objects.chain(self.volume.as_ref().map(Volume::bounds)).fold(Bounds::EMPTY, Bounds::union)
    }

    /// An error for a pipeline that draws objects where there are none.
    pub fn needs_objects(&self, pipeline: &str) -> Result<(), String> {
        if !self.objects.is_empty() {
            return Ok(());
        }
        Err(format!(
            "scene `{}` is a volume without objects: pipeline {pipeline} draws objects",
            self.name
        ))
    }

    pub fn triangle_count(&self) -> usize {
        self.objects.iter().map(|o| o.mesh.triangle_count()).sum()
    }
}
