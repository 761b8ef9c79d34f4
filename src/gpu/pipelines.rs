//! Pipelines of a device, kept by everything that they are compiled from. Most cells of an experiment differ in sizes only and
//! share all of theirs, and the driver's compiled code with them.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Mutex, PoisonError};

use super::Gpu;

/// What a compute pipeline is compiled from.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct KernelKey {
    pub code: CodeKey,
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
    pub topology: wgpu::PrimitiveTopology,
}

/// A shader's path and the values of the host that it is compiled with.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct CodeKey {
    pub path: String,
    pub defs: Vec<(String, i32)>,
}

/// The layout of a bind group.
pub type GroupKey = Vec<wgpu::BindGroupLayoutEntry>;

/// The pipelines of a device that were made up to now.
#[derive(Default)]
pub(super) struct Pipelines {
    kernels: Mutex<HashMap<KernelKey, wgpu::ComputePipeline>>,
    rasters: Mutex<HashMap<RasterKey, wgpu::RenderPipeline>>,
}

impl Pipelines {
    pub(super) fn clear(&self) {
        self.kernels.lock().unwrap_or_else(PoisonError::into_inner).clear();
        self.rasters.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}

impl Gpu {
    /// Gives back pipelines that nothing uses any more, and the driver's compiled code with them.
    pub fn forget_pipelines(&self) {
        self.pipelines.clear();
    }

    /// The pipeline of this key, made where there is none yet.
    pub fn kernel(
        &self,
        key: KernelKey,
        make: impl FnOnce() -> wgpu::ComputePipeline,
    ) -> wgpu::ComputePipeline {
        known_or_made(&self.pipelines.kernels, key, make)
    }

    /// The pipeline of this key, made where there is none yet.
    pub fn raster(
        &self,
        key: RasterKey,
        make: impl FnOnce() -> wgpu::RenderPipeline,
    ) -> wgpu::RenderPipeline {
        known_or_made(&self.pipelines.rasters, key, make)
    }
}

fn known_or_made<K: Eq + Hash, P: Clone>(
    known: &Mutex<HashMap<K, P>>,
    key: K,
    make: impl FnOnce() -> P,
) -> P {
    let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry(key).or_insert_with(make).clone()
}
