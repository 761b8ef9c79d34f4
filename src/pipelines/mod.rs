//! Pipelines: stages in frame order over typed resources, for one scene and one set of parameters.

pub mod caustics_image;
pub mod draw;
pub mod gtao;
pub mod hsao;
mod lighting;
pub mod occlusion;
mod off_frustum;
pub mod photon_tracing;
pub mod planar;
pub mod refraction;
pub mod scalar_ao;
pub mod screen_tracing;
pub mod settings;
pub mod shadow_rays;
#[cfg(test)]
mod tests;
pub mod underwater;
pub mod volume_ao;
pub mod voxelization;
pub mod voxelize;

use std::any::Any;
use std::collections::{BTreeMap, HashMap};
use std::fmt::Debug;
use std::ops::Deref;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use thiserror::Error;

use caustics_image::{CausticsPair, FrameCaustics, IMAGE_ERROR};
use fathom_base::parameter::{self, ParamError, ParamField, Setting};
use fathom_base::text;
use fathom_gpu::kit::{PipelineParts, Resources};
use fathom_gpu::{Demand, Gpu, GpuError, Stage, StageInfo, TimedStage};
use fathom_record::ceilings::Reads;
use fathom_record::{ErrorFigure, Note, PictureScale, Work};
use fathom_reference::cache::{AnswerCache, AnswerKey};
use fathom_scene::{Camera, Light, Object, Scene, SceneFile, VolumeFile, Water, assets};
use fathom_stages::geometry::Objects;
use fathom_stages::uniforms::View;
use image::RgbImage;
use occlusion::OcclusionBuffers;
use settings::VolumeCells;

/// A pipeline's parameters. Those that [`SceneParams`] names shape the scene.
pub trait Parameters:
    Setting + Serialize + DeserializeOwned + for<'f> From<&'f SceneFile> + 'static
{
    /// Dotted path of what random numbers are drawn by, where there is such a setting.
    const SEED: Option<&'static str> = None;

    /// Checks parameters that depend on each other; each is within its range, and those of [`SceneParams`] are consistent.
    ///
    /// # Errors
    /// One line that names those at fault.
    fn check_consistent(&self) -> Result<(), ParamError> {
        Ok(())
    }

    /// For a picture with `factor` times as many columns and rows, which is then scaled down. Buffers that hold an effect keep their
    /// size, so that only edges and textures change. None where a pipeline has no such picture.
    fn upscaled(&self, _factor: u32) -> Option<Self> {
        None
    }
}

/// The parameters that shape the scene: those at the top of a pipeline's tree that bear these names.
#[derive(Deserialize)]
pub struct SceneParams {
    /// What the frame is seen from. Every pipeline has it.
    pub camera: Camera,
    pub light: Option<Light>,
    pub water: Option<Water>,
    pub floor_depth_m: Option<f64>,
    /// Only the first objects of the scene file; 0: all.
    #[serde(default)]
    pub objects: usize,
    pub volume: Option<VolumeCells>,
}

impl SceneParams {
    fn validate(&self) -> Result<(), String> {
        self.camera.validate()?;
        self.light.as_ref().map_or(Ok(()), Light::validate)?;
        self.water.as_ref().map_or(Ok(()), Water::validate)
    }
}

/// The scene file, changed by those parameters that shape the scene.
///
/// # Errors
/// Parameters that the scene cannot take.
pub fn apply(parameters: &impl Serialize, file: &SceneFile) -> Result<SceneFile, ParamError> {
    let SceneParams { camera, light, water, floor_depth_m, objects, volume } =
        typed(&parameter::tree(parameters))?;
    let volume = match (volume, &file.volume) {
        (Some(cells), Some(volume)) => Some(cells.apply_to(volume)?),
        _ => file.volume.clone(),
    };
    let object_count = if objects == 0 { file.objects.len() } else { objects };
    Ok(SceneFile {
        camera,
        light: light.unwrap_or_else(|| file.light.clone()),
        water: water.unwrap_or_else(|| file.water.clone()),
        floor_depth_m: floor_depth_m.unwrap_or(file.floor_depth_m),
        objects: file.objects.iter().take(object_count).cloned().collect(),
        volume,
        ..file.clone()
    })
}

/// What makes a pipeline: its parameters and its stages.
pub trait Pipeline: PipelineInstance + Sized + 'static {
    const NAME: &'static str;
    const ABOUT: &'static str;
    type Params: Parameters;

    /// Makes the stages and pushes each, in frame order. On a planner this counts what it asks.
    ///
    /// # Errors
    /// What the GPU reports, and a scene that the parameters do not suit.
    fn new(
        resources: &Resources<'_>,
        scene: &Scene,
        params: &Self::Params,
    ) -> Result<Self, GpuError>;
}

/// A pipeline that was made: what it draws, and what is known of its last frame.
pub trait PipelineInstance {
    /// The final image, `Rgba8Unorm`.
    fn image(&self) -> &wgpu::Texture;

    /// Stages that draw the image where the frame itself does not: run for pictures only, never timed.
    fn presenting(&self) -> Vec<&Stage> {
        Vec::new()
    }

    /// The image is visibility as grey, which a scale explains.
    fn shows_visibility(&self) -> bool {
        false
    }

    /// Figures that need a read-back of the last frame, `name → value`, the unit in the name.
    ///
    /// # Errors
    /// What the GPU reports.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError>;

    /// What a stage of the last frame has read where that depends on the data, counted by another pass of it.
    ///
    /// # Errors
    /// As [`Self::quantities`].
    fn counted_reads(&self, _gpu: &Gpu) -> Result<Option<CountedReads>, GpuError> {
        Ok(None)
    }

    /// [`Self::quantities`] and [`Self::counted_reads`].
    ///
    /// # Errors
    /// As [`Self::quantities`].
    fn all_quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let counted = self.counted_reads(gpu)?.into_iter().flat_map(|counted| counted.quantities);
        Ok(self.quantities(gpu)?.into_iter().chain(counted).collect())
    }

    /// What an analysis of a stage's outputs needs in addition: an object whose keys go into the description of a dump.
    fn context(&self, _stage: &str) -> Value {
        Value::Null
    }

    /// What the pipeline knows of ambient occlusion in the last frame.
    fn occlusion(&self) -> Option<&OcclusionBuffers> {
        None
    }

    /// Errors of the last frame, each with the stage that it judges: by default those of ambient occlusion.
    ///
    /// # Errors
    /// What the GPU reports, and a scene that the reference does not know.
    fn judge(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        match self.occlusion() {
            Some(buffers) => buffers.judge(gpu),
            None => Ok(Box::new(|_| Ok(Errors::default()))),
        }
    }

    /// Caustics of the last frame; none where there are no caustics.
    ///
    /// # Errors
    /// As [`Self::judge`].
    fn caustics(&self, _: &Gpu) -> Result<Option<FrameCaustics>, GpuError> {
        Ok(None)
    }

    /// The last frame beside exact answers, pixel by pixel; none where there are none.
    ///
    /// # Errors
    /// As [`Self::judge`].
    fn compare_pixels(
        &self,
        gpu: &Gpu,
        scene: &Scene,
    ) -> Result<Option<PixelComparison>, GpuError> {
        self.occlusion().map(|buffers| buffers.compare_pixels(gpu, scene)).transpose()
    }
}

/// Pictures of the exact answers, and of where a frame differs from them.
pub struct PixelComparison {
    pub exact: RgbImage,
    pub error: RgbImage,
}

/// A picture of errors, and what its colours mean.
pub type ErrorPicture = (RgbImage, PictureScale);

/// Computes what follows from what was read back of a frame: on any thread, without the device.
pub type Judging<T = Errors> = Box<dyn FnOnce(&Judge<'_>) -> Result<T, JudgeError> + Send>;

/// What a [`Judging`] works with: the scene, and earlier answers of the references.
pub struct Judge<'a> {
    pub scene: &'a Arc<Scene>,
    pub references: &'a ReferenceCache,
    /// Points that errors of ambient occlusion rest on at most.
    pub max_points: usize,
}

/// An RMS over so many independent errors is known to 2 %.
pub const MAX_POINTS: usize = 1_500;
/// In the quick profile: to 4 %.
pub const MAX_POINTS_QUICK: usize = 300;

impl<'a> Judge<'a> {
    pub fn new(scene: &'a Arc<Scene>, references: &'a ReferenceCache) -> Self {
        Self { scene, references, max_points: MAX_POINTS }
    }

    /// The content of a question about the scene: its geometry and materials, and what else it is asked by.
    fn question(&self, kind: &str, asked: &impl Debug) -> AnswerKey {
        let scene = self.references.geometry.digest(self.scene);
        AnswerKey::new(kind).with(scene.as_bytes()).with(format!("{asked:?}").as_bytes())
    }
}

/// What a frame is seen from, as the reference takes it: with the scene's camera, light and water. They are those of the frame but in
/// controls of `fathom verify`, which judge a frame by another scene.
fn judged_view(drawn: &View, scene: &Scene) -> View {
    let Scene { camera, light, water, bounds, .. } = scene;
    let (camera, light, water) = (camera.clone(), light.clone(), water.clone());
    View { camera, light, water, bounds: *bounds, ..drawn.clone() }
}

/// See [`PipelineInstance::counted_reads`].
pub struct CountedReads {
    pub stage: &'static str,
    pub reads: Reads,
    /// The same for people.
    pub quantities: BTreeMap<String, f64>,
}

impl CountedReads {
    /// Of a stage over the depth buffer: samples, and fragments of the occlusion buffer where something was drawn. `samples_per_pixel` is of
    /// these, `covered_share` is theirs of all.
    fn of_buffer(
        stage: &'static str,
        [samples, fragments]: [u64; 2],
        size_px: glam::UVec2,
    ) -> Self {
        let covered = fragments as f64;
        let quantities = to_map([
            ("samples_per_pixel", samples as f64 / covered.max(1.0)),
            ("covered_share", covered / size_px.as_dvec2().element_product()),
        ]);
        Self { stage, reads: Reads { texels: samples, volume_texels: 0 }, quantities }
    }
}

#[derive(Default)]
pub struct Errors {
    pub errors: Vec<ErrorFigure>,
    /// Figures beside the errors, such as means of what was compared.
    pub quantities: BTreeMap<String, f64>,
    /// What a reader must know of the settings.
    pub notes: Vec<Note>,
}

impl Errors {
    /// Errors of a stage, each with its unit, and figures beside them.
    pub fn new<'n>(
        stage: &str,
        errors: impl IntoIterator<Item = (&'n str, f64, &'n str)>,
        quantities: impl IntoIterator<Item = (&'n str, f64)>,
    ) -> Self {
        let error = |(name, value, unit)| ErrorFigure::new(name, value, unit, stage);
        let errors = errors.into_iter().map(error).collect();
        Self { errors, quantities: to_map(quantities), notes: Vec::new() }
    }
}

fn to_map<'n>(figures: impl IntoIterator<Item = (&'n str, f64)>) -> BTreeMap<String, f64> {
    figures.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// How many of so many, as a share; 0 of none.
fn share(count: usize, of: usize) -> f64 {
    count as f64 / of.max(1) as f64
}

/// By name, of how many how many are so.
#[derive(Clone, Debug, Default, PartialEq)]
struct Rates(BTreeMap<&'static str, [usize; 2]>);

impl Rates {
    fn count(&mut self, rate: &'static str, is_so: impl IntoIterator<Item = bool>) {
        let [some, all] = self.0.entry(rate).or_default();
        for is_so in is_so {
            *some += usize::from(is_so);
            *all += 1;
        }
    }

    fn rate(&self, rate: &'static str) -> f64 {
        let [some, all] = self.0.get(rate).copied().unwrap_or_default();
        share(some, all)
    }
}

/// A step through so many photons or pixels that leaves `most` of them to compare with a reference: odd, so that it meets every
/// sub-photon of a cell and not always the same column.
fn even_step(count: usize, max: usize) -> usize {
    count.div_ceil(max).max(1) | 1
}

/// The exact answers for an even selection of so many photons or pixels, each with its number; none where there is no answer.
fn exact_answers<T: Send>(
    count: usize,
    max: usize,
    exact: impl Fn(usize) -> Option<T> + Sync,
) -> Vec<(usize, T)> {
    let chosen = (0..count).into_par_iter().step_by(even_step(count, max));
    chosen.filter_map(|number| Some((number, exact(number)?))).collect()
}

/// The scene's objects that are of a part of it.
fn objects_of(scene: &Scene, part: Objects) -> Vec<Object> {
    scene.objects.iter().filter(|object| part.holds(&object.material)).cloned().collect()
}

/// Answers of the references, each computed once for all cells whose questions have the same content: who asks meanwhile waits.
#[derive(Default)]
pub struct ReferenceCache {
    /// Those of earlier runs.
    pub answers: AnswerCache,
    pub geometry: occlusion::GeometryCache,
    /// Those of this run, by the digests of their questions' content.
    known: Mutex<HashMap<String, Answer>>,
}

/// Empty while it is computed.
type Answer = Arc<OnceLock<Arc<dyn Any + Send + Sync>>>;

impl ReferenceCache {
    /// The answer to a question of this content, which is all that `compute` reads.
    pub fn answer<T: Send + Sync + 'static>(
        &self,
        content: AnswerKey,
        compute: impl FnOnce() -> T,
    ) -> Arc<T> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let answer = Arc::clone(known.entry(content.digest()).or_default());
        drop(known);
        let answer = Arc::clone(answer.get_or_init(|| Arc::new(compute())));
        answer.downcast().expect("a question's kind is part of its content")
    }

    /// The same; the answer is also kept for later runs with the same code of the references.
    fn kept_answer<T: Serialize + DeserializeOwned + Send + Sync + 'static>(
        &self,
        content: AnswerKey,
        compute: impl FnOnce() -> T,
    ) -> Arc<T> {
        self.answer(content.clone(), || self.answers.answer(content, compute))
    }

    /// With the folder of answers that lies beside the assets that were fetched.
    pub fn load() -> Self {
        let folder = assets::cache().map(|cache| cache.join("references"));
        Self { answers: AnswerCache { folder }, ..Self::default() }
    }
}

/// Why a frame could not be judged.
#[derive(Debug, Error)]
pub enum JudgeError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("no surface is seen")]
    Nothing,
    #[error("the photon map knows no mirrors and no glass: object `{0}`")]
    Specular(String),
    #[error("pipeline {0} has no picture of its error")]
    NoPicture(&'static str),
}

/// A pipeline that was made for a scene, and what it runs.
pub struct BuiltPipeline<P: ?Sized> {
    name: &'static str,
    parts: PipelineParts,
    pub pipeline: P,
}

/// A built pipeline of any kind.
pub type AnyPipeline = BuiltPipeline<dyn PipelineInstance>;

impl<P: Pipeline> BuiltPipeline<P> {
    /// Makes the pipeline; what it runs once has run on return.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn new(gpu: &Gpu, scene: &Scene, params: &P::Params) -> Result<Self, GpuError> {
        let resources = Resources::new(gpu);
        let pipeline = P::new(&resources, scene, params)?;
        let parts = resources.into_parts();
        parts.run_once(gpu)?;
        Ok(Self { name: P::NAME, parts, pipeline })
    }
}

impl<P: PipelineInstance + ?Sized> BuiltPipeline<P> {
    /// In frame order.
    pub fn stages(&self) -> Vec<&Stage> {
        self.parts.stages.iter().map(AsRef::as_ref).collect()
    }

    /// Those of a frame up to the last of these, with the loop that it is in.
    pub fn stages_up_to(&self, names: &[&str]) -> Vec<&Stage> {
        let mut stages = self.stages();
        let last = stages.iter().rposition(|stage| names.contains(&stage.name()));
        let turns = last.map_or(1, |last| stages[last].iterations());
        let end = last.map_or(0, |last| last + 1);
        let in_loop = |stage: &&&Stage| turns > 1 && stage.iterations() == turns;
        let end = end + stages[end..].iter().take_while(in_loop).count();
        stages.truncate(end);
        stages
    }

    pub fn allocated_bytes(&self) -> u64 {
        self.parts.demand.allocated_bytes()
    }

    /// See [`PipelineInstance::judge`]; those against a photon map take seconds, and are computed where they are `requested` by name.
    ///
    /// # Errors
    /// As there.
    pub fn judge(&self, gpu: &Gpu, requested: &[String]) -> Result<Judging, GpuError> {
        let judging = self.pipeline.judge(gpu)?;
        let is_asked = requested.iter().any(|asked| asked == IMAGE_ERROR);
        let caustics = if is_asked { self.pipeline.caustics(gpu)? } else { None };
        Ok(Box::new(move |judge| {
            let mut judged = judging(judge)?;
            if let Some(caustics) = caustics {
                let of_image = CausticsPair::new(judge, caustics)?.errors();
                judged.errors.extend(of_image.errors);
                judged.quantities.extend(of_image.quantities);
            }
            Ok(judged)
        }))
    }

    /// A picture of the error of ambient occlusion or of caustics, point by point, and what its colours mean.
    ///
    /// # Errors
    /// As [`PipelineInstance::judge`]; pipelines with neither when it is made.
    pub fn error_picture(&self, gpu: &Gpu) -> Result<Judging<ErrorPicture>, GpuError> {
        if let Some(buffers) = self.occlusion() {
            return buffers.error_picture(gpu);
        }
        let (caustics, name) = (self.pipeline.caustics(gpu)?, self.name);
        Ok(Box::new(move |judge| {
            let caustics = caustics.ok_or(JudgeError::NoPicture(name))?;
            Ok(CausticsPair::new(judge, caustics)?.error_picture())
        }))
    }
}

impl<P: ?Sized> Deref for BuiltPipeline<P> {
    type Target = P;

    fn deref(&self) -> &P {
        &self.pipeline
    }
}

pub struct PipelinePlan {
    /// What building it and reading its picture back needs of an adapter.
    pub demand: Demand,
    /// The stages of a frame, in order.
    pub stages: Vec<&'static StageInfo>,
}

/// Bytes that the host takes for a pixel of a picture: as it is read back, as four floats, and as it is written.
const PICTURE_BYTES: u64 = 4 + 16 + 4;

fn plan<P: Pipeline>(tree: &Value, scene: &Scene) -> Result<PipelinePlan, GpuError> {
    let (planner, params) = (Gpu::planner()?, typed(tree)?);
    planner.catch(|| {
        let resources = Resources::new(planner);
        let pipeline = P::new(&resources, scene, &params)?;
        let pixels = fathom_gpu::kit::pixels(pipeline.image());
        let picture = resources.with_size_hint(settings::VIEWPORT);
        picture.host_copies("image", pixels.saturating_mul(PICTURE_BYTES));
        let parts = resources.into_parts();
        let stages = parts.stages.iter().map(|stage| stage.info).collect();
        Ok(PipelinePlan { demand: parts.demand, stages })
    })
}

/// A kind of pipeline, by name. It is planned and built by a tree of parameters that were checked.
#[derive(Clone, Copy, Debug)]
pub struct PipelineKind {
    pub name: &'static str,
    pub about: &'static str,
    /// The whole tree of parameters with the values that the scene file gives.
    pub defaults: fn(&SceneFile) -> Value,
    /// Every parameter, with range, unit and description.
    pub fields: fn() -> Vec<ParamField>,
    /// Checks a tree of parameters: it comes back as it is recorded.
    pub checked: fn(&Value) -> Result<Value, ParamError>,
    /// What it would consist of and need, before anything is allocated; an error for a scene or settings for which it cannot be built.
    pub plan: fn(&Value, &Scene) -> Result<PipelinePlan, GpuError>,
    pub build: fn(&Value, &Gpu, &Scene) -> Result<Box<AnyPipeline>, GpuError>,
    /// See [`Parameters::upscaled`].
    pub enlarged: fn(&Value, u32) -> Option<Value>,
    /// See [`Parameters::SEED`].
    pub seed: Option<&'static str>,
}

impl PipelineKind {
    pub const fn new<P: Pipeline>() -> Self {
        Self {
            name: P::NAME,
            about: P::ABOUT,
            defaults: |file| parameter::tree(&P::Params::from(file)),
            fields: parameter::fields::<P::Params>,
            checked: |tree| Ok(parameter::tree(&read::<P::Params>(tree)?)),
            plan: plan::<P>,
            build: |tree, gpu, scene| {
                Ok(Box::new(BuiltPipeline::<P>::new(gpu, scene, &typed(tree)?)?))
            },
            enlarged: |tree, factor| {
                Some(parameter::tree(&typed::<P::Params>(tree).ok()?.upscaled(factor)?))
            },
            seed: P::Params::SEED,
        }
    }
}

/// Reads and checks a tree of parameters.
///
/// # Errors
/// One line that names the parameter at fault.
pub fn read<T: Parameters>(tree: &Value) -> Result<T, ParamError> {
    let params: T = parameter::read(tree)?;
    typed::<SceneParams>(&parameter::tree(&params))?.validate()?;
    params.check_consistent()?;
    Ok(params)
}

/// What a tree of parameters says that were checked before.
///
/// # Errors
/// A tree of another kind.
pub fn typed<T: DeserializeOwned>(tree: &Value) -> Result<T, ParamError> {
    T::deserialize(tree).map_err(|error| ParamError::Unfit(text::fault(error)))
}

/// fathom's own pipelines. Adding one adds a line.
pub const KINDS: &[PipelineKind] = &[
    PipelineKind::new::<underwater::Underwater>(),
    PipelineKind::new::<voxelize::Voxelize>(),
    PipelineKind::new::<volume_ao::VolumeAo>(),
    PipelineKind::new::<hsao::Hsao>(),
    PipelineKind::new::<gtao::Gtao>(),
    PipelineKind::new::<scalar_ao::ScalarAo>(),
    PipelineKind::new::<photon_tracing::PhotonTracing>(),
    PipelineKind::new::<shadow_rays::ShadowRays>(),
    PipelineKind::new::<refraction::ScreenRefraction>(),
    PipelineKind::new::<planar::Planar>(),
];

/// Cells of the volume that replaces one that is too large.
const SMALLEST_CELLS: [u32; 3] = [8; 3];
/// Host bytes per generated cell: the value while it is made, the stored value, and its texel.
const CELL_HOST_BYTES: u64 = 10;
/// Time of generating a cell, in texel fetches as [`Work`] counts them: 256³ cells of `smoke` took some 15 s.
const CELL_FETCHES: u64 = 160;

/// What making a scene needs, from its file alone: the cells of a generated volume.
pub fn scene_demand(file: &SceneFile) -> Demand {
    let mut demand = Demand::new();
    for volume in file.volume.iter().filter(|v| v.generator.is_some()) {
        let cells = volume.cells.map(|n| u64::from(n.div_ceil(volume.reduce.max(1))));
        let count = cells.iter().product::<u64>();
        let work = Work { texel_fetches: count * CELL_FETCHES, ..Work::default() };
        demand
            .texture_3d("volume.cells", cells)
            .copies("volume.cells", count * CELL_HOST_BYTES)
            .takes("volume.cells", work);
    }
    demand
}

/// The scene with as few cells as a volume can have.
pub fn smallest(file: SceneFile) -> SceneFile {
    let small = |volume: VolumeFile| VolumeFile { cells: SMALLEST_CELLS, reduce: 1, ..volume };
    SceneFile { volume: file.volume.map(small), ..file }
}
