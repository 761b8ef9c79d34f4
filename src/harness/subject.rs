//! One pipeline on one scene with all its parameters: what can be checked, built and run.

use std::collections::BTreeSet;
use std::collections::hash_map::{Entry, HashMap};
use std::sync::Arc;

use rayon::prelude::*;
use serde::Deserialize;
use serde_json::Value;

use super::catalog::{Catalog, SubjectError};
use fathom_base::parameter;
use fathom_base::print;
use fathom_gpu::{Capacity, Gpu, GpuError};
use fathom_pipelines as pipelines;
use fathom_pipelines::{AnyPipeline, PipelineKind, PipelinePlan};
use fathom_scene::{Camera, Scene, SceneError, SceneFile};

/// A pipeline with its parameters, and a scene with its geometry.
#[derive(Clone)]
pub struct Subject {
    pub kind: PipelineKind,
    /// As it was asked for: a built-in name or a path.
    pub scene_name: String,
    pub scene: Arc<Scene>,
    /// The parameters as they are recorded, checked.
    pub params: Value,
    /// Why the scene is too large to be made; `scene` is then a small one in its place, which is never measured.
    too_large: Option<String>,
}

impl Subject {
    /// What the parameters ask beyond `capacity`, with the numbers. Nothing is allocated.
    pub fn limits_exceeded(&self, capacity: &Capacity) -> Result<Option<String>, SubjectError> {
        Ok(self.forecast_s(capacity)?.err())
    }

    /// What a frame is foreseen to take, seconds, or what is asked beyond `capacity`.
    pub fn forecast_s(&self, capacity: &Capacity) -> Result<Result<f64, String>, SubjectError> {
        if let Some(reason) = &self.too_large {
            return Ok(Err(reason.clone()));
        }
        let demand = self.plan()?.demand;
        Ok(capacity.check(&demand).map(|()| capacity.frame_time_s(&demand)))
    }

    /// What the pipeline would make.
    pub fn plan(&self) -> Result<PipelinePlan, SubjectError> {
        let invalid = |error: GpuError| SubjectError::Invalid(error.to_string());
        (self.kind.plan)(&self.params, &self.scene).map_err(invalid)
    }

    /// Makes the pipeline's resources; any fault of the device comes back as an error.
    pub fn build(&self, gpu: &Gpu) -> Result<Box<AnyPipeline>, GpuError> {
        let beyond = self.limits_exceeded(&gpu.capacity);
        if let Some(reason) = beyond.map_err(|e| GpuError::Unusable(e.to_string()))? {
            return Err(GpuError::Limit(reason));
        }
        self.build_planned(gpu)
    }

    /// The same where it was compared with the adapter's limits before.
    pub fn build_planned(&self, gpu: &Gpu) -> Result<Box<AnyPipeline>, GpuError> {
        gpu.catch(|| (self.kind.build)(&self.params, gpu, &self.scene))
    }

    /// For a picture of `factor` times the columns and rows; none where the pipeline has no such picture.
    pub fn upscaled(&self, factor: u32) -> Option<Self> {
        Some(Self { params: (self.kind.enlarged)(&self.params, factor)?, ..self.clone() })
    }

    /// What it is seen from.
    pub fn camera(&self) -> Camera {
        Camera::deserialize(&self.params["camera"]).expect("every pipeline has a camera")
    }

    /// The same seen from elsewhere. The geometry is shared: pipelines take the camera from the parameters.
    #[must_use]
    pub fn with_camera(&self, camera: &Camera) -> Self {
        let mut moved = self.clone();
        moved.params["camera"] = parameter::tree(camera);
        moved
    }

    /// The same with other random numbers; none where the pipeline has no seed.
    #[must_use]
    pub fn reseeded(&self, added: u32) -> Option<Self> {
        let mut other = self.clone();
        let pointer = format!("/{}", self.kind.seed?.replace('.', "/"));
        let seed = other.params.pointer_mut(&pointer)?;
        *seed = (seed.as_u64()? as u32).wrapping_add(added).into();
        Some(other)
    }
}

/// Makes subjects, each scene only once. Every stand-in for an asset is told on standard error, once.
#[derive(Default)]
pub struct Subjects {
    catalog: Catalog,
    capacity: Option<Capacity>,
    files: HashMap<String, SceneFile>,
    built: Vec<(SceneFile, Arc<Scene>)>,
    announced: BTreeSet<String>,
    silent: bool,
}

impl Subjects {
    pub fn new(catalog: &Catalog) -> Self {
        Self { catalog: catalog.clone(), ..Self::default() }
    }

    /// For a process whose replies name the stand-ins.
    #[must_use]
    pub fn silent(self) -> Self {
        Self { silent: true, ..self }
    }

    /// Makes no scene whose volume is beyond this capacity.
    #[must_use]
    pub fn with_capacity(self, capacity: &Capacity) -> Self {
        Self { capacity: Some(capacity.clone()), ..self }
    }

    /// The pipeline's defaults for the scene, with `overrides` (dotted path, value) put in, in their order.
    pub fn subject(
        &mut self,
        pipeline: &str,
        scene: &str,
        overrides: &[(String, Value)],
    ) -> Result<Subject, SubjectError> {
        let kind = self.catalog.kind(pipeline)?;
        let (params, file, too_large) = self.scene_file(kind, scene, overrides)?;
        let scene_name = scene.to_owned();
        let scene = self.scene(file)?;
        Ok(Subject { kind, scene_name, scene, params, too_large })
    }

    /// Makes the scenes of these pipelines, scenes and overrides side by side. What fails is told when its subject is asked for.
    pub fn make_scenes<'s>(
        &mut self,
        wanted: impl IntoIterator<Item = (&'s str, &'s str, &'s [(String, Value)])>,
    ) {
        let mut files = Vec::new();
        for (pipeline, scene, overrides) in wanted {
            let Ok(kind) = self.catalog.kind(pipeline) else { continue };
            let Ok((_, file, _)) = self.scene_file(kind, scene, overrides) else { continue };
            if !files.contains(&file) {
                files.push(file);
            }
        }
        let make = |file: SceneFile| Scene::build(&file).ok().map(|scene| (file, scene));
        let made: Vec<_> = files.into_par_iter().filter_map(make).collect();
        made.into_iter().for_each(|(file, scene)| drop(self.keep(file, scene)));
    }

    /// The parameters of a subject, its scene file, and why that is too large to be made; it is then that of a small one in its place.
    fn scene_file(
        &mut self,
        kind: PipelineKind,
        scene: &str,
        overrides: &[(String, Value)],
    ) -> Result<(Value, SceneFile, Option<String>), SubjectError> {
        let params = self.params(kind, scene, overrides)?;
        let file = pipelines::apply(&params, &self.file(scene)?)?;
        let too_large = self.too_large(&file);
        let file = if too_large.is_some() { pipelines::smallest(file) } else { file };
        Ok((params, file, too_large))
    }

    /// The parameters of a subject, checked. No scene is made.
    pub fn params(
        &mut self,
        kind: PipelineKind,
        scene: &str,
        overrides: &[(String, Value)],
    ) -> Result<Value, SubjectError> {
        let mut params = (kind.defaults)(&self.file(scene)?);
        for (path, value) in overrides {
            let set = parameter::set(&mut params, path, value.clone());
            set.map_err(|error| self.catalog.explained(error, kind))?;
        }
        Ok((kind.checked)(&params)?)
    }

    fn too_large(&self, file: &SceneFile) -> Option<String> {
        let capacity = self.capacity.as_ref()?;
        capacity.check_scene(&pipelines::scene_demand(file)).err()
    }

    fn file(&mut self, scene: &str) -> Result<SceneFile, SceneError> {
        Ok(match self.files.entry(scene.to_owned()) {
            Entry::Occupied(known) => known.get().clone(),
            Entry::Vacant(new) => {
                new.insert(SceneFile::load_from(&self.catalog.scenes, scene)?).clone()
            }
        })
    }

    fn scene(&mut self, file: SceneFile) -> Result<Arc<Scene>, SceneError> {
        if let Some((_, scene)) = self.built.iter().find(|(known, _)| *known == file) {
            return Ok(Arc::clone(scene));
        }
        let scene = Scene::build(&file)?;
        Ok(self.keep(file, scene))
    }

    fn keep(&mut self, file: SceneFile, scene: Scene) -> Arc<Scene> {
        let scene = Arc::new(scene);
        for stand_in in &scene.stand_ins {
            if !self.silent && self.announced.insert(stand_in.clone()) {
                print::note(format!("stand-in: {stand_in}"));
            }
        }
        self.built.push((file, Arc::clone(&scene)));
        scene
    }
}
