//! Passes whose work and results are known.

use crate::kit::{Buffer, host_bytes};
use crate::readback::{read_buffer, read_texture};
use crate::{Gpu, GpuError, StageScope, TimedStage, shader_struct};

/// Sums of ones are exact in 32-bit floats up to here.
pub(super) const MAX_TURNS: u32 = 1 << 24;
/// Bytes of one read: four words.
pub(super) const READ_BYTES: u64 = 16;
/// Sums of fragments may be off by this share.
const TOLERANCE: f64 = 1e-6;

shader_struct! {
    pub(super) struct KernelWork {
        pub turns: u32,
        /// Both 1, which the compiler cannot know.
        pub factor: f32,
        pub addend: f32,
    }
}

impl KernelWork {
    pub(super) fn new(turns: u32) -> Self {
        Self { turns, factor: 1.0, addend: 1.0 }
    }
}

/// Encodes so many turns.
type Encode = Box<dyn Fn(&mut StageScope<'_>, u32)>;

/// Passes whose work is known.
pub(super) struct BenchKernel {
    /// Work of a turn, in units of the limit.
    pub work_per_iteration: f64,
    /// Beyond so many turns the result is not exact, or a loop is too long.
    pub max_iterations: u32,
    /// Holds the number of turns.
    pub uniform: Option<Buffer>,
    pub output: KernelOutput,
    /// What every value of the output is after so many turns.
    pub expected: Box<dyn Fn(u32) -> f64>,
    pub encode: Encode,
}

/// What a kernel writes.
pub(super) enum KernelOutput {
    /// Added to from zero on.
    Words(wgpu::Buffer),
    Cleared(wgpu::Buffer),
    Texels(wgpu::Texture),
}

impl BenchKernel {
    /// Sets the number of turns.
    pub(super) fn prepare(&self, gpu: &Gpu, turns: u32) {
        if let Some(uniform) = &self.uniform {
            gpu.queue.write_buffer(uniform, 0, &host_bytes(&KernelWork::new(turns)));
        }
    }

    /// Clears what a run leaves, where the run itself does not.
    pub(super) fn reset(&self, gpu: &Gpu) {
        match &self.output {
            KernelOutput::Words(buffer) => {
                let mut encoder = gpu.device.create_command_encoder(&Default::default());
                encoder.clear_buffer(buffer, 0, None);
                gpu.queue.submit([encoder.finish()]);
            }
            KernelOutput::Cleared(buffer) => {
                let end = buffer.size() - READ_BYTES;
                gpu.queue.write_buffer(buffer, end, &[1; READ_BYTES as usize]);
            }
            KernelOutput::Texels(_) => {}
        }
    }

    /// Runs it once more and compares its result. The inner error says how it differs.
    pub(super) fn check(&self, gpu: &Gpu, iterations: u32) -> Result<Result<(), String>, GpuError> {
        self.reset(gpu);
        self.prepare(gpu, iterations);
        gpu.run(&[&KernelRun { kernel: self, iterations }])?;
        self.compare(gpu, iterations)
    }

    /// Compares what a run of so many turns has left after a reset with the CPU's answer.
    pub(super) fn compare(&self, gpu: &Gpu, turns: u32) -> Result<Result<(), String>, GpuError> {
        let expected = (self.expected)(turns);
        let is_wrong = |value: &f64| (value - expected).abs() > TOLERANCE * expected;
        let wrong = match &self.output {
            KernelOutput::Words(buffer) | KernelOutput::Cleared(buffer) => {
                let bytes = read_buffer(gpu, buffer)?;
                let word = (expected as u32).to_le_bytes();
                let wrong = bytes.as_chunks().0.iter().find(|found| **found != word);
                wrong.map(|found| f64::from(u32::from_le_bytes(*found)))
            }
            KernelOutput::Texels(texture) => {
                let texels = read_texture(gpu, texture)?.data;
                texels.into_iter().map(f64::from).find(is_wrong)
            }
        };
        Ok(wrong.map_or(Ok(()), |value| {
            Err(format!(
                "the adapter's result is {value}, the CPU's {expected}: its work is not done"
            ))
        }))
    }
}

/// A kernel with its number of turns.
pub(super) struct KernelRun<'a> {
    pub kernel: &'a BenchKernel,
    pub iterations: u32,
}

impl TimedStage for KernelRun<'_> {
    fn name(&self) -> &'static str {
        "ceiling"
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        (self.kernel.encode)(scope, self.iterations);
    }
}
