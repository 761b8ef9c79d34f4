//! Kernels of a compute pass: arithmetic, atomics, and what reads through a bind group.

use super::kernel::{Kernel, all_are, buffer, clear};
use crate::gpu::frame::StageScope;
use crate::gpu::readback::read_buffer;
use crate::gpu::shader::compilation_options;
use crate::gpu::{Gpu, GpuError};
use crate::record::ceilings::Addresses;

const GROUP_SIZE: u32 = 64;
/// Invocations: enough to hide latencies.
const SOFTWARE_INVOCATIONS: u32 = 1 << 14;
const GPU_INVOCATIONS: u32 = 1 << 20;
/// Multiply-adds, and adds, of an invocation in a turn.
pub(super) const CHAINED: u32 = 64;
const ADDS: u32 = 8;
/// The sum of what the chains start with.
pub(super) const CHAIN_START: f64 = 4.0;
/// Sums of whole numbers are exact in 32-bit floats below 2²⁴.
pub(super) const MOST_CHAINED_TURNS: u32 = (1 << 24) / CHAINED / 2;

/// What an invocation's result must be after some turns.
pub(super) type Answer = Box<dyn Fn(u32, Vec<u8>) -> Result<(), String>>;

/// A compute pass with a loop of `turns` turns in each invocation.
pub(super) struct Invocations {
    pipeline: wgpu::ComputePipeline,
    bindings: wgpu::BindGroup,
    uniform: wgpu::Buffer,
    results: wgpu::Buffer,
    invocations: u32,
    pub(super) per_turn: f64,
    most_turns: u32,
    answer: Answer,
}

/// The entry point of a shader, and what it reads beside its work.
pub(super) struct Code<'a> {
    pub path: &'a str,
    pub entry: &'a str,
    pub defs: &'a [(&'a str, i32)],
    pub reads: Vec<(u32, wgpu::BindingResource<'a>)>,
}

impl Invocations {
    /// `per_turn` is the work of all invocations.
    pub(super) fn new(
        gpu: &Gpu,
        code: Code<'_>,
        per_turn: f64,
        most_turns: u32,
        answer: Answer,
    ) -> Result<Self, GpuError> {
        use wgpu::BufferUsages as Usage;
        let shader = gpu.shader(code.path, code.defs)?;
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("ceiling"),
            layout: None,
            module: &shader.module,
            entry_point: Some(code.entry),
            compilation_options: compilation_options(),
            cache: None,
        });
        let uniform = uniform(gpu);
        let invocations = invocations(gpu);
        let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        let results = buffer(gpu, u64::from(invocations) * 4, usage);
        let own = [(0, uniform.as_entire_binding()), (1, results.as_entire_binding())];
        let entries = own.into_iter().chain(code.reads);
        let entry = |(binding, resource)| wgpu::BindGroupEntry { binding, resource };
        let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("ceiling"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries.map(entry).collect::<Vec<_>>(),
        });
        Ok(Self { pipeline, bindings, uniform, results, invocations, per_turn, most_turns, answer })
    }

    /// Multiply-adds in registers.
    pub(super) fn arithmetic(gpu: &Gpu) -> Result<Self, GpuError> {
        let code = Code { path: "ceilings/arithmetic", entry: "compute", defs: &[], reads: vec![] };
        let per_turn = f64::from(invocations(gpu)) * f64::from(CHAINED);
        let answer: Answer = Box::new(|turns, results| {
            let expected = CHAIN_START + f64::from(CHAINED) * f64::from(turns);
            all_are(floats(&results), expected, 0.0)
        });
        Self::new(gpu, code, per_turn, MOST_CHAINED_TURNS, answer)
    }
}

/// Atomic adds to a buffer.
pub(super) fn atomics(gpu: &Gpu, addresses: Addresses) -> Result<Invocations, GpuError> {
    let contended = addresses == Addresses::Contended;
    let defs = [("CONTENDED", i32::from(contended))];
    let code = Code { path: "ceilings/atomics", entry: "main", defs: &defs, reads: vec![] };
    let invocations = invocations(gpu);
    let answer: Answer = Box::new(move |turns, results| {
        let adds = ADDS.wrapping_mul(turns);
        let adds = if contended { adds.wrapping_mul(invocations) } else { adds };
        let used = if contended { 4 } else { results.len() };
        all_are(words(&results[..used]).map(f64::from), f64::from(adds), 0.0)
    });
    let per_turn = f64::from(invocations) * f64::from(ADDS);
    Invocations::new(gpu, code, per_turn, u32::MAX, answer)
}

/// Invocations of each kernel on this adapter.
pub(super) fn invocations(gpu: &Gpu) -> u32 {
    if gpu.adapter.software { SOFTWARE_INVOCATIONS } else { GPU_INVOCATIONS }
}

/// Holds the number of turns, and the ones that the compiler must not know.
pub(super) fn uniform(gpu: &Gpu) -> wgpu::Buffer {
    buffer(gpu, 16, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST)
}

pub(super) fn write_turns(gpu: &Gpu, uniform: &wgpu::Buffer, turns: u32) {
    let one = 1f32.to_bits();
    let words = [turns, one, one, 0].map(u32::to_le_bytes);
    gpu.queue.write_buffer(uniform, 0, words.as_flattened());
}

pub(super) fn words(bytes: &[u8]) -> impl Iterator<Item = u32> {
    bytes.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
}

pub(super) fn floats(bytes: &[u8]) -> impl Iterator<Item = f64> {
    words(bytes).map(|word| f64::from(f32::from_bits(word)))
}

impl Kernel for Invocations {
    fn work_per_turn(&self) -> f64 {
        self.per_turn
    }

    fn most_turns(&self) -> u32 {
        self.most_turns
    }

    fn prepare(&self, gpu: &Gpu, turns: u32) {
        write_turns(gpu, &self.uniform, turns);
    }

    fn encode(&self, scope: &mut StageScope<'_>, _turns: u32) {
        scope.compute(|pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.bindings, &[]);
            pass.dispatch_workgroups(self.invocations / GROUP_SIZE, 1, 1);
        });
    }

    fn reset(&self, gpu: &Gpu) {
        clear(gpu, &self.results);
    }

    fn compare(&self, gpu: &Gpu, turns: u32) -> Result<Result<(), String>, GpuError> {
        Ok((self.answer)(turns, read_buffer(gpu, &self.results)?))
    }
}
