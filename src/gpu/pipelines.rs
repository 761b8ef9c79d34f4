//! Pipelines of a device, kept by everything that they are compiled from. Most cells of an experiment differ in sizes only and
//! share all of theirs, and the driver's compiled code with them.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

use super::Gpu;

/// What a compute pipeline is compiled from.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct KernelKey {
    pub code: CodeKey,
    pub entry: String,
    pub groups: Vec<GroupKey>,
}

/// What a render pipeline is compiled from.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct RasterKey {
    pub code: CodeKey,
    pub groups: Vec<GroupKey>,
    pub vertex: String,
    pub fragment: Option<String>,
    pub buffers: Vec<(wgpu::BufferAddress, wgpu::VertexStepMode, Vec<wgpu::VertexAttribute>)>,
    pub targets: Vec<wgpu::ColorTargetState>,
    pub depth: Option<wgpu::DepthStencilState>,
    pub primitive: wgpu::PrimitiveState,
}

/// A shader's path and the values of the host that it is compiled with.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CodeKey {
    pub path: String,
    pub defs: Vec<(String, i32)>,
}

impl CodeKey {
    pub fn new(path: &str, defs: &[(&str, i32)]) -> Self {
        let defs = defs.iter().map(|(name, value)| ((*name).to_owned(), *value));
        Self { path: path.to_owned(), defs: defs.collect() }
    }
}

/// The layout of a bind group.
pub type GroupKey = Vec<wgpu::BindGroupLayoutEntry>;

/// The pipelines of a device that were made up to now.
#[derive(Default)]
pub(super) struct Pipelines {
    kernels: PipelineMap<KernelKey, wgpu::ComputePipeline>,
    rasters: PipelineMap<RasterKey, wgpu::RenderPipeline>,
    /// Counts uses.
    uses: AtomicU64,
}

/// Each with the number of its latest use.
type PipelineMap<K, P> = Mutex<HashMap<K, (P, u64)>>;

/// Pipelines that are kept on a software driver, whose compiled code is the process's own memory: so a run of 4 minutes has 1.0 GiB.
const SOFTWARE_PIPELINES: usize = 96;

impl Pipelines {
    /// Gives back all but so many, those that were used last.
    pub(super) fn keep(&self, most: usize) {
        let mut kernels = self.kernels.lock().unwrap_or_else(PoisonError::into_inner);
        let mut rasters = self.rasters.lock().unwrap_or_else(PoisonError::into_inner);
        let mut uses: Vec<u64> =
            kernels.values().map(|of| of.1).chain(rasters.values().map(|of| of.1)).collect();
        uses.sort_unstable_by_key(|used| Reverse(*used));
        let Some(last) = uses.get(most) else { return };
        kernels.retain(|_, (_, used)| *used > *last);
        rasters.retain(|_, (_, used)| *used > *last);
    }

    fn next_use(&self) -> u64 {
        self.uses.fetch_add(1, Relaxed)
    }
}

impl Gpu {
    /// Gives back pipelines that nothing uses any more, and the driver's compiled code with them.
    pub fn drop_pipelines(&self) {
        self.pipelines.keep(0);
    }

    /// On a software driver gives back those that were not used for longest, and the driver's compiled code with them.
    pub fn keep_pipelines(&self) {
        if self.adapter.software {
            self.pipelines.keep(SOFTWARE_PIPELINES);
        }
    }

    /// The pipeline of this key, made where there is none yet.
    pub fn kernel(
        &self,
        key: KernelKey,
        make: impl FnOnce() -> wgpu::ComputePipeline,
    ) -> wgpu::ComputePipeline {
        get_or_create(&self.pipelines.kernels, self.pipelines.next_use(), key, make)
    }

    /// The pipeline of this key, made where there is none yet.
    pub fn raster(
        &self,
        key: RasterKey,
        make: impl FnOnce() -> wgpu::RenderPipeline,
    ) -> wgpu::RenderPipeline {
        get_or_create(&self.pipelines.rasters, self.pipelines.next_use(), key, make)
    }
}

fn get_or_create<K: Eq + Hash, P: Clone>(
    known: &PipelineMap<K, P>,
    number: u64,
    key: K,
    make: impl FnOnce() -> P,
) -> P {
    let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
    let (pipeline, used) = known.entry(key).or_insert_with(|| (make(), 0));
    *used = number;
    pipeline.clone()
}
