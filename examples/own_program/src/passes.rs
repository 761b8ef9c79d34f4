//! The program's pipelines and resources. It knows nothing of a clock.

/// Pixels along an edge of the picture; `EDGE` in `passes.wgsl`.
const EDGE: u32 = 256;
/// Invocations along an edge of a workgroup.
const GROUP: u32 = 8;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

pub struct Passes {
    ripple: (wgpu::ComputePipeline, wgpu::BindGroup),
    blur: (wgpu::ComputePipeline, wgpu::BindGroup),
    shade: (wgpu::RenderPipeline, wgpu::BindGroup),
    pub picture: wgpu::TextureView,
}

impl Passes {
    /// The blur reads so many neighbours of a pixel.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue, taps: u32) -> Self {
        let module = device.create_shader_module(wgpu::include_wgsl!("passes.wgsl"));
        let settings = buffer(device, 16, wgpu::BufferUsages::UNIFORM);
        queue.write_buffer(&settings, 0, bytemuck::bytes_of(&taps));
        let bytes = u64::from(EDGE * EDGE) * 4;
        let [heights, blurred] =
            [(); 2].map(|()| buffer(device, bytes, wgpu::BufferUsages::STORAGE));
        let ripple = compute(device, &module, "ripple");
        let blur = compute(device, &module, "blur");
        let shade = render(device, &module);
        let of_ripple = bind(device, &ripple.get_bind_group_layout(0), &[(1, &heights)]);
        let blurs = [(0, &settings), (1, &heights), (2, &blurred)];
        let of_blur = bind(device, &blur.get_bind_group_layout(0), &blurs);
        let of_shade = bind(device, &shade.get_bind_group_layout(0), &[(3, &blurred)]);
        Self {
            ripple: (ripple, of_ripple),
            blur: (blur, of_blur),
            shade: (shade, of_shade),
            picture: picture(device),
        }
    }

    pub fn ripple(&self, pass: &mut wgpu::ComputePass<'_>) {
        dispatch(pass, &self.ripple);
    }

    pub fn blur(&self, pass: &mut wgpu::ComputePass<'_>) {
        dispatch(pass, &self.blur);
    }

    pub fn shade(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(&self.shade.0);
        pass.set_bind_group(0, &self.shade.1, &[]);
        pass.draw(0..3, 0..1);
    }

    /// The picture as the target of a render pass.
    pub fn target(&self) -> wgpu::RenderPassColorAttachment<'_> {
        wgpu::RenderPassColorAttachment {
            view: &self.picture,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                store: wgpu::StoreOp::Store,
            },
        }
    }
}

fn dispatch(
    pass: &mut wgpu::ComputePass<'_>,
    (pipeline, bindings): &(wgpu::ComputePipeline, wgpu::BindGroup),
) {
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, bindings, &[]);
    pass.dispatch_workgroups(EDGE / GROUP, EDGE / GROUP, 1);
}

fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn picture(device: &wgpu::Device) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: EDGE, height: EDGE, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    texture.create_view(&Default::default())
}

fn compute(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    entry_point: &str,
) -> wgpu::ComputePipeline {
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module,
        entry_point: Some(entry_point),
        compilation_options: Default::default(),
        cache: None,
    })
}

fn render(device: &wgpu::Device, module: &wgpu::ShaderModule) -> wgpu::RenderPipeline {
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("corner"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("shade"),
            compilation_options: Default::default(),
            targets: &[Some(FORMAT.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn bind(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    buffers: &[(u32, &wgpu::Buffer)],
) -> wgpu::BindGroup {
    let entries = buffers.iter().map(|(binding, buffer)| wgpu::BindGroupEntry {
        binding: *binding,
        resource: buffer.as_entire_binding(),
    });
    let entries: Vec<_> = entries.collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}
