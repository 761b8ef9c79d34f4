//! Kernels that compute, load and clear.

use super::kernel::{BenchKernel, KernelOutput, MAX_TURNS, READ_BYTES};
use crate::shader::compilation_options;
use crate::{Gpu, GpuError, MAX_ITERATIONS, StageScope};
use fathom_record::PassKind;

const GROUP_SIZE: u32 = 64;
/// Invocations of a compute pass: enough to hide latencies.
const SOFTWARE_INVOCATIONS: u32 = 1 << 14;
const GPU_INVOCATIONS: u32 = 1 << 20;
/// Loads and adds of an invocation in a turn.
pub(super) const OPERATIONS: u32 = 8;
/// Multiply-adds of an invocation in a turn. Their sum is exact in 32-bit floats for as many turns as there may be.
pub(super) const CHAINED: u32 = 64;
/// Four words each that add up to 1, over and over in a buffer that is read.
const BLOCK_READS: u32 = 1 << 10;
/// Edge of the textures in texels, as in the shader: small enough for the first caches.
pub(super) const EDGE: u32 = 64;

/// An entry point of `shaders/ceilings/compute.wgsl`.
pub(super) struct KernelCode<'a> {
    pub entry: &'a str,
    /// Work of an invocation in a turn, in units of the limit.
    pub work: u32,
    /// What a turn adds to its result.
    pub result: u32,
    /// What it reads beside its work, by binding.
    pub reads: Vec<(u32, wgpu::BindingResource<'a>)>,
    /// Iterations of loops within a turn.
    pub inner_loops: u64,
    /// One invocation in a pass, and a pass a turn.
    pub is_empty: bool,
}

impl<'a> KernelCode<'a> {
    pub(super) fn new(entry: &'a str, work: u32, result: u32) -> Self {
        Self { entry, work, result, reads: vec![], inner_loops: 0, is_empty: false }
    }
}

/// Invocations of each kernel on this adapter.
fn invocations(gpu: &Gpu) -> u32 {
    if gpu.adapter.software { SOFTWARE_INVOCATIONS } else { GPU_INVOCATIONS }
}

pub(super) fn compute(gpu: &Gpu, code: KernelCode<'_>) -> Result<BenchKernel, GpuError> {
    use wgpu::BufferUsages as Usage;
    let shader = gpu.shader("ceilings/compute", &[])?;
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("ceiling"),
        layout: None,
        module: &shader.module,
        entry_point: Some(code.entry),
        compilation_options: compilation_options(),
        cache: None,
    });
    let KernelCode { work, result, inner_loops, is_empty, .. } = code;
    let invocations = if is_empty { 1 } else { invocations(gpu) };
    let uniform = gpu.buffer("ceiling", 16, Usage::UNIFORM | Usage::COPY_DST);
    let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
    let results = gpu.buffer("ceiling", u64::from(invocations) * 4, usage);
    let own = [(0, uniform.as_entire_binding()), (1, results.as_entire_binding())];
    let entries = own.into_iter().chain(code.reads);
    let entry = |(binding, resource)| wgpu::BindGroupEntry { binding, resource };
    let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("ceiling"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries.map(entry).collect::<Vec<_>>(),
    });
    let encode = move |scope: &mut StageScope<'_>, turns| {
        for _ in 0..if is_empty { turns } else { 1 } {
            scope.compute(|pass| {
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &bindings, &[]);
                pass.dispatch_workgroups(invocations.div_ceil(GROUP_SIZE), 1, 1);
            });
        }
    };
    Ok(BenchKernel {
        work_per_turn: f64::from(invocations) * f64::from(work),
        max_turns: (MAX_ITERATIONS / (1 + inner_loops)) as u32,
        frame_of: is_empty.then_some(PassKind::Compute),
        uniform: Some(uniform),
        output: KernelOutput::Words(results),
        expected: Box::new(move |turns| f64::from(result.wrapping_mul(turns))),
        encode: Box::new(encode),
    })
}

pub(super) fn read(gpu: &Gpu, bytes: u64) -> Result<BenchKernel, GpuError> {
    let data = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("ceiling"),
        size: bytes,
        usage: wgpu::BufferUsages::STORAGE,
        mapped_at_creation: true,
    });
    let reads = (0..BLOCK_READS).flat_map(|i| [i, !i, 2, 0]);
    let block: Vec<u8> = reads.flat_map(u32::to_le_bytes).collect();
    if let Ok(mut filled) = data.get_mapped_range_mut(..) {
        for at in (0..bytes as usize).step_by(block.len()) {
            filled.slice(at..at + block.len()).copy_from_slice(&block);
        }
    }
    data.unmap();
    // As in the shader: a workgroup's piece, and a workgroup's invocations beside one another.
    let group = u64::from(GROUP_SIZE);
    let groups = u64::from(invocations(gpu)) / group;
    let reads = ((bytes / READ_BYTES / groups).max(group) / group) as u32;
    let code = KernelCode::new("sum_words", reads * READ_BYTES as u32, reads);
    let reads = vec![(2, data.as_entire_binding())];
    compute(gpu, KernelCode { reads, inner_loops: u64::from(code.result) + 1, ..code })
}

/// Loads from a texture of so many slices, at this binding.
pub(super) fn load(
    gpu: &Gpu,
    entry: &str,
    (binding, slices): (u32, u32),
) -> Result<BenchKernel, GpuError> {
    use wgpu::util::DeviceExt as _;
    // The fastest: lavapipe has code of its own for four bytes.
    let (format, channels) = if gpu.adapter.software {
        (wgpu::TextureFormat::Rgba8Unorm, 4)
    } else {
        (wgpu::TextureFormat::R8Unorm, 1)
    };
    let flat = slices == 1;
    let descriptor = wgpu::TextureDescriptor {
        label: Some("ceiling"),
        size: wgpu::Extent3d { width: EDGE, height: EDGE, depth_or_array_layers: slices },
        mip_level_count: 1,
        sample_count: 1,
        dimension: if flat { wgpu::TextureDimension::D2 } else { wgpu::TextureDimension::D3 },
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let rows = (0..slices).flat_map(|z| (0..EDGE).map(move |y| y + z));
    let values = rows.flat_map(|row| (0..EDGE).map(move |x| 255 * ((x + row) % 2) as u8));
    let bytes: Vec<u8> = values.flat_map(|value| vec![value; channels]).collect();
    let (device, queue) = (&gpu.device, &gpu.queue);
    let texture = device.create_texture_with_data(queue, &descriptor, Default::default(), &bytes);
    let view = texture.create_view(&Default::default());
    let reads = vec![(binding, wgpu::BindingResource::TextureView(&view))];
    compute(gpu, KernelCode { reads, ..KernelCode::new(entry, OPERATIONS, OPERATIONS / 2) })
}

pub(super) fn clear(gpu: &Gpu, bytes: u64) -> BenchKernel {
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffer = gpu.buffer("ceiling", bytes, usage);
    let cleared = buffer.clone();
    let encode = move |scope: &mut StageScope<'_>, turns| {
        scope.copy(|encoder| (0..turns).for_each(|_| encoder.clear_buffer(&cleared, 0, None)));
    };
    BenchKernel {
        work_per_turn: bytes as f64,
        max_turns: MAX_TURNS,
        frame_of: None,
        uniform: None,
        output: KernelOutput::Cleared(buffer),
        expected: Box::new(|_| 0.0),
        encode: Box::new(encode),
    }
}
