//! What a linked shader binds, and of which kind.

use wgpu::naga;
use wgpu::naga::compact::{KeepUnused, compact};

/// What a shader binds at a place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Binding {
    pub group: u32,
    pub binding: u32,
    pub kind: BindingKind,
    /// Of the entry points that use it.
    pub stages: wgpu::ShaderStages,
    /// The struct that is bound, alone or as the element of an array.
    pub structure: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    Buffer(wgpu::BufferBindingType),
    /// Floats count as filterable: whether they are follows from the texture's format.
    Texture(wgpu::TextureViewDimension, wgpu::TextureSampleType),
    /// A texture that the shader writes.
    Stored(wgpu::TextureViewDimension),
    /// One that filters and one that does not look alike in a shader.
    Sampler {
        comparison: bool,
    },
}

impl Binding {
    /// Whether fragment shaders write it, where they are among these stages.
    pub fn is_written_by_fragments(&self, stages: wgpu::ShaderStages) -> bool {
        let written = wgpu::BufferBindingType::Storage { read_only: false };
        let is_written = matches!(self.kind, BindingKind::Stored(_))
            || self.kind == BindingKind::Buffer(written);
        is_written && (self.stages & stages).contains(wgpu::ShaderStages::FRAGMENT)
    }
}

/// What the entry points of a linked module bind. An imported module may hold what they do not use: that is removed.
pub(super) fn bindings(module: &mut naga::Module) -> Vec<Binding> {
    compact(module, KeepUnused::No);
    let used: Vec<_> = module.entry_points.iter().map(|entry| used_by(entry, module)).collect();
    let bound = |variable: &naga::GlobalVariable| {
        let place @ naga::ResourceBinding { group, binding } = variable.binding?;
        let users = used.iter().filter(|(_, places)| places.contains(&place));
        let stages = users.map(|(stage, _)| *stage).collect();
        let kind = kind(variable.space, &module.types[variable.ty].inner)?;
        let structure = structure(&module.types, variable.ty);
        Some(Binding { group, binding, kind, stages, structure })
    };
    module.global_variables.iter().filter_map(|(_, variable)| bound(variable)).collect()
}

/// What an entry point uses, itself or by the functions that it calls.
fn used_by(
    entry: &naga::EntryPoint,
    module: &naga::Module,
) -> (wgpu::ShaderStages, Vec<naga::ResourceBinding>) {
    let mut alone = naga::Module { entry_points: vec![entry.clone()], ..module.clone() };
    compact(&mut alone, KeepUnused::No);
    let stage = match entry.stage {
        naga::ShaderStage::Vertex => wgpu::ShaderStages::VERTEX,
        naga::ShaderStage::Fragment => wgpu::ShaderStages::FRAGMENT,
        _ => wgpu::ShaderStages::COMPUTE,
    };
    (stage, alone.global_variables.iter().filter_map(|(_, global)| global.binding).collect())
}

fn kind(space: naga::AddressSpace, ty: &naga::TypeInner) -> Option<BindingKind> {
    Some(match (space, ty) {
        (naga::AddressSpace::Uniform, _) => BindingKind::Buffer(wgpu::BufferBindingType::Uniform),
        (naga::AddressSpace::Storage { access }, _) => {
            let read_only = access == naga::StorageAccess::LOAD;
            BindingKind::Buffer(wgpu::BufferBindingType::Storage { read_only })
        }
        (_, naga::TypeInner::Sampler { comparison }) => {
            BindingKind::Sampler { comparison: *comparison }
        }
        (_, naga::TypeInner::Image { dim, arrayed, class }) => {
            let dimension = match dim {
                naga::ImageDimension::D3 => wgpu::TextureViewDimension::D3,
                _ if *arrayed => wgpu::TextureViewDimension::D2Array,
                _ => wgpu::TextureViewDimension::D2,
            };
            let sampled = match class {
                naga::ImageClass::Sampled { kind: naga::ScalarKind::Uint, .. } => {
                    wgpu::TextureSampleType::Uint
                }
                naga::ImageClass::Sampled { kind: naga::ScalarKind::Sint, .. } => {
                    wgpu::TextureSampleType::Sint
                }
                naga::ImageClass::Sampled { .. } => {
                    wgpu::TextureSampleType::Float { filterable: true }
                }
                naga::ImageClass::Depth { .. } => wgpu::TextureSampleType::Depth,
                _ => return Some(BindingKind::Stored(dimension)),
            };
            BindingKind::Texture(dimension, sampled)
        }
        _ => return None,
    })
}

/// The name of a struct, or of that which an array holds. naga_oil puts the module's path behind it.
fn structure(
    types: &naga::UniqueArena<naga::Type>,
    ty: naga::Handle<naga::Type>,
) -> Option<String> {
    let naga::Type { name, inner } = &types[ty];
    match inner {
        naga::TypeInner::Struct { .. } => {
            name.as_ref()?.split("X_naga_oil_mod_X").next().map(str::to_owned)
        }
        naga::TypeInner::Array { base, .. } => structure(types, *base),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHADER: &str = "
        struct Filter { taps: u32, size_px: vec2<f32> }
        @group(0) @binding(0) var<uniform> settings: Filter;
        @group(0) @binding(1) var<storage> values: array<f32>;
        @group(0) @binding(2) var<storage, read_write> sums: array<Filter>;
        @group(1) @binding(0) var depth: texture_depth_2d;
        @group(1) @binding(1) var layers: texture_2d_array<u32>;
        @group(1) @binding(2) var volume: texture_3d<f32>;
        @group(1) @binding(3) var stored: texture_storage_2d<r32float, write>;
        @group(1) @binding(4) var texels: sampler;
        @group(1) @binding(5) var unused: texture_2d<f32>;
        fn called() -> f32 { return textureSampleLevel(volume, texels, vec3(0.5), 0.0).x; }
        fn not_called() -> f32 { return textureLoad(unused, vec2(0), 0).x; }
        @fragment fn fragment() -> @location(0) vec4<f32> { return vec4(called() + f32(settings.taps)); }
        @compute @workgroup_size(1) fn main() {
            var sum = values[0] + textureLoad(depth, vec2(0), 0);
            for (var i = 0u; i < settings.taps; i++) {
                switch i {
                    case 0u: { sum += f32(textureLoad(layers, vec2(0), 0, 0).x); }
                    default: { if i > 3u { sum += called(); } }
                }
            }
            sums[0].taps = u32(sum);
            textureStore(stored, vec2(0), vec4(sum));
        }";

    #[test]
    fn bindings_are_those_that_entry_points_use_and_of_the_shader_s_kind() {
        use BindingKind::{Buffer, Sampler, Stored, Texture};
        use wgpu::BufferBindingType::{Storage, Uniform};
        use wgpu::{TextureSampleType as Sampled, TextureViewDimension as Dimension};
        let mut module = naga::front::wgsl::parse_str(SHADER).unwrap();
        let found = bindings(&mut module);
        let in_fragments = |of: &&Binding| of.stages.contains(wgpu::ShaderStages::FRAGMENT);
        assert!(found.iter().all(|of| of.stages.contains(wgpu::ShaderStages::COMPUTE)));
        assert!(found.iter().filter(in_fragments).eq([&found[0], &found[5], &found[7]]));
        let kinds: Vec<_> = found.iter().map(|of| ([of.group, of.binding], of.kind)).collect();
        let expected = [
            ([0, 0], Buffer(Uniform)),
            ([0, 1], Buffer(Storage { read_only: true })),
            ([0, 2], Buffer(Storage { read_only: false })),
            ([1, 0], Texture(Dimension::D2, Sampled::Depth)),
            ([1, 1], Texture(Dimension::D2Array, Sampled::Uint)),
            ([1, 2], Texture(Dimension::D3, Sampled::Float { filterable: true })),
            ([1, 3], Stored(Dimension::D2)),
            ([1, 4], Sampler { comparison: false }),
        ];
        assert_eq!(kinds, expected);
        let structs = found.iter().filter_map(|of| Some((of.binding, of.structure.as_ref()?)));
        let structs: Vec<_> = structs.map(|(at, name)| (at, name.as_str())).collect();
        assert_eq!(structs, [(0, "Filter"), (2, "Filter")]);
    }
}
