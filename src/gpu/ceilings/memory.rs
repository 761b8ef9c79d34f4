//! Kernels that move memory: copying, clearing, reading.

use super::invocations::{Answer, Code, GROUP_SIZE, Invocations, invocations, words};
use super::kernel::{Kernel, clear};
use crate::StageScope;
use crate::readback::read_buffer;
use crate::{Gpu, GpuError};

/// What buffers are filled with: a block of consecutive words over and over.
const BLOCK_WORDS: u32 = 1 << 12;
/// Of one read: four words.
const READ_BYTES: u64 = 16;

fn block() -> Vec<u8> {
    (0..BLOCK_WORDS).flat_map(u32::to_le_bytes).collect()
}

/// A buffer that holds the block over and over.
fn filled(gpu: &Gpu, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let filled = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("ceiling"),
        size,
        usage,
        mapped_at_creation: true,
    });
    let block = block();
    if let Ok(mut bytes) = filled.get_mapped_range_mut(..) {
        for at in (0..size as usize).step_by(block.len()) {
            bytes.slice(at..at + block.len()).copy_from_slice(&block);
        }
    }
    filled.unmap();
    filled
}

/// Fails unless the buffer holds what it was filled with, or zeros where there is no block.
fn holds(bytes: &[u8], block: &[u8]) -> Result<(), String> {
    let wrong = bytes.chunks_exact(block.len()).position(|chunk| chunk != block);
    wrong.map_or(Ok(()), |chunk| {
        Err(format!("bytes from {} on were not written", chunk * block.len()))
    })
}

/// Copies a buffer to another of the same size, a copy a turn.
pub(super) struct Copy {
    from: wgpu::Buffer,
    to: wgpu::Buffer,
}

impl Copy {
    pub(super) fn new(gpu: &Gpu, working_set_bytes: u64) -> Self {
        use wgpu::BufferUsages as Usage;
        let bytes = working_set_bytes / 2;
        Self {
            from: filled(gpu, bytes, Usage::COPY_SRC),
            to: gpu.buffer("ceiling", bytes, Usage::COPY_DST | Usage::COPY_SRC),
        }
    }
}

impl Kernel for Copy {
    /// Read and written.
    fn work_per_turn(&self) -> f64 {
        2.0 * self.from.size() as f64
    }

    fn encode(&self, scope: &mut StageScope<'_>, turns: u32) {
        scope.copy(|encoder| {
            for _ in 0..turns {
                encoder.copy_buffer_to_buffer(&self.from, 0, &self.to, 0, self.from.size());
            }
        });
    }

    fn reset(&self, gpu: &Gpu) {
        clear(gpu, &self.to);
    }

    fn compare(&self, gpu: &Gpu, _turns: u32) -> Result<Result<(), String>, GpuError> {
        Ok(holds(&read_buffer(gpu, &self.to)?, &block()))
    }
}

/// Clears a buffer, once a turn.
pub(super) struct Clear {
    cleared: wgpu::Buffer,
}

impl Clear {
    pub(super) fn new(gpu: &Gpu, bytes: u64) -> Self {
        use wgpu::BufferUsages as Usage;
        Self { cleared: filled(gpu, bytes, Usage::COPY_DST | Usage::COPY_SRC) }
    }
}

impl Kernel for Clear {
    fn work_per_turn(&self) -> f64 {
        self.cleared.size() as f64
    }

    fn encode(&self, scope: &mut StageScope<'_>, turns: u32) {
        scope.copy(|encoder| {
            for _ in 0..turns {
                encoder.clear_buffer(&self.cleared, 0, None);
            }
        });
    }

    /// The buffer was full of words before the first run.
    fn compare(&self, gpu: &Gpu, _turns: u32) -> Result<Result<(), String>, GpuError> {
        Ok(holds(&read_buffer(gpu, &self.cleared)?, &vec![0; block().len()]))
    }
}

/// Reads a buffer in a compute pass, once a turn.
pub(super) fn read(gpu: &Gpu, bytes: u64) -> Result<Invocations, GpuError> {
    let data = filled(gpu, bytes, wgpu::BufferUsages::STORAGE);
    let reads = vec![(2, data.as_entire_binding())];
    // As in the shader: a workgroup's piece, and a workgroup's invocations beside one another.
    let group = u64::from(GROUP_SIZE);
    let groups = u64::from(invocations(gpu)) / group;
    let within = (bytes / READ_BYTES / groups).max(group) / group + 1;
    let code = Code { path: "ceilings/read", entry: "main", defs: &[], reads, within };
    // Each invocation reads at least once: see the shader.
    let read = bytes.max(u64::from(invocations(gpu)) * READ_BYTES);
    let blocks = (read / 4 / u64::from(BLOCK_WORDS)) as u32;
    let answer: Answer = Box::new(move |turns, results| {
        let of_block = (0..BLOCK_WORDS).fold(0, u32::wrapping_add);
        let expected = of_block.wrapping_mul(blocks).wrapping_mul(turns);
        let sum = words(&results).fold(0, u32::wrapping_add);
        let wrong = || format!("the words read add up to {sum}, not to {expected}");
        (sum == expected).then_some(()).ok_or_else(wrong)
    });
    Invocations::new(gpu, code, read as f64, u32::MAX, answer)
}
