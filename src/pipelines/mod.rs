//! Pipelines: stages wired over typed resources for one scene and one set of parameters, in frame order.

pub mod hsao;
pub mod params;
pub mod scalar_ao;
pub mod settings;
pub mod underwater;
pub mod volume_ao;
pub mod voxelization;
pub mod voxelize;

use std::collections::BTreeMap;

use serde_json::Value;

use crate::gpu::{Demand, Gpu, GpuError};
use crate::record::Work;
use crate::scene::{Scene, SceneFile, VolumeFile};
use crate::stages::{Stage, StageInfo};

/// A built pipeline: what a frame runs.
pub trait Pipeline {
    /// In frame order.
    fn stages(&self) -> Vec<&dyn Stage>;
    /// GPU memory that the pipeline's resources take.
    fn allocated_bytes(&self) -> u64;
    /// The final image, `Rgba8Unorm`.
    fn image(&self) -> &wgpu::Texture;
    /// What draws the image from a frame's results where the frame itself does not: run for pictures alone, never timed.
    fn presenting(&self) -> Vec<&dyn Stage> {
        Vec::new()
    }
    /// Figures that need a read-back of the last frame: rates of missed and unconverged photons and the like,
    /// `name → value`, the unit in the name.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError>;
    /// What an analysis of a stage's outputs needs besides them: an object whose keys go into the description of a dump.
    fn context(&self, stage: &str) -> Value {
        let _ = stage;
        Value::Null
    }
}

/// Builds a pipeline's resources for a scene and a parameter tree.
pub type Build = fn(&Gpu, &Scene, &Value) -> Result<Box<dyn Pipeline>, GpuError>;

/// A kind of pipeline, by name.
pub struct Kind {
    pub name: &'static str,
    pub about: &'static str,
    /// Every stage that some parameters run, in frame order.
    pub stages: &'static [StageInfo],
    /// The whole tree of parameters with the values that the scene file gives.
    pub defaults: fn(&SceneFile) -> Value,
    /// The scene file with the parameters that shape its geometry put in.
    pub scene_file: fn(&SceneFile, &Value) -> Result<SceneFile, String>,
    /// What the parameters ask of an adapter, before anything is allocated; an error names the parameter at fault.
    pub demand: fn(&Value, &Scene) -> Result<Demand, String>,
    pub build: Build,
}

/// Every kind. Adding a pipeline adds one line.
pub const KINDS: &[Kind] =
    &[underwater::KIND, voxelize::KIND, volume_ao::KIND, hsao::KIND, scalar_ao::KIND];

/// Cells of a volume that stands in for one that is too large.
const SMALLEST_CELLS: [u32; 3] = [8; 3];
/// Bytes that the host takes for a generated cell: the value while it is made and as it is kept, and its texel.
const CELL_HOST_BYTES: u64 = 10;
/// Time of generating a cell, in texel fetches as [`Work`] counts them: 256³ cells of `smoke` took some 15 s.
const CELL_FETCHES: u64 = 160;

/// What making a scene asks, from its file alone: the cells of a volume that a generator fills.
pub fn scene_demand(file: &SceneFile) -> Demand {
    let generated = file.volume.iter().filter(|v| v.generator.is_some());
    generated.fold(Demand::new(), |demand, volume| {
        let cells = volume.cells.map(|n| u64::from(n.div_ceil(volume.reduce.max(1))));
        let count = cells.iter().product::<u64>();
        let work = Work { texel_fetches: count * CELL_FETCHES, ..Work::default() };
        demand
            .texture_3d("volume.cells", cells)
            .copies("volume.cells", count * CELL_HOST_BYTES)
            .takes("volume.cells", work)
    })
}

/// The scene with as few cells as a volume can have.
pub fn smallest(file: SceneFile) -> SceneFile {
    let small = |volume: VolumeFile| VolumeFile { cells: SMALLEST_CELLS, reduce: 1, ..volume };
    SceneFile { volume: file.volume.map(small), ..file }
}

pub fn find(name: &str) -> Option<&'static Kind> {
    KINDS.iter().find(|kind| kind.name == name)
}
