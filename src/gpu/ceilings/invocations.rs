//! Kernels of a compute pass: each invocation does its turns and leaves a result.

use super::kernel::{Kernel, clear};
use crate::StageScope;
use crate::readback::read_buffer;
use crate::shader::compilation_options;
use crate::{Gpu, GpuError, MOST_LOOP_TURNS};

pub(super) const GROUP_SIZE: u32 = 64;
/// Invocations: enough to hide latencies.
const SOFTWARE_INVOCATIONS: u32 = 1 << 14;
const GPU_INVOCATIONS: u32 = 1 << 20;

/// What an invocation's result must be after some turns.
pub(super) type Answer = Box<dyn Fn(u32, Vec<u8>) -> Result<(), String>>;

/// A compute pass with a loop of `turns` turns in each invocation.
pub(super) struct Invocations {
    pipeline: wgpu::ComputePipeline,
    bindings: wgpu::BindGroup,
    uniform: wgpu::Buffer,
    results: wgpu::Buffer,
    invocations: u32,
    per_turn: f64,
    most_turns: u32,
    answer: Answer,
}

/// The entry point of a shader, and what it reads beside its work.
pub(super) struct Code<'a> {
    pub path: &'a str,
    pub entry: &'a str,
    pub defs: &'a [(&'a str, i32)],
    pub reads: Vec<(u32, wgpu::BindingResource<'a>)>,
    /// Turns of loops within a turn.
    pub within: u64,
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
        let most_turns = u64::from(most_turns).min(MOST_LOOP_TURNS / (1 + code.within)) as u32;
        let uniform = uniform(gpu);
        let invocations = invocations(gpu);
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
        Ok(Self { pipeline, bindings, uniform, results, invocations, per_turn, most_turns, answer })
    }
}

/// Invocations of each kernel on this adapter.
pub(super) fn invocations(gpu: &Gpu) -> u32 {
    if gpu.adapter.software { SOFTWARE_INVOCATIONS } else { GPU_INVOCATIONS }
}

/// Holds the number of turns, and the ones that the compiler must not know.
pub(super) fn uniform(gpu: &Gpu) -> wgpu::Buffer {
    gpu.buffer("ceiling", 16, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST)
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
