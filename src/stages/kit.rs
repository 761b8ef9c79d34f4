//! What stages are built with: counted allocations, bind groups, pipelines.

use std::cell::Cell;

use encase::{ShaderType, UniformBuffer, internal::WriteInto};
use wgpu::util::DeviceExt;

use crate::gpu::{Gpu, compilation_options, texture_bytes};

/// Allocates GPU memory for one pipeline and counts it.
pub struct Resources<'g> {
    pub gpu: &'g Gpu,
    bytes: Cell<u64>,
}

impl<'g> Resources<'g> {
    pub fn new(gpu: &'g Gpu) -> Self {
        Self { gpu, bytes: Cell::new(0) }
    }

    pub fn allocated_bytes(&self) -> u64 {
        self.bytes.get()
    }

    fn count(&self, bytes: u64) {
        self.bytes.set(self.bytes.get() + bytes);
    }

    /// A texture that passes draw into, shaders read, and the host can read back.
    pub fn target(
        &self,
        label: &str,
        size: [u32; 2],
        format: wgpu::TextureFormat,
    ) -> wgpu::Texture {
        let block = format.block_copy_size(None).unwrap_or(4);
        self.count(u64::from(size[0]) * u64::from(size[1]) * u64::from(block));
        self.gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: extent(size),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }

    /// A texture of four 32-bit floats per texel with fixed content.
    pub fn float_texture(&self, label: &str, size: [u32; 2], texels: &[f32]) -> wgpu::Texture {
        self.fixed_texture(label, size, wgpu::TextureFormat::Rgba32Float, texels)
    }

    /// A texture of one 32-bit float per texel with fixed content.
    pub fn grey_texture(&self, label: &str, size: [u32; 2], texels: &[f32]) -> wgpu::Texture {
        self.fixed_texture(label, size, wgpu::TextureFormat::R32Float, texels)
    }

    fn fixed_texture(
        &self,
        label: &str,
        size: [u32; 2],
        format: wgpu::TextureFormat,
        texels: &[f32],
    ) -> wgpu::Texture {
        self.count(size_of_val(texels) as u64);
        self.gpu.device.create_texture_with_data(
            &self.gpu.queue,
            &wgpu::TextureDescriptor {
                label: Some(label),
                size: extent(size),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
            wgpu::util::TextureDataOrder::LayerMajor,
            bytemuck::cast_slice(texels),
        )
    }

    /// A volume of texels that shaders sample, slices of which passes can draw into, and that can be filled by copying
    /// and read back.
    pub fn volume(
        &self,
        label: &str,
        cells: [u32; 3],
        format: wgpu::TextureFormat,
        levels: u32,
    ) -> wgpu::Texture {
        let texture = self.gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width: cells[0],
                height: cells[1],
                depth_or_array_layers: cells[2],
            },
            mip_level_count: levels,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_DST
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        self.count(texture_bytes(&texture));
        texture
    }

    pub fn uniform<T: ShaderType + WriteInto>(&self, label: &str, value: &T) -> wgpu::Buffer {
        self.filled(label, &host_bytes(value), wgpu::BufferUsages::UNIFORM)
    }

    /// Settings that end a fragment shader's loops: a read-only storage buffer. Where a uniform ends a loop, lavapipe (Mesa
    /// 22.3) puts its value into the shader and compiles that anew for every draw; the filter of caustics took 5.0 ms with
    /// 12 taps and 0.7 with 24; with the taps in here, 12 take 0.7.
    pub fn loop_settings<T: ShaderType + WriteInto>(&self, label: &str, value: &T) -> wgpu::Buffer {
        self.filled(label, &host_bytes(value), wgpu::BufferUsages::STORAGE)
    }

    /// A buffer with content; it can be rewritten.
    pub fn filled(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        self.count(bytes.len() as u64);
        self.gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some(label),
            contents: bytes,
            usage: usage | wgpu::BufferUsages::COPY_DST,
        })
    }

    /// A storage buffer that shaders fill, the host can read back, and tests can fill.
    pub fn storage(&self, label: &str, bytes: u64) -> wgpu::Buffer {
        self.count(bytes);
        self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }
}

/// Bytes of a host value in WGSL's uniform layout, which storage buffers take as well.
pub fn host_bytes<T: ShaderType + WriteInto>(value: &T) -> Vec<u8> {
    let mut buffer = UniformBuffer::new(Vec::new());
    buffer.write(value).expect("a Vec grows to whatever a shader type needs");
    buffer.into_inner()
}

fn extent(size: [u32; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 }
}

pub fn view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// One entry of a bind group; its binding number is its place in the list.
pub enum Bind<'a> {
    Uniform(&'a wgpu::Buffer),
    /// Read-only storage.
    Read(&'a wgpu::Buffer),
    /// Storage that a compute or fragment shader writes.
    Write(&'a wgpu::Buffer),
    /// Float texture read texel by texel.
    Texels(&'a wgpu::Texture),
    /// Float texture read through a filtering sampler.
    Filtered(&'a wgpu::Texture),
    Depth(&'a wgpu::Texture),
    /// Volume of floats, all its levels, read through a filtering sampler.
    Volume(&'a wgpu::Texture),
    Sampler(&'a wgpu::Sampler),
    /// A sampler that does not filter, for gathers.
    NearestSampler(&'a wgpu::Sampler),
}

/// A bind group and its layout.
pub struct Group {
    pub layout: wgpu::BindGroupLayout,
    pub group: wgpu::BindGroup,
}

impl Group {
    pub fn new(gpu: &Gpu, label: &str, binds: &[Bind<'_>]) -> Self {
        let layout_entries: Vec<_> = (0..).zip(binds).map(|(i, b)| b.layout_entry(i)).collect();
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &layout_entries,
        });
        let views: Vec<_> = binds.iter().map(Bind::texture_view).collect();
        let entries: Vec<_> = binds
            .iter()
            .zip(&views)
            .enumerate()
            .map(|(i, (bind, view))| wgpu::BindGroupEntry {
                binding: i as u32,
                resource: bind.resource(view.as_ref()),
            })
            .collect();
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(label),
            layout: &layout,
            entries: &entries,
        });
        Self { layout, group }
    }
}

impl Bind<'_> {
    fn layout_entry(&self, binding: u32) -> wgpu::BindGroupLayoutEntry {
        let buffer = |ty| wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let texture_of = |view_dimension, sample_type| wgpu::BindingType::Texture {
            sample_type,
            view_dimension,
            multisampled: false,
        };
        let texture = |sample_type| texture_of(wgpu::TextureViewDimension::D2, sample_type);
        let ty = match self {
            Bind::Uniform(_) => buffer(wgpu::BufferBindingType::Uniform),
            Bind::Read(_) => buffer(wgpu::BufferBindingType::Storage { read_only: true }),
            Bind::Write(_) => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
            Bind::Texels(_) => texture(wgpu::TextureSampleType::Float { filterable: false }),
            Bind::Filtered(_) => texture(wgpu::TextureSampleType::Float { filterable: true }),
            Bind::Depth(_) => texture(wgpu::TextureSampleType::Depth),
            Bind::Volume(_) => texture_of(
                wgpu::TextureViewDimension::D3,
                wgpu::TextureSampleType::Float { filterable: true },
            ),
            Bind::Sampler(_) => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            Bind::NearestSampler(_) => {
                wgpu::BindingType::Sampler(wgpu::SamplerBindingType::NonFiltering)
            }
        };
        let visibility = match self {
            Bind::Write(_) => wgpu::ShaderStages::FRAGMENT | wgpu::ShaderStages::COMPUTE,
            _ => wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE,
        };
        wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
    }

    fn texture_view(&self) -> Option<wgpu::TextureView> {
        match self {
            Bind::Texels(t) | Bind::Filtered(t) | Bind::Depth(t) | Bind::Volume(t) => Some(view(t)),
            _ => None,
        }
    }

    fn resource<'r>(&'r self, view: Option<&'r wgpu::TextureView>) -> wgpu::BindingResource<'r> {
        match (self, view) {
            (_, Some(view)) => wgpu::BindingResource::TextureView(view),
            (Bind::Uniform(b) | Bind::Read(b) | Bind::Write(b), None) => b.as_entire_binding(),
            (Bind::Sampler(s) | Bind::NearestSampler(s), None) => wgpu::BindingResource::Sampler(s),
            (Bind::Texels(_) | Bind::Filtered(_) | Bind::Depth(_) | Bind::Volume(_), None) => {
                unreachable!("textures have views")
            }
        }
    }
}

fn layout(gpu: &Gpu, label: &str, groups: &[&Group]) -> wgpu::PipelineLayout {
    let layouts: Vec<_> = groups.iter().map(|g| Some(&g.layout)).collect();
    gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: &layouts,
        immediate_size: 0,
    })
}

/// A compute pipeline with entry point `main`.
pub fn compute_pipeline(
    gpu: &Gpu,
    label: &str,
    shader: &wgpu::ShaderModule,
    groups: &[&Group],
) -> wgpu::ComputePipeline {
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(label),
        layout: Some(&layout(gpu, label, groups)),
        module: shader,
        entry_point: Some("main"),
        compilation_options: compilation_options(),
        cache: None,
    })
}

/// Invocations of a workgroup of a linear dispatch, as in `shaders/shared/dispatch.wgsl`.
const LINEAR_GROUP: u64 = 64;
/// Workgroups along x before a linear dispatch takes a second row: within every adapter's limit of 65,535.
const LINEAR_GROUPS_X: u64 = 32_768;

/// Workgroups for so many invocations, spread over two dimensions.
pub fn linear_workgroups(invocations: u64) -> [u32; 3] {
    let groups = invocations.div_ceil(LINEAR_GROUP);
    let rows = groups.div_ceil(LINEAR_GROUPS_X).max(1);
    [groups.min(LINEAR_GROUPS_X) as u32, rows as u32, 1]
}

/// What distinguishes one render pipeline from another. Triangles, no culling.
pub struct RenderSpec<'a> {
    pub label: &'a str,
    pub shader: &'a wgpu::ShaderModule,
    pub vertex: &'a str,
    pub fragment: Option<&'a str>,
    pub groups: &'a [&'a Group],
    pub buffers: &'a [wgpu::VertexBufferLayout<'a>],
    pub targets: &'a [wgpu::ColorTargetState],
    pub depth: Option<wgpu::DepthStencilState>,
}

pub fn render_pipeline(gpu: &Gpu, spec: &RenderSpec<'_>) -> wgpu::RenderPipeline {
    let targets: Vec<_> = spec.targets.iter().cloned().map(Some).collect();
    let buffers: Vec<_> = spec.buffers.iter().cloned().map(Some).collect();
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(spec.label),
        layout: Some(&layout(gpu, spec.label, spec.groups)),
        vertex: wgpu::VertexState {
            module: spec.shader,
            entry_point: Some(spec.vertex),
            compilation_options: compilation_options(),
            buffers: &buffers,
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: spec.depth.clone(),
        multisample: wgpu::MultisampleState::default(),
        fragment: spec.fragment.map(|entry| wgpu::FragmentState {
            module: spec.shader,
            entry_point: Some(entry),
            compilation_options: compilation_options(),
            targets: &targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}

pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

pub fn depth_state(compare: wgpu::CompareFunction, write: bool) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH_FORMAT,
        depth_write_enabled: Some(write),
        depth_compare: Some(compare),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

/// A colour target written as it is.
pub fn opaque(format: wgpu::TextureFormat) -> wgpu::ColorTargetState {
    wgpu::ColorTargetState { format, blend: None, write_mask: wgpu::ColorWrites::ALL }
}

/// A colour target that adds up what is drawn.
pub fn additive(format: wgpu::TextureFormat) -> wgpu::ColorTargetState {
    let add = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    wgpu::ColorTargetState {
        blend: Some(wgpu::BlendState { color: add, alpha: add }),
        ..opaque(format)
    }
}

/// A colour target that what is drawn multiplies.
pub fn multiplicative(format: wgpu::TextureFormat) -> wgpu::ColorTargetState {
    let multiply = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::Zero,
        dst_factor: wgpu::BlendFactor::Src,
        operation: wgpu::BlendOperation::Add,
    };
    wgpu::ColorTargetState {
        blend: Some(wgpu::BlendState {
            color: multiply,
            alpha: wgpu::BlendComponent { dst_factor: wgpu::BlendFactor::SrcAlpha, ..multiply },
        }),
        ..opaque(format)
    }
}

/// Format of targets that sum thousands of small contributions: 32-bit where the adapter blends it.
pub fn accumulation_format(gpu: &Gpu) -> wgpu::TextureFormat {
    if gpu.features.contains(wgpu::Features::FLOAT32_BLENDABLE) {
        wgpu::TextureFormat::R32Float
    } else {
        wgpu::TextureFormat::R16Float
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_dispatches_reach_all_within_the_limits() {
        for invocations in [0, 1, 64, 65, 1 << 21, (1 << 21) + 1, 1 << 28] {
            let [x, y, _] = linear_workgroups(invocations).map(u64::from);
            assert!(x * y * LINEAR_GROUP >= invocations && x <= 65_535 && y <= 65_535);
        }
    }
}
