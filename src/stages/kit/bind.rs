//! Bind groups, and the layouts that follow from what they hold.

use std::rc::Rc;

use super::{Buffer, layer_view, view};
use fathom_gpu::{Gpu, GroupKey, StructLayout};

/// One entry of a bind group; its binding number is its place in the list.
pub enum Bind<'a> {
    Uniform(&'a Buffer),
    /// Read-only storage.
    Read(&'a Buffer),
    /// Storage that a compute or fragment shader writes.
    Write(&'a Buffer),
    /// Float texture read texel by texel.
    Texels(&'a wgpu::Texture),
    /// Float texture read through a filtering sampler.
    Filtered(&'a wgpu::Texture),
    Depth(&'a wgpu::Texture),
    /// All layers of a texture of floats or unsigned integers, read texel by texel.
    Layers(&'a wgpu::Texture),
    /// All layers of a texture that a compute shader writes.
    StoreLayers(&'a wgpu::Texture),
    /// One layer of such a texture.
    Layer(&'a wgpu::Texture, u32),
    /// Texture that a compute shader writes.
    Store(&'a wgpu::Texture),
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
    /// What the layout was made from.
    pub(super) key: GroupKey,
    /// Structs of the host in it, by binding.
    pub(super) structs: Vec<(u32, Rc<StructLayout>)>,
}

impl Group {
    pub fn new(gpu: &Gpu, label: &str, binds: &[Bind<'_>]) -> Self {
        let layout_entries: GroupKey = (0..).zip(binds).map(|(i, b)| b.layout_entry(i)).collect();
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
        let structs = (0..).zip(binds).filter_map(|(i, bind)| Some((i, bind.layout()?))).collect();
        Self { layout, group, key: layout_entries, structs }
    }
}

impl Bind<'_> {
    fn layout(&self) -> Option<Rc<StructLayout>> {
        match self {
            Bind::Uniform(buffer) | Bind::Read(buffer) | Bind::Write(buffer) => {
                buffer.layout.clone()
            }
            _ => None,
        }
    }

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
            Bind::Texels(_) | Bind::Layer(..) => {
                texture(wgpu::TextureSampleType::Float { filterable: false })
            }
            Bind::Filtered(_) => texture(wgpu::TextureSampleType::Float { filterable: true }),
            Bind::Depth(_) => texture(wgpu::TextureSampleType::Depth),
            Bind::Layers(layers) => {
                let float = wgpu::TextureSampleType::Float { filterable: false };
                let of_format = layers.format().sample_type(None, None);
                let unsigned = of_format.filter(|of| *of == wgpu::TextureSampleType::Uint);
                texture_of(wgpu::TextureViewDimension::D2Array, unsigned.unwrap_or(float))
            }
            Bind::Volume(_) => texture_of(
                wgpu::TextureViewDimension::D3,
                wgpu::TextureSampleType::Float { filterable: true },
            ),
            Bind::Store(texture) => wgpu::BindingType::StorageTexture {
                access: wgpu::StorageTextureAccess::WriteOnly,
                format: texture.format(),
                view_dimension: wgpu::TextureViewDimension::D2,
            },
            Bind::StoreLayers(texture) => wgpu::BindingType::StorageTexture {
                access: wgpu::StorageTextureAccess::WriteOnly,
                format: texture.format(),
                view_dimension: wgpu::TextureViewDimension::D2Array,
            },
            Bind::Sampler(_) => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            Bind::NearestSampler(_) => {
                wgpu::BindingType::Sampler(wgpu::SamplerBindingType::NonFiltering)
            }
        };
        let visibility = match self {
            Bind::Write(_) => wgpu::ShaderStages::FRAGMENT | wgpu::ShaderStages::COMPUTE,
            Bind::Store(_) | Bind::StoreLayers(_) => wgpu::ShaderStages::COMPUTE,
            _ => wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE,
        };
        wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
    }

    fn texture_view(&self) -> Option<wgpu::TextureView> {
        match self {
            Bind::Texels(t)
            | Bind::Filtered(t)
            | Bind::Depth(t)
            | Bind::Store(t)
            | Bind::Volume(t) => Some(view(t)),
            Bind::Layers(t) | Bind::StoreLayers(t) => {
                Some(t.create_view(&wgpu::TextureViewDescriptor {
                    dimension: Some(wgpu::TextureViewDimension::D2Array),
                    ..Default::default()
                }))
            }
            Bind::Layer(t, layer) => Some(layer_view(t, *layer)),
            _ => None,
        }
    }

    fn resource<'r>(&'r self, view: Option<&'r wgpu::TextureView>) -> wgpu::BindingResource<'r> {
        match (self, view) {
            (_, Some(view)) => wgpu::BindingResource::TextureView(view),
            (Bind::Uniform(b) | Bind::Read(b) | Bind::Write(b), None) => b.as_entire_binding(),
            (Bind::Sampler(s) | Bind::NearestSampler(s), None) => wgpu::BindingResource::Sampler(s),
            (
                Bind::Texels(_)
                | Bind::Filtered(_)
                | Bind::Depth(_)
                | Bind::Store(_)
                | Bind::Layers(_)
                | Bind::StoreLayers(_)
                | Bind::Layer(..)
                | Bind::Volume(_),
                None,
            ) => {
                unreachable!("textures have views")
            }
        }
    }
}
