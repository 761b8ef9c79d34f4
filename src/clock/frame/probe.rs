//! The smallest pass of each kind. The host time of a submission that holds nothing else is the cost of a submission.

use super::host_clock::HostClock;
use super::targets::{ColorTarget, Targets, open};
use crate::audit::kernels::{GROUP_SIZE, compute_pipeline, module, target};
use crate::{Device, DeviceError};
use fathom_record::PassKind;
use fathom_record::ceilings::Drawing;

/// The smallest compute pass is one workgroup.
const RESULT_BYTES: u64 = GROUP_SIZE as u64 * 4;
/// Iterations of the smallest compute pass, in a uniform of this size.
const ITERATIONS: u32 = 1;
const UNIFORM_BYTES: u64 = 16;

/// Pipelines and resources of the smallest passes.
pub(crate) struct Probe {
    compute: wgpu::ComputePipeline,
    bindings: wgpu::BindGroup,
    target: wgpu::TextureView,
    copied: [wgpu::Buffer; 2],
}

impl Probe {
    pub(crate) fn new(gpu: &Device) -> Result<Self, DeviceError> {
        use wgpu::BufferUsages as Usage;
        gpu.catch(|| {
            let compute = compute_pipeline(gpu, &module(gpu));
            let iterations = gpu.buffer("probe", UNIFORM_BYTES, Usage::UNIFORM | Usage::COPY_DST);
            gpu.queue.write_buffer(&iterations, 0, &ITERATIONS.to_le_bytes());
            let results = gpu.buffer("probe", RESULT_BYTES, Usage::STORAGE);
            let layout = compute.get_bind_group_layout(0);
            let bindings = gpu.bind("least compute pass", &layout, &[&iterations, &results]);
            Ok(Self {
                compute,
                bindings,
                target: target(gpu, 1),
                copied: [Usage::COPY_SRC, Usage::COPY_DST]
                    .map(|usage| gpu.buffer("probe", wgpu::COPY_BUFFER_ALIGNMENT, usage)),
            })
        })
    }

    /// Time in ns, by this clock, from the submission to the fence of the smallest pass of this kind.
    pub(crate) fn time(
        &self,
        gpu: &Device,
        kind: PassKind,
        clock: HostClock,
    ) -> Result<f64, DeviceError> {
        let commands = self.encode(gpu, kind);
        let submit_ns = clock.now_ns();
        let index = gpu.queue.submit([commands]);
        gpu.wait_for(Some(index))?;
        Ok(clock.now_ns() - submit_ns)
    }

    fn encode(&self, gpu: &Device, kind: PassKind) -> wgpu::CommandBuffer {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        match kind {
            PassKind::Compute => {
                let mut pass = encoder.begin_compute_pass(&Default::default());
                pass.set_pipeline(&self.compute);
                pass.set_bind_group(0, &self.bindings, &[]);
                pass.dispatch_workgroups(1, 1, 1);
            }
            PassKind::Render => {
                let clear = Some(wgpu::Color::BLACK);
                let color = [ColorTarget {
                    view: &self.target,
                    clear,
                    slice: None,
                    drawing: Drawing::Opaque,
                }];
                drop(open(&mut encoder, "probe", &Targets { color: &color, depth: None }, None));
            }
            PassKind::Copy => {
                let [from, to] = &self.copied;
                encoder.copy_buffer_to_buffer(from, 0, to, 0, wgpu::COPY_BUFFER_ALIGNMENT);
            }
            PassKind::Host => {}
        }
        encoder.finish()
    }
}
