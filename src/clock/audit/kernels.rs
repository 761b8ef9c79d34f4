//! The kernels of the audit: a pass of each kind whose work is known.

use crate::frame::{ColorTarget, StageScope, Targets};
use crate::{Device, DeviceError, TimedStage};
use fathom_record::PassKind;
use fathom_record::ceilings::Drawing;

/// Edge of the render kernel's target in pixels, and invocations of the compute kernel.
const TARGET_EDGE: u32 = 256;
const INVOCATIONS: u32 = 65_536;
pub(crate) const GROUP_SIZE: u32 = 64;
/// Quads along an edge of the target. The shader's vertex work per iteration of fragment work, `VERTEX_SHARE`, makes about as much
/// in either, with 8×8 fragments to 6 vertices.
const QUADS_PER_EDGE: u32 = 32;
/// Bytes of a copy per unit of work, and at most, on a software adapter and on a GPU.
const COPY_UNIT_BYTES: u64 = 64 << 10;
const SOFTWARE_COPY_BYTES: u64 = 64 << 20;
const GPU_COPY_BYTES: u64 = 256 << 20;

/// Pipelines and resources of the kernels.
pub(super) struct Kernels {
    compute: wgpu::ComputePipeline,
    render: wgpu::RenderPipeline,
    results: wgpu::Buffer,
    target: wgpu::TextureView,
    copied: [wgpu::Buffer; 2],
}

impl Kernels {
    pub(super) fn new(gpu: &Device) -> Result<Self, DeviceError> {
        use wgpu::BufferUsages as Usage;
        let copy_bytes = if gpu.adapter.software { SOFTWARE_COPY_BYTES } else { GPU_COPY_BYTES };
        let copy_bytes = copy_bytes.min(gpu.limits.max_buffer_size);
        gpu.catch(|| {
            let module = module(gpu);
            Ok(Self {
                compute: compute_pipeline(gpu, &module),
                render: render_pipeline(gpu, &module),
                results: gpu.buffer("audit", u64::from(INVOCATIONS) * 4, Usage::STORAGE),
                target: target(gpu, TARGET_EDGE),
                copied: [Usage::COPY_SRC, Usage::COPY_DST]
                    .map(|usage| gpu.buffer("audit", copy_bytes, usage)),
            })
        })
    }

    /// A kernel of this kind with so much work per call.
    pub(super) fn kernel(&self, gpu: &Device, kind: PassKind, work: u32, calls: u32) -> Kernel<'_> {
        let layout = match kind {
            PassKind::Compute => Some(self.compute.get_bind_group_layout(0)),
            PassKind::Render => Some(self.render.get_bind_group_layout(0)),
            PassKind::Copy | PassKind::Host => None,
        };
        let bindings = layout.map(|layout| {
            use wgpu::BufferUsages as Usage;
            let uniform = gpu.buffer("audit", 16, Usage::UNIFORM | Usage::COPY_DST);
            gpu.queue.write_buffer(&uniform, 0, &work.to_le_bytes());
            let used = if kind == PassKind::Compute { 2 } else { 1 };
            gpu.bind("audit", &layout, &[&uniform, &self.results][..used])
        });
        Kernel { kernels: self, kind, bindings, work, calls }
    }
}

/// A picture of so many pixels along an edge.
pub(crate) fn target(gpu: &Device, edge: u32) -> wgpu::TextureView {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("audit"),
        size: wgpu::Extent3d { width: edge, height: edge, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// The kernels' shader.
pub(crate) fn module(gpu: &Device) -> wgpu::ShaderModule {
    let descriptor = wgpu::include_wgsl!("kernels.wgsl");
    if !gpu.unchecked {
        return gpu.device.create_shader_module(descriptor);
    }
    // SAFETY: the kernels index within their bindings, and their loops end.
    unsafe {
        let checks = wgpu::ShaderRuntimeChecks::unchecked();
        gpu.device.create_shader_module_trusted(descriptor, checks)
    }
}

pub(crate) fn compute_pipeline(gpu: &Device, module: &wgpu::ShaderModule) -> wgpu::ComputePipeline {
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("audit/compute"),
        layout: None,
        module,
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    })
}

fn render_pipeline(gpu: &Device, module: &wgpu::ShaderModule) -> wgpu::RenderPipeline {
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("audit/render"),
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[Some(wgpu::TextureFormat::Rgba8Unorm.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// One kind of pass with a set amount of work.
pub(super) struct Kernel<'a> {
    kernels: &'a Kernels,
    pub(super) kind: PassKind,
    bindings: Option<wgpu::BindGroup>,
    /// Loop iterations, or units of copying, per call.
    work: u32,
    calls: u32,
}

impl TimedStage for Kernel<'_> {
    fn name(&self) -> &'static str {
        match self.kind {
            PassKind::Compute => "audit/compute",
            PassKind::Render => "audit/render",
            PassKind::Copy => "audit/copy",
            PassKind::Host => "audit/host",
        }
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        match self.kind {
            PassKind::Compute => scope.compute(|pass| {
                pass.set_pipeline(&self.kernels.compute);
                pass.set_bind_group(0, &self.bindings, &[]);
                for _ in 0..self.calls {
                    pass.dispatch_workgroups(INVOCATIONS / GROUP_SIZE, 1, 1);
                }
            }),
            PassKind::Render => {
                let color = [ColorTarget {
                    view: &self.kernels.target,
                    clear: Some(wgpu::Color::BLACK),
                    slice: None,
                    drawing: Drawing::Opaque,
                }];
                scope.render(&Targets { color: &color, depth: None }, |pass| {
                    pass.set_pipeline(&self.kernels.render);
                    pass.set_bind_group(0, &self.bindings, &[]);
                    for _ in 0..self.calls {
                        pass.draw(0..6 * QUADS_PER_EDGE * QUADS_PER_EDGE, 0..1);
                    }
                });
            }
            PassKind::Copy => scope.copy(|encoder| {
                let [from, to] = &self.kernels.copied;
                let bytes = (u64::from(self.work) * COPY_UNIT_BYTES).min(from.size());
                for _ in 0..self.calls {
                    encoder.copy_buffer_to_buffer(from, 0, to, 0, bytes);
                }
            }),
            PassKind::Host => {}
        }
    }
}

#[test]
fn the_shader_has_the_constants_of_the_host() {
    let source = include_str!("kernels.wgsl");
    for (name, value) in [("GROUP_SIZE", GROUP_SIZE), ("QUADS_PER_EDGE", QUADS_PER_EDGE)] {
        assert!(source.contains(&format!("const {name} = {value}u;")), "{name}");
    }
}
