//! Arithmetic: multiply-adds in registers, of the invocations of a compute pass and of fragments.

use super::invocations::{Answer, Code, Invocations, floats, invocations, uniform, write_turns};
use super::kernel::{Kernel, all_are};
use super::raster;
use crate::readback::read_texture;
use crate::shader::compilation_options;
use crate::{ColorTarget, StageScope, Targets};
use crate::{Gpu, GpuError, MOST_LOOP_TURNS};

/// Shader of both.
const PATH: &str = "ceilings/arithmetic";
/// Multiply-adds of an invocation or a fragment in a turn.
const CHAINED: u32 = 64;
/// The sum of what the chains start with.
const CHAIN_START: f64 = 4.0;
/// Sums of whole numbers are exact in 32-bit floats below 2²⁴, that is for 131,072 turns. An adapter may make fewer.
const MOST_TURNS: u32 = MOST_LOOP_TURNS as u32;

/// The result of an invocation or a fragment.
fn expected(turns: u32) -> f64 {
    CHAIN_START + f64::from(CHAINED) * f64::from(turns)
}

/// Multiply-adds of a compute pass.
pub(super) fn compute(gpu: &Gpu) -> Result<Invocations, GpuError> {
    let code = Code { path: PATH, entry: "compute", defs: &[], reads: vec![], within: 0 };
    let per_turn = f64::from(invocations(gpu)) * f64::from(CHAINED);
    let answer: Answer = Box::new(|turns, results| all_are(floats(&results), expected(turns), 0.0));
    Invocations::new(gpu, code, per_turn, MOST_TURNS, answer)
}

/// Multiply-adds in the registers of fragments.
pub(super) struct Fragments {
    pipeline: wgpu::RenderPipeline,
    bindings: wgpu::BindGroup,
    uniform: wgpu::Buffer,
    target: wgpu::Texture,
    view: wgpu::TextureView,
}

impl Fragments {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shader = gpu.shader(PATH, &[])?;
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("ceiling"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &shader.module,
                entry_point: Some("vertex"),
                compilation_options: compilation_options(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader.module,
                entry_point: Some("fragment"),
                compilation_options: compilation_options(),
                targets: &[Some(wgpu::TextureFormat::R32Float.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let uniform = uniform(gpu);
        let bindings = gpu.bind("ceiling", &pipeline.get_bind_group_layout(0), &[&uniform]);
        // As many fragments as the compute kernel has invocations.
        let edge = invocations(gpu).isqrt();
        let target = raster::target(gpu, wgpu::TextureFormat::R32Float, [edge; 2]);
        let view = target.create_view(&Default::default());
        Ok(Self { pipeline, bindings, uniform, target, view })
    }
}

impl Kernel for Fragments {
    fn work_per_turn(&self) -> f64 {
        f64::from(self.target.width()) * f64::from(self.target.height()) * f64::from(CHAINED)
    }

    fn most_turns(&self) -> u32 {
        MOST_TURNS
    }

    fn prepare(&self, gpu: &Gpu, turns: u32) {
        write_turns(gpu, &self.uniform, turns);
    }

    fn encode(&self, scope: &mut StageScope<'_>, _turns: u32) {
        let clear = Some(wgpu::Color::TRANSPARENT);
        let color = [ColorTarget { view: &self.view, clear, slice: None }];
        scope.render(&Targets { color: &color, depth: None }, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.bindings, &[]);
            pass.draw(0..3, 0..1);
        });
    }

    fn compare(&self, gpu: &Gpu, turns: u32) -> Result<Result<(), String>, GpuError> {
        let texels = read_texture(gpu, &self.target)?.data;
        Ok(all_are(texels.into_iter().map(f64::from), expected(turns), 0.0))
    }
}
