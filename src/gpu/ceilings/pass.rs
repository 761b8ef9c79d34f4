//! Passes that do next to nothing.

use super::kernel::{Kernel, Timing, clear};
use crate::readback::read_buffer;
use crate::shader::compilation_options;
use crate::{ColorTarget, StageScope, Targets};
use crate::{Gpu, GpuError};
use fathom_record::PassKind;

const WORD: u64 = wgpu::COPY_BUFFER_ALIGNMENT;

/// A pass a turn: one workgroup, a cleared pixel, or a copied word.
pub(super) struct EmptyPasses {
    kind: PassKind,
    pipeline: wgpu::ComputePipeline,
    bindings: wgpu::BindGroup,
    counted: wgpu::Buffer,
    target: wgpu::TextureView,
    copied: [wgpu::Buffer; 2],
}

impl EmptyPasses {
    pub(super) fn new(gpu: &Gpu, kind: PassKind) -> Result<Self, GpuError> {
        use wgpu::BufferUsages as Usage;
        let shader = gpu.shader("ceilings/pass", &[])?;
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("ceiling"),
            layout: None,
            module: &shader.module,
            entry_point: Some("main"),
            compilation_options: compilation_options(),
            cache: None,
        });
        let counted =
            gpu.buffer("ceiling", WORD, Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST);
        let bindings = gpu.bind("ceiling", &pipeline.get_bind_group_layout(0), &[&counted]);
        let usages = [Usage::COPY_SRC | Usage::COPY_DST, Usage::COPY_SRC | Usage::COPY_DST];
        let copied = usages.map(|usage| gpu.buffer("ceiling", WORD, usage));
        let target = super::raster::target(gpu, wgpu::TextureFormat::R32Float, [1, 1]);
        let target = target.create_view(&Default::default());
        Ok(Self { kind, pipeline, bindings, counted, target, copied })
    }
}

impl Kernel for EmptyPasses {
    fn work_per_turn(&self) -> f64 {
        1.0
    }

    fn timing(&self) -> Timing {
        Timing::Frame(self.kind)
    }

    fn encode(&self, scope: &mut StageScope<'_>, turns: u32) {
        let color =
            [ColorTarget { view: &self.target, clear: Some(wgpu::Color::WHITE), slice: None }];
        let targets = Targets { color: &color, depth: None };
        for _ in 0..turns {
            match self.kind {
                PassKind::Compute => scope.compute(|pass| {
                    pass.set_pipeline(&self.pipeline);
                    pass.set_bind_group(0, &self.bindings, &[]);
                    pass.dispatch_workgroups(1, 1, 1);
                }),
                PassKind::Render => scope.render(&targets, |_| {}),
                PassKind::Copy | PassKind::Host => scope.copy(|encoder| {
                    let [from, to] = &self.copied;
                    encoder.copy_buffer_to_buffer(from, 0, to, 0, WORD);
                }),
            }
        }
    }

    fn reset(&self, gpu: &Gpu) {
        clear(gpu, &self.counted);
    }

    /// Compute passes count themselves. A clear or a copy too few leaves no trace.
    fn compare(&self, gpu: &Gpu, turns: u32) -> Result<Result<(), String>, GpuError> {
        if self.kind != PassKind::Compute {
            return Ok(Ok(()));
        }
        let counted = super::invocations::words(&read_buffer(gpu, &self.counted)?).next();
        let wrong = || format!("of {turns} passes {} ran", counted.unwrap_or(0));
        Ok((counted == Some(turns)).then_some(()).ok_or_else(wrong))
    }
}
