//! Structs that host and shaders share.

use encase::internal::WriteInto;
use encase::{ShaderType, StorageBuffer};

/// A host type that shaders know, too.
pub trait WgslType {
    /// The type as WGSL writes it.
    fn wgsl() -> String;
}

macro_rules! wgsl_types {
    ($($host:ty => $wgsl:literal),* $(,)?) => {
        $(impl WgslType for $host {
            fn wgsl() -> String {
                $wgsl.to_owned()
            }
        })*
    };
}

wgsl_types! {
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

impl<T: WgslType, const N: usize> WgslType for [T; N] {
    fn wgsl() -> String {
        format!("array<{}, {N}>", T::wgsl())
    }
}

/// What [`shader_struct!`](crate::shader_struct) makes.
pub trait ShaderStruct: WgslType + ShaderType + WriteInto {}

impl<T: WgslType + ShaderType + WriteInto> ShaderStruct for T {}

/// Gives the declaration of a struct in WGSL.
pub struct SharedStruct(pub fn() -> String);

inventory::collect!(SharedStruct);

/// Declares a struct for the host and for shaders, which import it: `shader_struct! { pub struct TraceUniforms { pub grid: u32, … } }`
/// and `#import fathom::host::{TraceUniforms}`. No two structs of a program have the same name, and no field's name ends in a digit,
/// which naga_oil would change. The crate needs `encase`.
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

        impl $crate::kit::WgslType for $name {
            fn wgsl() -> String {
                stringify!($name).to_owned()
            }
        }

        $crate::inventory::submit! {
            $crate::kit::SharedStruct(|| {
                let members = [$((stringify!($field), <$type as $crate::kit::WgslType>::wgsl())),*];
                let members = members.map(|(name, wgsl)| format!("    {name}: {wgsl},\n"));
                format!("struct {} {{\n{}}}\n", stringify!($name), members.concat())
            })
        }
    };
}

/// The module `fathom::host`: every struct that a [`shader_struct!`](crate::shader_struct) of the program declares.
pub(crate) fn host_module() -> String {
    let mut structs: Vec<String> =
        inventory::iter::<SharedStruct>().map(|SharedStruct(declaration)| declaration()).collect();
    structs.sort_unstable();
    format!("#define_import_path fathom::host\n{}", structs.concat())
}

/// Bytes of a host value in WGSL's layout of uniforms and storage.
pub fn host_bytes<T: ShaderType + WriteInto>(value: &T) -> Vec<u8> {
    let mut buffer = StorageBuffer::new(Vec::new());
    buffer.write(value).expect("a Vec grows to whatever a shader type needs");
    buffer.into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kit::{Bindings, Dispatch, Resources};
    use crate::{Gpu, Options};
    use wgpu::naga;

    shader_struct! {
        struct Inner {
            pub place: glam::UVec3,
            pub size: f32,
        }
    }

    shader_struct! {
        struct Outer {
            pub count: u32,
            pub center: glam::Vec3,
            pub scale: f32,
            pub along: glam::IVec2,
            pub inner: Inner,
            pub several: [Inner; 3],
            pub matrix: glam::Mat4,
            pub end: glam::Vec2,
        }
    }

    #[test]
    fn shaders_lay_out_structs_within_structs_and_arrays_as_the_host_does() {
        let module = host_module().replace("#define_import_path fathom::host", "");
        let module = naga::front::wgsl::parse_str(&module).unwrap();
        let outer = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some("Outer"));
        let naga::TypeInner::Struct { members, span } = &outer.unwrap().1.inner else { panic!() };
        let host = Outer::METADATA;
        assert!(members.iter().map(|member| u64::from(member.offset)).eq(host.extra.offsets));
        assert_eq!(u64::from(*span), host.min_size().get());
    }

    #[test]
    fn another_struct_than_the_shaders_own_is_refused() {
        let gpu = Gpu::open(&Options::default()).expect("an adapter is there");
        let resources = Resources::new(&gpu);
        let other = resources.uniform("test", &Inner { place: glam::UVec3::ONE, size: 1.0 });
        let group = Bindings::new(&[&other, &resources.storage("test", 8)]);
        let refused = Dispatch::new(&resources, "audit/loops", &[&group], [1; 3]).err().unwrap();
        assert!(refused.to_string().contains("of LoopLengths"), "{refused}");
    }
}
