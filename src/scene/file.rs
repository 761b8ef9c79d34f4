//! Scene files: TOML, one table for each of camera, light and water, and a list of objects.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use glam::{DMat4, DQuat, DVec3, EulerRot};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{
    Bounds, Camera, Light, Material, Object, Scene, SceneError, VolumeFile, Water, assets, check,
    generators, mesh_file, mesh_file::MeshPart, read, read::MAX_BYTES, toml_text,
};
use fathom_base::embedded::{Folders, SCENES};
use fathom_base::{choices, input, settings};

/// What a scene file holds. A file's `base` (a scene whose tables and objects it starts from) and
/// `without` (names of the base's objects to leave out) are resolved while it is read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// What records call the scene.
    pub name: String,
    /// One line.
    pub description: String,
    /// Depth of the floor below the water at rest, metres.
    pub floor_depth_m: f64,
    pub camera: Camera,
    #[serde(default)]
    pub light: Light,
    #[serde(default)]
    pub water: Water,
    /// The scalar field.
    pub volume: Option<VolumeFile>,
    /// The `[[object]]` tables; a scene with a volume may have none.
    #[serde(default, rename = "object")]
    pub objects: Vec<ObjectFile>,
    /// Folder from which the objects' `file` paths start.
    #[serde(skip)]
    pub folder: PathBuf,
    /// Of what the file and its bases say.
    #[serde(skip)]
    pub digest: String,
}

/// One object: made by a generator, or read from an asset or a mesh file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectFile {
    /// What errors and `without` call it.
    pub name: String,
    /// Name of a procedural generator; see [`generators`].
    pub generator: Option<String>,
    /// Name of a mesh to fetch; see [`assets`].
    pub asset: Option<String>,
    /// Path of an .obj, .ply, .stl, .gltf or .glb file, plain or compressed by gzip, relative to the scene file.
    pub file: Option<PathBuf>,
    /// The generator's parameters; those left out have their defaults.
    #[serde(default)]
    pub params: BTreeMap<String, Value>,
    #[serde(default)]
    pub transform: Transform,
    #[serde(default)]
    pub material: Material,
}

/// What an object's y is measured from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Anchor {
    /// The floor at y = −`floor_depth_m`.
    #[default]
    Floor,
    /// The water at rest, y = 0.
    Surface,
}

choices!(Anchor);

settings! {
    /// Where an object goes: fitted, scaled, turned, then moved.
    pub struct Transform {
        /// If not 0: the largest extent is brought to this many metres, and the object is put upright on y = 0 in the middle
        /// of x and z.
        fit_m: f64 = 0.0 => 0.0 ..= 1e5, "m";
        /// Factor on the size.
        scale: f64 = 1.0 => 1e-6 ..= 1e6, "1";
        /// Turns about x, then y, then z.
        rotate_deg: [f64; 3] = [0.0; 3] => -1e5 ..= 1e5, "°";
        /// Where it is moved, y from `on`.
        translate_m: [f64; 3] = [0.0; 3] => -1e5 ..= 1e5, "m";
        /// What y is measured from: the floor, or the water at rest.
        on: Anchor = Anchor::Floor;
    }
}

impl Anchor {
    /// The y of the ground, metres.
    pub fn height_m(self, floor_depth_m: f64) -> f64 {
        match self {
            Anchor::Floor => -floor_depth_m,
            Anchor::Surface => 0.0,
        }
    }
}

impl Transform {
    /// Object space to world space, for a mesh of these bounds.
    pub fn matrix(&self, bounds: &Bounds, floor_depth_m: f64) -> DMat4 {
        let [x, y, z] = self.rotate_deg.map(f64::to_radians);
        let ground = self.on.height_m(floor_depth_m);
        let rotation = DQuat::from_euler(EulerRot::ZYX, z, y, x);
        let place = DVec3::from(self.translate_m) + DVec3::Y * ground;
        let scale = DVec3::splat(self.scale);
        DMat4::from_scale_rotation_translation(scale, rotation, place) * self.fitting(bounds)
    }

    fn fitting(&self, bounds: &Bounds) -> DMat4 {
        if self.fit_m == 0.0 {
            return DMat4::IDENTITY;
        }
        let foot = bounds.center().with_y(bounds.min.y);
        let largest = bounds.size().max_element().max(f64::MIN_POSITIVE);
        DMat4::from_scale(DVec3::splat(self.fit_m / largest)) * DMat4::from_translation(-foot)
    }
}

impl SceneFile {
    /// A built-in scene's file by name, or one by path; of a mesh's path the mesh on a plate.
    pub fn load(name_or_path: &str) -> Result<SceneFile, SceneError> {
        SceneFile::load_from(&Folders::new(SCENES), name_or_path)
    }

    /// The file of a scene of these folders by name, or one by path.
    pub fn load_from(folders: &Folders, name_or_path: &str) -> Result<SceneFile, SceneError> {
        let path = Path::new(name_or_path);
        if mesh_file::reader(path).is_some() {
            return SceneFile::of_mesh(path);
        }
        let (origin, text) = toml_text::find(folders, name_or_path)?;
        SceneFile::read(folders, origin, &text)
    }

    /// Reads the text of a scene file; `origin` is its path, for errors and relative paths.
    pub fn parse(origin: &str, text: &str) -> Result<SceneFile, SceneError> {
        SceneFile::read(&Folders::new(SCENES), origin.to_owned(), text)
    }

    fn read(folders: &Folders, origin: String, text: &str) -> Result<SceneFile, SceneError> {
        let (mut file, said): (SceneFile, _) = toml_text::read(folders, &origin, text)?;
        file.digest = input::digest(said.as_bytes()).unwrap_or_default();
        file.folder = Path::new(&origin).parent().unwrap_or(Path::new("")).into();
        file.validate().map_err(|message| SceneError::Parse { origin, message })?;
        Ok(file)
    }

    /// [`Bounds::tank_scale`] of the objects and the volume, 1 where they cannot be made: lengths that nobody set are multiplied by it.
    pub fn tank_scale(&self) -> f64 {
        static KNOWN: Mutex<BTreeMap<String, f64>> = Mutex::new(BTreeMap::new());
        let what = (&self.folder, self.floor_depth_m, &self.objects, &self.volume);
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        *known.entry(format!("{what:?}")).or_insert_with(|| {
            let mut coarse = self.clone();
            // A generated volume fills the same box with any number of cells.
            for volume in coarse.volume.iter_mut().filter(|volume| volume.generator.is_some()) {
                (volume.cells, volume.reduce) = ([8; 3], 1);
            }
            Scene::build(&coarse).map_or(1.0, |scene| scene.solid_bounds().tank_scale())
        })
    }

    /// Digests of the meshes, their buffers and the volumes by the names of their files or assets, and of itself as `scene_file`.
    pub fn digests(&self) -> Result<BTreeMap<String, String>, String> {
        let mut digests = BTreeMap::from([("scene_file".to_owned(), self.digest.clone())]);
        let objects = self.objects.iter().map(|object| (&object.file, &object.asset));
        let volume = self.volume.iter().map(|volume| (&volume.file, &volume.asset));
        let mut add = |path: &Path, digest: io::Result<String>| {
            let digest = digest.map_err(|error| format!("{}: {error}", path.display()))?;
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            // Files of different folders may have one name.
            let known = digests.entry(name).and_modify(|known| *known += &digest);
            known.or_insert(digest);
            Ok::<_, String>(())
        };
        for (path, asset) in objects.chain(volume) {
            if let Some(path) = path {
                let path = self.folder.join(path);
                add(&path, read::open(&path).and_then(input::digest))?;
                for path in mesh_file::companions(&path)? {
                    let file = input::open(&path).and_then(|file| input::limited(file, MAX_BYTES));
                    add(&path, file.and_then(input::digest))?;
                }
            } else if let Some(name) = asset {
                add(Path::new(name), Ok(assets::named(name)?.sha256[..16].to_owned()))?;
            }
        }
        Ok(digests)
    }

    /// Whether all values can be used; the error names the parameter and its valid range.
    pub fn validate(&self) -> Result<(), String> {
        check::check_range("floor_depth_m", self.floor_depth_m, 1e-5, 1e5)?;
        self.camera.validate()?;
        self.light.validate()?;
        self.water.validate()?;
        if let Some(volume) = &self.volume {
            volume.validate()?;
        } else if self.objects.is_empty() {
            return Err("it has neither an [[object]] nor a [volume]".into());
        }
        for object in &self.objects {
            object.validate().map_err(|m| format!("object `{}`: {m}", object.name))?;
        }
        Ok(())
    }
}

impl ObjectFile {
    fn validate(&self) -> Result<(), String> {
        check::within_ranges("transform", &self.transform)?;
        self.material.validate()?;
        let sources = [self.generator.is_some(), self.asset.is_some(), self.file.is_some()];
        if sources.iter().filter(|given| **given).count() != 1 {
            return Err("it needs one of `generator`, `asset` and `file`".into());
        }
        if self.generator.is_none() && !self.params.is_empty() {
            return Err("`params` belong to a `generator`".into());
        }
        Ok(())
    }

    /// Makes or reads the mesh, of at most `triangles`, and places it: an object for each colour of its file. Adds an absent asset's
    /// stand-in to `stand_ins`.
    pub(super) fn build(
        &self,
        file: &SceneFile,
        triangles: usize,
        stand_ins: &mut Vec<String>,
    ) -> Result<Vec<Object>, String> {
        let parts = self.parts(file, triangles, stand_ins)?;
        if parts.iter().map(|part| part.mesh.triangle_count()).sum::<usize>() > triangles {
            return Err(super::read::too_many_triangles(triangles));
        }
        let bounds = parts.iter().map(|part| part.mesh.bounds()).fold(Bounds::EMPTY, Bounds::union);
        let matrix = self.transform.matrix(&bounds, file.floor_depth_m);
        // What a scene file says of a colour counts; what nobody says is the material's default.
        let default = Material::default();
        let has_own_colour = self.material.albedo != default.albedo;
        let object = |MeshPart { mesh, albedo, alpha }: MeshPart| {
            let mesh = mesh.transformed(&matrix);
            mesh.validate()?;
            let mut material = self.material.clone();
            if let Some(albedo) = albedo.filter(|_| !has_own_colour) {
                material.albedo = albedo;
            }
            if material.alpha == default.alpha {
                material.alpha = alpha;
            }
            Ok(Object { material, ..Object::new(&self.name, mesh) })
        };
        parts.into_iter().map(object).collect()
    }

    fn parts(
        &self,
        file: &SceneFile,
        triangles: usize,
        stand_ins: &mut Vec<String>,
    ) -> Result<Vec<MeshPart>, String> {
        if let Some(name) = &self.generator {
            let mesh = generators::find(name)?.mesh(&json!(self.params), file.floor_depth_m)?;
            return Ok(vec![mesh.into()]);
        }
        if let Some(path) = &self.file {
            return mesh_file::read_parts(&file.folder.join(path), triangles);
        }
        let name = self.asset.as_deref().unwrap_or_default();
        let asset = assets::named(name)?;
        if !matches!(asset.content, assets::AssetKind::Mesh) {
            return Err(format!("asset `{name}` is a volume: it belongs to [volume]"));
        }
        if let Some(path) = assets::find(name) {
            return mesh_file::read_parts(&path, triangles);
        }
        let params = asset.stand_in.1.iter().copied().collect();
        let mesh = generators::find(asset.stand_in.0)?.mesh(&params, file.floor_depth_m)?;
        stand_ins.push(asset.stand_in_note(&format!("{} triangles", mesh.triangle_count())));
        Ok(vec![mesh.into()])
    }
}
