//! Structs that host and shaders share, and the check that their layouts are equal.

use encase::internal::WriteInto;
use encase::{ShaderType, StorageBuffer};

use super::{Buffer, Resource};
use crate::{Binding, GpuError, Shader, StructLayout};

/// A host struct that shaders read or write; [`shader_struct!`](crate::shader_struct) makes it.
pub trait ShaderStruct: ShaderType + WriteInto {
    /// Names, WGSL types and offsets of the fields, and the size.
    fn layout() -> StructLayout;
}

/// The WGSL type of a field.
pub trait FieldType {
    const WGSL: &'static str;
}

macro_rules! field_types {
    ($($host:ty => $wgsl:literal),* $(,)?) => {
        $(impl FieldType for $host {
            const WGSL: &'static str = $wgsl;
        })*
    };
}

field_types! {
    f32 => "f32",
    u32 => "u32",
    glam::UVec2 => "vec2<u32>",
    glam::IVec2 => "vec2<i32>",
    i32 => "i32",
    glam::Vec2 => "vec2<f32>",
    glam::Vec3 => "vec3<f32>",
    glam::Vec4 => "vec4<f32>",
    glam::UVec3 => "vec3<u32>",
    glam::Mat4 => "mat4x4<f32>",
}

/// A struct with the same fields in a shader: `shader_struct! { pub struct TraceUniforms { pub grid: u32, … } }`. When a pipeline binds
/// it, the layouts must be equal.
#[macro_export]
macro_rules! shader_struct {
    ($(#[$about:meta])* $visibility:vis struct $name:ident {
        $($(#[$field_about:meta])* pub $field:ident: $type:ty),* $(,)?
    }) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, ::encase::ShaderType)]
        $visibility struct $name {
            $($(#[$field_about])* pub $field: $type),*
        }

        impl $crate::kit::ShaderStruct for $name {
            fn layout() -> $crate::kit::StructLayout {
                use $crate::kit::FieldType;
                let types = [$((stringify!($field), <$type as FieldType>::WGSL)),*];
                let metadata = <Self as ::encase::ShaderType>::METADATA;
                let offsets = metadata.extra.offsets.map(|offset| offset as u32);
                $crate::kit::StructLayout::new(&types, &offsets, metadata.min_size().get() as u32)
            }
        }

        impl $crate::kit::FieldType for $name {
            const WGSL: &'static str = "struct";
        }
    };
}

/// Bytes of a host value in WGSL's layout of uniforms and storage.
pub fn host_bytes<T: ShaderType + WriteInto>(value: &T) -> Vec<u8> {
    let mut buffer = StorageBuffer::new(Vec::new());
    buffer.write(value).expect("a Vec grows to whatever a shader type needs");
    buffer.into_inner()
}

/// Fails where the layout of a bound struct differs between shader and host.
pub(super) fn check(shader: &Shader, binding: &Binding, host: &Resource) -> Result<(), GpuError> {
    let Resource::Buffer(Buffer { layout: Some(host), .. }) = host else { return Ok(()) };
    let Some((name, layout)) = &binding.structure else { return Ok(()) };
    let Some(difference) = host.difference(layout) else { return Ok(()) };
    let Binding { group, binding, .. } = binding;
    let message = format!(
        "struct `{name}` at group {group}, binding {binding} is not that of the host: {difference}"
    );
    Err(GpuError::Shader { path: shader.path.clone(), message })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_name_the_first_field_that_differs() {
        let base = || StructLayout::new(&[("a", "f32"), ("b", "u32")], &[0, 4], 8);
        assert_eq!(base().difference(&base()), None);
        let cases = [
            (StructLayout::new(&[("a", "f32"), ("c", "u32")], &[0, 4], 8), "b"),
            (StructLayout::new(&[("a", "f32"), ("b", "f32")], &[0, 4], 8), "b"),
            (StructLayout::new(&[("a", "f32"), ("b", "u32")], &[0, 8], 8), "b"),
            (StructLayout::new(&[("a", "f32")], &[0], 8), "b"),
            (StructLayout::new(&[("a", "f32"), ("b", "u32")], &[0, 4], 16), "bytes"),
        ];
        for (shader, named) in cases {
            let difference = base().difference(&shader).unwrap();
            assert!(difference.contains(named), "{difference}");
        }
    }
}
