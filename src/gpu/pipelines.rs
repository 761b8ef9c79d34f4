//! Pipelines of a device, kept by everything that they are compiled from. Most cells of an experiment differ in sizes only and
//! share all of theirs, and the driver's compiled code with them.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

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

/// How many pipelines were made, and what this took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MadePipelines {
    pub count: u32,
    pub ns: f64,
}

/// The pipelines of a device that were made up to now.
#[derive(Default)]
pub(super) struct Pipelines {
    created: Mutex<MadePipelines>,
    kernels: Mutex<HashMap<KernelKey, wgpu::ComputePipeline>>,
    rasters: Mutex<HashMap<RasterKey, wgpu::RenderPipeline>>,
}

type PipelineMaps =
    (HashMap<KernelKey, wgpu::ComputePipeline>, HashMap<RasterKey, wgpu::RenderPipeline>);

impl Pipelines {
    fn time_creation<P>(&self, make: impl FnOnce() -> P) -> P {
        let start = Instant::now();
        let pipeline = make();
        let mut made = self.created.lock().unwrap_or_else(PoisonError::into_inner);
        made.count += 1;
        made.ns += start.elapsed().as_secs_f64() * 1e9;
        pipeline
    }

    pub(super) fn clear(&self) {
        drop(self.take());
    }

    fn take(&self) -> PipelineMaps {
        let mut kernels = self.kernels.lock().unwrap_or_else(PoisonError::into_inner);
        let mut rasters = self.rasters.lock().unwrap_or_else(PoisonError::into_inner);
        (std::mem::take(&mut *kernels), std::mem::take(&mut *rasters))
    }

    fn restore(&self, (kernels, rasters): PipelineMaps) {
        *self.kernels.lock().unwrap_or_else(PoisonError::into_inner) = kernels;
        *self.rasters.lock().unwrap_or_else(PoisonError::into_inner) = rasters;
    }
}

impl Gpu {
    /// Gives back pipelines that nothing uses any more, and the driver's compiled code with them.
    pub fn drop_pipelines(&self) {
        self.pipelines.clear();
    }

    /// What making pipelines took within `f`.
    pub fn time_pipelines<T>(&self, f: impl FnOnce() -> T) -> (T, MadePipelines) {
        let made = || *self.pipelines.created.lock().unwrap_or_else(PoisonError::into_inner);
        let before = made();
        let result = f();
        let after = made();
        (result, MadePipelines { count: after.count - before.count, ns: after.ns - before.ns })
    }

    /// The same where `f` finds no pipeline that was made before.
    pub fn time_all_pipelines<T>(&self, f: impl FnOnce() -> T) -> (T, MadePipelines) {
        let known = self.pipelines.take();
        let made = self.time_pipelines(f);
        self.pipelines.restore(known);
        made
    }

    /// The pipeline of this key, made where there is none yet.
    pub fn kernel(
        &self,
        key: KernelKey,
        make: impl FnOnce() -> wgpu::ComputePipeline,
    ) -> wgpu::ComputePipeline {
        get_or_create(&self.pipelines.kernels, key, || self.pipelines.time_creation(make))
    }

    /// The pipeline of this key, made where there is none yet.
    pub fn raster(
        &self,
        key: RasterKey,
        make: impl FnOnce() -> wgpu::RenderPipeline,
    ) -> wgpu::RenderPipeline {
        get_or_create(&self.pipelines.rasters, key, || self.pipelines.time_creation(make))
    }
}

fn get_or_create<K: Eq + Hash, P: Clone>(
    known: &Mutex<HashMap<K, P>>,
    key: K,
    make: impl FnOnce() -> P,
) -> P {
    let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry(key).or_insert_with(make).clone()
}
