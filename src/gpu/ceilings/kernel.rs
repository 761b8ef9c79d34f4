//! What kernels share: the trait, resources, and which one belongs to a limit.

use crate::{Gpu, GpuError, StageScope, TimedStage};
use fathom_record::PassKind;
use fathom_record::ceilings::{Limit, TexelFormat};

use super::memory::{Clear, Copy};
use super::pass::EmptyPasses;
use super::raster::Raster;
use super::{arithmetic, atomics, memory, texels};

/// How a kernel is timed.
#[derive(Clone, Copy)]
pub(super) enum Timing {
    /// As a stage's pass.
    Pass,
    /// As a frame of many passes of this kind, less the cost of its submission.
    Frame(PassKind),
}

/// Passes whose work is known.
pub(super) trait Kernel {
    /// Work of a turn, in units of the limit.
    fn work_per_turn(&self) -> f64;
    /// What encoding so many turns needs.
    fn prepare(&self, _gpu: &Gpu, _turns: u32) {}
    fn encode(&self, scope: &mut StageScope<'_>, turns: u32);
    fn timing(&self) -> Timing {
        Timing::Pass
    }
    /// Beyond so many turns the result is not exact.
    fn most_turns(&self) -> u32 {
        1 << 24
    }
    /// Clears what a run leaves, where the run itself does not.
    fn reset(&self, _gpu: &Gpu) {}
    /// Compares what a run of so many turns has left after a reset with the CPU's answer. The inner error says how they differ.
    fn compare(&self, gpu: &Gpu, turns: u32) -> Result<Result<(), String>, GpuError>;
}

/// A kernel with its number of turns.
pub(super) struct Turns<'a> {
    pub kernel: &'a dyn Kernel,
    pub turns: u32,
}

impl TimedStage for Turns<'_> {
    fn name(&self) -> &'static str {
        "ceiling"
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.kernel.encode(scope, self.turns);
    }
}

/// Runs a kernel once more and compares its result.
pub(super) fn check(
    gpu: &Gpu,
    kernel: &dyn Kernel,
    turns: u32,
) -> Result<Result<(), String>, GpuError> {
    kernel.reset(gpu);
    kernel.prepare(gpu, turns);
    gpu.run(&[&Turns { kernel, turns }])?;
    kernel.compare(gpu, turns)
}

/// Fills a buffer with zeros.
pub(super) fn clear(gpu: &Gpu, buffer: &wgpu::Buffer) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.clear_buffer(buffer, 0, None);
    gpu.queue.submit([encoder.finish()]);
}

/// The kernel of a limit.
pub(super) fn of(gpu: &Gpu, limit: Limit) -> Result<Box<dyn Kernel>, GpuError> {
    gpu.scoped(|| {
        Ok(match limit {
            Limit::Copy { working_set_bytes: bytes } => boxed(Copy::new(gpu, bytes)),
            Limit::Write { working_set_bytes: bytes } => boxed(Clear::new(gpu, bytes)),
            Limit::Read { working_set_bytes: bytes } => boxed(memory::read(gpu, bytes)?),
            Limit::Fill { format, blending } => boxed(Raster::fill(gpu, format, blending)?),
            Limit::Load2d { format } => boxed(texels::load(gpu, format)?),
            Limit::Gather2d { format } => boxed(texels::gather(gpu, format)?),
            Limit::Sample3d { format } => boxed(texels::sample(gpu, format)?),
            Limit::Atomics { addresses } => boxed(atomics::atomics(gpu, addresses)?),
            Limit::Arithmetic { pass: PassKind::Render } => boxed(arithmetic::Fragments::new(gpu)?),
            Limit::Arithmetic { .. } => boxed(arithmetic::compute(gpu)?),
            Limit::Primitives { primitive } => boxed(Raster::primitives(gpu, primitive)?),
            Limit::EmptyPass { pass } => boxed(EmptyPasses::new(gpu, pass)?),
        })
    })
}

fn boxed(kernel: impl Kernel + 'static) -> Box<dyn Kernel> {
    Box::new(kernel)
}

/// The texture format.
pub(super) fn format(format: TexelFormat) -> wgpu::TextureFormat {
    match format {
        TexelFormat::R8Unorm => wgpu::TextureFormat::R8Unorm,
        TexelFormat::Rgba8Unorm => wgpu::TextureFormat::Rgba8Unorm,
        TexelFormat::R16Float => wgpu::TextureFormat::R16Float,
        TexelFormat::Rgba16Float => wgpu::TextureFormat::Rgba16Float,
        TexelFormat::R32Float => wgpu::TextureFormat::R32Float,
        TexelFormat::Rgba32Float => wgpu::TextureFormat::Rgba32Float,
        TexelFormat::Depth32Float => wgpu::TextureFormat::Depth32Float,
    }
}

/// Whether fragments can be blended into targets of this format.
pub(super) fn blends(gpu: &Gpu, of: TexelFormat) -> bool {
    let flags = format(of).guaranteed_format_features(gpu.features).flags;
    flags.contains(wgpu::TextureFormatFeatureFlags::BLENDABLE)
}

/// Whether textures of this format can be sampled with a filter.
pub(super) fn filters(gpu: &Gpu, of: TexelFormat) -> bool {
    let flags = format(of).guaranteed_format_features(gpu.features).flags;
    flags.contains(wgpu::TextureFormatFeatureFlags::FILTERABLE)
}

/// Unsigned normalised: its values are multiples of 1/255.
pub(super) fn is_unorm(of: TexelFormat) -> bool {
    matches!(of, TexelFormat::R8Unorm | TexelFormat::Rgba8Unorm)
}

/// Fails unless all values are the expected one, but for rounding.
pub(super) fn all_are(
    mut values: impl Iterator<Item = f64>,
    expected: f64,
    tolerance: f64,
) -> Result<(), String> {
    let near = |value: f64| (value - expected).abs() <= tolerance * expected.abs();
    values.find(|value| !near(*value)).map_or(Ok(()), |value| {
        Err(format!("the adapter's result is {value}, the CPU's {expected}: its work is not done"))
    })
}
