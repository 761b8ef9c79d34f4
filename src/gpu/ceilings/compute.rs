//! Kernels that compute, load and clear.

use super::kernel::{BenchKernel, KernelOutput, KernelWork, MAX_TURNS, READ_BYTES};
use crate::kit::{Bindings, Code, Dispatch, Resources};
use crate::{Gpu, GpuError, MAX_ITERATIONS, StageScope};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg32;

const GROUP_SIZE: u32 = 64;
/// Invocations of a compute pass: enough to hide latencies.
const SOFTWARE_INVOCATIONS: u32 = 1 << 14;
const GPU_INVOCATIONS: u32 = 1 << 20;
/// Loads and adds of an invocation in a turn.
pub(super) const OPERATIONS: u32 = 8;
/// Multiply-adds of an invocation in a turn. Their sum is exact in 32-bit floats for as many turns as there may be.
pub(super) const CHAINED: u32 = 64;
/// Edge of the textures in texels, as in the shader: small enough for the first caches.
pub(super) const EDGE: u32 = 64;

/// An entry point of `shaders/ceilings/compute.wgsl`.
pub(super) struct KernelCode<'a> {
    pub entry: &'a str,
    /// Work of an invocation in a turn, in units of the limit.
    pub work: u32,
    /// What a turn adds to its result.
    pub result: u32,
    /// What it reads beside its work: the groups behind that.
    pub reads: Vec<Bindings>,
    /// Iterations of loops within a turn.
    pub inner_loops: u64,
}

impl<'a> KernelCode<'a> {
    pub(super) fn new(entry: &'a str, work: u32, result: u32) -> Self {
        Self { entry, work, result, reads: vec![], inner_loops: 0 }
    }
}

/// Invocations of each kernel on this adapter.
fn invocations(gpu: &Gpu) -> u32 {
    if gpu.adapter.software { SOFTWARE_INVOCATIONS } else { GPU_INVOCATIONS }
}

pub(super) fn compute(gpu: &Gpu, code: KernelCode<'_>) -> Result<BenchKernel, GpuError> {
    let KernelCode { entry, work, result, reads, inner_loops } = code;
    let invocations = invocations(gpu);
    let resources = Resources::new(gpu);
    let uniform = resources.uniform("ceiling", &KernelWork::new(0));
    let results = resources.storage("ceiling", u64::from(invocations) * 4);
    let own = Bindings::new(&[&uniform, &results]);
    let groups: Vec<_> = std::iter::once(&own).chain(&reads).collect();
    let code = Code { entry, ..Code::from("ceilings/compute") };
    let workgroups = [invocations.div_ceil(GROUP_SIZE), 1, 1];
    let dispatch = Dispatch::new(&resources, code, &groups, workgroups)?;
    let encode = move |scope: &mut StageScope<'_>, _| scope.compute(|pass| dispatch.run(pass));
    Ok(BenchKernel {
        work_per_iteration: f64::from(invocations) * f64::from(work),
        max_iterations: (MAX_ITERATIONS / (1 + inner_loops)) as u32,
        uniform: Some(uniform),
        output: KernelOutput::Words(results.raw()),
        expected: Box::new(move |turns| f64::from(result.wrapping_mul(turns))),
        encode: Box::new(encode),
    })
}

pub(super) fn read(gpu: &Gpu, bytes: u64) -> Result<BenchKernel, GpuError> {
    // At random, as a GPU that compresses its memory reads what repeats faster. Four words each add up to 1.
    let content = || {
        let mut random = Pcg32::seed_from_u64(1);
        let words = move |_| {
            let [a, b, c]: [u32; 3] = random.random();
            [a, b, c, 1u32.wrapping_sub(a.wrapping_add(b).wrapping_add(c))]
        };
        (0..bytes / READ_BYTES).flat_map(words).flat_map(u32::to_le_bytes).collect()
    };
    let resources = Resources::new(gpu);
    let data = resources.filled_by("ceiling", bytes, wgpu::BufferUsages::STORAGE, content);
    // As in the shader: a workgroup's piece, and a workgroup's invocations beside one another.
    let group = u64::from(GROUP_SIZE);
    let groups = u64::from(invocations(gpu)) / group;
    let reads = ((bytes / READ_BYTES / groups).max(group) / group) as u32;
    let code = KernelCode::new("sum_words", reads * READ_BYTES as u32, reads);
    let reads = vec![Bindings::new(&[&data])];
    compute(gpu, KernelCode { reads, inner_loops: u64::from(code.result) + 1, ..code })
}

/// The textures of loads of this many slices, behind the groups before theirs.
pub(super) fn texels(gpu: &Gpu, slices: u32) -> Vec<Bindings> {
    // The fastest: lavapipe has code of its own for four bytes.
    let (format, channels) = if gpu.adapter.software {
        (wgpu::TextureFormat::Rgba8Unorm, 4)
    } else {
        (wgpu::TextureFormat::R8Unorm, 1)
    };
    let flat = slices == 1;
    let dimension = if flat { wgpu::TextureDimension::D2 } else { wgpu::TextureDimension::D3 };
    let size = wgpu::Extent3d { width: EDGE, height: EDGE, depth_or_array_layers: slices };
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let resources = Resources::new(gpu);
    let texture = resources.texture("ceiling", (dimension, size), format, usage, 1);
    // A row repeats eight texels, of which each pair has a 1 at a random one of its places.
    let mut random = Pcg32::seed_from_u64(1);
    let rows: Vec<u32> = (0..slices * EDGE).map(|_| random.random()).collect();
    let value = |row: u32, x: u32| 255 * ((row >> (x % 8 / 2) ^ x) % 2) as u8;
    let values = rows.into_iter().flat_map(|row| (0..EDGE).map(move |x| value(row, x)));
    let bytes: Vec<u8> = values.flat_map(|value| vec![value; channels]).collect();
    resources.write_level(&texture, 0, &bytes);
    let before = vec![Bindings::new(&[]); if flat { 1 } else { 2 }];
    before.into_iter().chain([Bindings::new(&[&texture])]).collect()
}

pub(super) fn clear(gpu: &Gpu, bytes: u64) -> BenchKernel {
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffer = gpu.buffer("ceiling", bytes, usage);
    let cleared = buffer.clone();
    let encode = move |scope: &mut StageScope<'_>, turns| {
        scope.copy(|encoder| (0..turns).for_each(|_| encoder.clear_buffer(&cleared, 0, None)));
    };
    BenchKernel {
        work_per_iteration: bytes as f64,
        max_iterations: MAX_TURNS,
        uniform: None,
        output: KernelOutput::Cleared(buffer),
        expected: Box::new(|_| 0.0),
        encode: Box::new(encode),
    }
}
