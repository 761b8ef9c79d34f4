//! How WGSL lays out the structs that a linked shader binds.

use wgpu::naga;

/// A member of a struct.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    pub name: String,
    /// Its type as WGSL writes it; `struct` for a struct.
    pub wgsl: String,
    /// Bytes from the struct's start.
    pub offset: u32,
}

/// How a struct is laid out, in bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StructLayout {
    /// In order.
    pub members: Vec<Member>,
    /// Size of the struct, its padding included.
    pub span: u32,
}

/// A struct that a shader binds, alone or as the element of an array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BoundStruct {
    pub group: u32,
    pub binding: u32,
    /// As the shader calls it.
    pub name: String,
    pub layout: StructLayout,
}

impl StructLayout {
    /// Members are (name, WGSL type).
    pub fn new(members: &[(&str, &str)], offsets: &[u32], span: u32) -> Self {
        let member = |((name, wgsl), offset): (&(&str, &str), &u32)| Member {
            name: (*name).to_owned(),
            wgsl: (*wgsl).to_owned(),
            offset: *offset,
        };
        Self { members: members.iter().zip(offsets).map(member).collect(), span }
    }

    /// The first difference from a shader's layout, as a sentence.
    pub fn difference(&self, shader: &Self) -> Option<String> {
        let longest = self.members.len().max(shader.members.len());
        let shown = |member: Option<&Member>| {
            member.map_or("nothing".to_owned(), |m| {
                format!("`{}: {}` at {}", m.name, m.wgsl, m.offset)
            })
        };
        let pairs = (0..longest).map(|i| (self.members.get(i), shader.members.get(i)));
        let differing = pairs.into_iter().find(|(host, shader)| host != shader);
        match differing {
            Some((host, shader)) => {
                Some(format!("the host has {}, the shader {}", shown(host), shown(shader)))
            }
            None if self.span != shader.span => {
                Some(format!("the host has {} bytes, the shader {}", self.span, shader.span))
            }
            None => None,
        }
    }

    fn of(module: &naga::Module, members: &[naga::StructMember], span: u32) -> Self {
        let member = |m: &naga::StructMember| Member {
            name: m.name.clone().unwrap_or_default(),
            wgsl: wgsl(&module.types[m.ty].inner),
            offset: m.offset,
        };
        Self { members: members.iter().map(member).collect(), span }
    }
}

/// The structs that a linked module binds.
pub(super) fn bound_structs(module: &naga::Module) -> Vec<BoundStruct> {
    let bound = |variable: &naga::GlobalVariable| {
        let binding = variable.binding?;
        let (ty, members, span) = element(module, variable.ty)?;
        Some(BoundStruct {
            group: binding.group,
            binding: binding.binding,
            name: plain(ty.name.as_deref().unwrap_or_default()),
            layout: StructLayout::of(module, members, span),
        })
    };
    module.global_variables.iter().filter_map(|(_, variable)| bound(variable)).collect()
}

/// A struct, or that which an array holds.
fn element(
    module: &naga::Module,
    ty: naga::Handle<naga::Type>,
) -> Option<(&naga::Type, &[naga::StructMember], u32)> {
    match &module.types[ty].inner {
        naga::TypeInner::Struct { members, span } => Some((&module.types[ty], members, *span)),
        naga::TypeInner::Array { base, .. } => element(module, *base),
        _ => None,
    }
}

/// naga_oil puts the module's path behind the names of shared structs.
fn plain(name: &str) -> String {
    name.split("X_naga_oil_mod_X").next().unwrap_or(name).to_owned()
}

fn wgsl(inner: &naga::TypeInner) -> String {
    let scalar = |scalar: &naga::Scalar| match scalar.kind {
        naga::ScalarKind::Float => "f32",
        naga::ScalarKind::Uint => "u32",
        naga::ScalarKind::Sint => "i32",
        _ => "bool",
    };
    match inner {
        naga::TypeInner::Scalar(s) | naga::TypeInner::Atomic(s) => scalar(s).to_owned(),
        naga::TypeInner::Vector { size, scalar: s } => {
            format!("vec{}<{}>", *size as u32, scalar(s))
        }
        naga::TypeInner::Matrix { columns, rows, scalar: s } => {
            format!("mat{}x{}<{}>", *columns as u32, *rows as u32, scalar(s))
        }
        naga::TypeInner::Struct { .. } => "struct".to_owned(),
        _ => "array".to_owned(),
    }
}
