//! Bind groups. What kind each binding is follows from the shader.

use super::Buffer;
use crate::pipelines::GroupKey;
use crate::{Binding, BindingKind, GpuError, Shader};

/// What a shader can bind.
pub trait Bind {
    fn resource(&self) -> Resource;
}

#[derive(Clone)]
pub enum Resource {
    Buffer(Buffer),
    /// All layers and levels of it, or one layer.
    Texture(wgpu::Texture, Option<u32>),
    Sampler(wgpu::Sampler, wgpu::SamplerBindingType),
}

impl Bind for Buffer {
    fn resource(&self) -> Resource {
        Resource::Buffer(self.clone())
    }
}

impl Bind for wgpu::Texture {
    fn resource(&self) -> Resource {
        Resource::Texture(self.clone(), None)
    }
}

impl Bind for wgpu::Sampler {
    fn resource(&self) -> Resource {
        Resource::Sampler(self.clone(), wgpu::SamplerBindingType::Filtering)
    }
}

/// A sampler that does not filter. WebGPU lets no other one read textures of depth.
pub struct Nearest(pub wgpu::Sampler);

impl Bind for Nearest {
    fn resource(&self) -> Resource {
        Resource::Sampler(self.0.clone(), wgpu::SamplerBindingType::NonFiltering)
    }
}

/// One layer of a texture.
pub struct Layer<'a>(pub &'a wgpu::Texture, pub u32);

impl Bind for Layer<'_> {
    fn resource(&self) -> Resource {
        Resource::Texture(self.0.clone(), Some(self.1))
    }
}

/// What a bind group holds; the binding number is the place in the list. A shader may leave out some of it.
#[derive(Clone)]
pub struct Bindings(Vec<Resource>);

impl Bindings {
    pub fn new(binds: &[&dyn Bind]) -> Self {
        Self(binds.iter().map(|bind| bind.resource()).collect())
    }

    /// With more, if there are any.
    #[must_use]
    pub fn and<'a, B: Bind + ?Sized + 'a>(mut self, more: impl IntoIterator<Item = &'a B>) -> Self {
        self.0.extend(more.into_iter().map(Bind::resource));
        self
    }

    /// How many storage buffers it holds.
    pub(super) fn storage_buffers(&self) -> u64 {
        let is_storage = |resource: &&Resource| match resource {
            Resource::Buffer(buffer) => buffer.usage().contains(wgpu::BufferUsages::STORAGE),
            Resource::Texture(..) | Resource::Sampler(..) => false,
        };
        self.0.iter().filter(is_storage).count() as u64
    }

    /// The group as a shader's entry points of these stages bind it under this number, with its layout and what that was made from.
    ///
    /// # Errors
    /// A resource of another kind than the shader's, and another struct.
    pub(super) fn bound(
        &self,
        device: &wgpu::Device,
        shader: &Shader,
        stages: wgpu::ShaderStages,
        number: u32,
    ) -> Result<BoundGroup, GpuError> {
        let label = Some(shader.path.as_str());
        let is_used = |of: &&Binding| of.group == number && of.stages.intersects(stages);
        let of_group = shader.bindings.iter().filter(is_used);
        let given =
            |binding: &Binding| Some((binding.clone(), self.0.get(binding.binding as usize)?));
        let bound: Vec<(Binding, &Resource)> = of_group.filter_map(given).collect();
        let mut entries = Vec::new();
        for (binding, resource) in &bound {
            entries.push(resource.layout_entry(shader, (binding, stages), device.features())?);
        }
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label,
            entries: &entries,
        });
        let views: Vec<_> = bound.iter().map(|(of, resource)| resource.view(of.kind)).collect();
        let mut held = Vec::new();
        for ((of, resource), view) in bound.iter().zip(&views) {
            let resource = resource.bound(view.as_ref());
            held.push(wgpu::BindGroupEntry { binding: of.binding, resource });
        }
        let descriptor = wgpu::BindGroupDescriptor { label, layout: &layout, entries: &held };
        Ok(BoundGroup { group: device.create_bind_group(&descriptor), layout, key: entries })
    }
}

pub(super) struct BoundGroup {
    pub group: wgpu::BindGroup,
    pub layout: wgpu::BindGroupLayout,
    pub key: GroupKey,
}

impl Resource {
    fn layout_entry(
        &self,
        shader: &Shader,
        (binding, stages): (&Binding, wgpu::ShaderStages),
        features: wgpu::Features,
    ) -> Result<wgpu::BindGroupLayoutEntry, GpuError> {
        let ty = match (binding.kind, self) {
            (BindingKind::Buffer(ty), Self::Buffer(buffer)) if buffer.may_be(binding) => {
                let (has_dynamic_offset, min_binding_size) = (false, None);
                wgpu::BindingType::Buffer { ty, has_dynamic_offset, min_binding_size }
            }
            (BindingKind::Texture(view_dimension, sampled), Self::Texture(texture, _)) => {
                let of_format = texture.format().sample_type(None, Some(features));
                let float = matches!(sampled, wgpu::TextureSampleType::Float { .. });
                let filterable =
                    of_format == Some(wgpu::TextureSampleType::Float { filterable: true });
                let sample_type =
                    if float { wgpu::TextureSampleType::Float { filterable } } else { sampled };
                let multisampled = false;
                wgpu::BindingType::Texture { sample_type, view_dimension, multisampled }
            }
            (BindingKind::Stored(view_dimension), Self::Texture(texture, _)) => {
                let (access, format) = (wgpu::StorageTextureAccess::WriteOnly, texture.format());
                wgpu::BindingType::StorageTexture { access, format, view_dimension }
            }
            (BindingKind::Sampler { comparison: true }, Self::Sampler(..)) => {
                wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison)
            }
            (BindingKind::Sampler { comparison: false }, Self::Sampler(_, of)) => {
                wgpu::BindingType::Sampler(*of)
            }
            _ => {
                let Binding { group, binding, kind, structure, .. } = binding;
                let of = structure.as_deref().map_or(String::new(), |name| format!(" of {name}"));
                let message =
                    format!("what is bound at group {group}, binding {binding} is no {kind:?}{of}");
                return Err(GpuError::Shader { path: shader.path.clone(), message });
            }
        };
        let visibility = binding.stages & stages;
        Ok(wgpu::BindGroupLayoutEntry { binding: binding.binding, visibility, ty, count: None })
    }

    fn view(&self, kind: BindingKind) -> Option<wgpu::TextureView> {
        let (Self::Texture(texture, layer), BindingKind::Texture(of, _) | BindingKind::Stored(of)) =
            (self, kind)
        else {
            return None;
        };
        Some(texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(of),
            base_array_layer: layer.unwrap_or(0),
            array_layer_count: layer.map(|_| 1),
            ..Default::default()
        }))
    }

    fn bound<'r>(&'r self, view: Option<&'r wgpu::TextureView>) -> wgpu::BindingResource<'r> {
        match self {
            Self::Buffer(buffer) => buffer.as_entire_binding(),
            Self::Sampler(sampler, _) => wgpu::BindingResource::Sampler(sampler),
            Self::Texture(..) => {
                wgpu::BindingResource::TextureView(view.expect("textures have views"))
            }
        }
    }
}
