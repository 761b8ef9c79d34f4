//! Limits checked before anything is allocated.

use super::{Gpu, MAX_ITERATIONS};
use fathom_record::Work;

/// What a pipeline will need of the adapter, collected before it is built; checked by [`Gpu::check`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Demand {
    needs: Vec<Need>,
    /// Bytes of textures and buffers, by what they are for.
    allocated: Vec<(String, u64)>,
    /// Bytes that the host takes to read results back.
    copied: Vec<(String, u64)>,
    /// Work of a frame, where sizes and settings can make it long.
    work: Vec<(String, Work)>,
}

#[derive(Clone, Debug, PartialEq)]
struct Need {
    limit: DeviceLimit,
    /// The resource or stage, for the message.
    what: String,
    requested: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DeviceLimit {
    Texture2d,
    Texture3d,
    Buffer,
    StorageBinding,
    UniformBinding,
    DispatchGroups,
    ColorAttachments,
    BytesPerSample,
    StorageBuffers,
    Index,
    LoopTurns,
}

impl DeviceLimit {
    fn name_and_value(self, limits: &wgpu::Limits) -> (&'static str, u64) {
        match self {
            Self::Texture2d => ("max_texture_dimension_2d", limits.max_texture_dimension_2d.into()),
            Self::Texture3d => ("max_texture_dimension_3d", limits.max_texture_dimension_3d.into()),
            Self::Buffer => ("max_buffer_size", limits.max_buffer_size),
            Self::StorageBinding => {
                ("max_storage_buffer_binding_size", limits.max_storage_buffer_binding_size)
            }
            Self::UniformBinding => {
                ("max_uniform_buffer_binding_size", limits.max_uniform_buffer_binding_size)
            }
            Self::DispatchGroups => (
                "max_compute_workgroups_per_dimension",
                limits.max_compute_workgroups_per_dimension.into(),
            ),
            Self::ColorAttachments => {
                ("max_color_attachments", limits.max_color_attachments.into())
            }
            Self::BytesPerSample => (
                "max_color_attachment_bytes_per_sample",
                limits.max_color_attachment_bytes_per_sample.into(),
            ),
            Self::StorageBuffers => (
                "max_storage_buffers_per_shader_stage",
                limits.max_storage_buffers_per_shader_stage.into(),
            ),
            // No adapter's: shaders count in 32 bits.
            Self::Index => ("indices of 32 bits", u32::MAX.into()),
            // The least of all adapters.
            Self::LoopTurns => ("turns of loops in an invocation", MAX_ITERATIONS),
        }
    }
}

/// What a shader binds, and takes in a workgroup.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct ShaderUse {
    storage_buffers: u32,
    uniform_buffers: u32,
    sampled_textures: u32,
    samplers: u32,
    storage_textures: u32,
    groups: u32,
    invocations: u32,
    workgroup_bytes: u32,
}

/// The most that any of fathom's shaders takes, but for the storage buffers of `voxel/alpha`, which pipelines with it
/// [ask for](Demand::storage_buffers). A test reads it from the shaders.
const MAX: ShaderUse = ShaderUse {
    storage_buffers: 4,
    uniform_buffers: 4,
    sampled_textures: 8,
    samplers: 1,
    storage_textures: 1,
    groups: 3,
    invocations: 64,
    workgroup_bytes: 4224,
};

/// The first limit that is below what shaders need whatever the sizes, with both figures.
pub(super) fn shortfall(limits: &wgpu::Limits) -> Option<String> {
    macro_rules! short {
        ($($name:ident: $needed:ident),*) => {
            $(if limits.$name < MAX.$needed {
                let (needed, allowed, name) = (MAX.$needed, limits.$name, stringify!($name));
                return Some(format!("{needed} of {name} (it has {allowed})"));
            })*
        };
    }
    short! {
        max_compute_invocations_per_workgroup: invocations,
        max_storage_buffers_per_shader_stage: storage_buffers,
        max_uniform_buffers_per_shader_stage: uniform_buffers,
        max_sampled_textures_per_shader_stage: sampled_textures,
        max_samplers_per_shader_stage: samplers,
        max_storage_textures_per_shader_stage: storage_textures,
        max_bind_groups: groups,
        max_compute_workgroup_storage_size: workgroup_bytes
    }
    None
}

impl Demand {
    pub fn new() -> Self {
        Self::default()
    }

    fn need(mut self, limit: DeviceLimit, what: &str, requested: u64) -> Self {
        self.needs.push(Need { limit, what: what.to_owned(), requested });
        self
    }

    /// A two-dimensional texture of this size in texels.
    pub fn texture_2d(self, what: &str, width: u64, height: u64) -> Self {
        self.need(DeviceLimit::Texture2d, what, width.max(height))
    }

    /// A volume texture of this size in texels.
    pub fn texture_3d(self, what: &str, size: [u64; 3]) -> Self {
        let longest = size.into_iter().max().unwrap_or(0);
        self.need(DeviceLimit::Texture3d, what, longest)
    }

    /// A buffer that is never bound whole as storage (vertices, indices, staging), in bytes.
    pub fn buffer(self, what: &str, bytes: u64) -> Self {
        self.need(DeviceLimit::Buffer, what, bytes)
    }

    /// A buffer bound whole as storage, in bytes.
    pub fn storage(self, what: &str, bytes: u64) -> Self {
        self.need(DeviceLimit::Buffer, what, bytes).need(DeviceLimit::StorageBinding, what, bytes)
    }

    /// A uniform buffer, in bytes.
    pub fn uniform(self, what: &str, bytes: u64) -> Self {
        self.need(DeviceLimit::Buffer, what, bytes).need(DeviceLimit::UniformBinding, what, bytes)
    }

    /// Things that shaders index, such as voxels.
    pub fn indexed(self, what: &str, count: u64) -> Self {
        self.need(DeviceLimit::Index, what, count)
    }

    /// Shaders whose invocations make so many turns of their loops. See [`MAX_ITERATIONS`].
    pub fn iterations(self, what: &str, count: u64) -> Self {
        self.need(DeviceLimit::LoopTurns, what, count)
    }

    /// A dispatch of this many workgroups in each dimension.
    pub fn dispatch(self, what: &str, groups: [u64; 3]) -> Self {
        let most = groups.into_iter().max().unwrap_or(0);
        self.need(DeviceLimit::DispatchGroups, what, most)
    }

    /// A render pass with this many colour targets, of so many bytes per sample together.
    pub fn color_targets(self, what: &str, count: u64, bytes_per_sample: u64) -> Self {
        self.need(DeviceLimit::ColorAttachments, what, count).need(
            DeviceLimit::BytesPerSample,
            what,
            bytes_per_sample,
        )
    }

    /// A shader that binds so many storage buffers.
    pub fn storage_buffers(self, what: &str, count: u64) -> Self {
        self.need(DeviceLimit::StorageBuffers, what, count)
    }

    /// Textures and buffers of the pipeline take so many bytes.
    pub fn holds(mut self, what: &str, bytes: u64) -> Self {
        self.allocated.push((what.to_owned(), bytes));
        self
    }

    /// The host takes so many bytes to make or read back what the pipeline holds.
    pub fn copies(mut self, what: &str, bytes: u64) -> Self {
        self.copied.push((what.to_owned(), bytes));
        self
    }

    /// Each frame does this work.
    pub fn takes(mut self, what: &str, work: Work) -> Self {
        self.work.push((what.to_owned(), work));
        self
    }

    pub fn allocated_bytes(&self) -> u64 {
        total(self.allocated.iter())
    }

    /// The same with the host's copies.
    pub fn bytes(&self) -> u64 {
        total(self.allocated.iter().chain(&self.copied))
    }

    /// What takes most of the memory, and how much.
    pub(super) fn largest(&self) -> Option<(String, u64)> {
        let all = || self.allocated.iter().chain(&self.copied);
        let sum = |what: &str| total(all().filter(|(other, _)| other == what));
        let sums = all().map(|(what, _)| (what.clone(), sum(what)));
        sums.max_by_key(|(_, bytes)| *bytes)
    }

    pub(super) fn work(&self) -> &[(String, Work)] {
        &self.work
    }

    pub fn merge(mut self, other: Demand) -> Self {
        self.needs.extend(other.needs);
        self.allocated.extend(other.allocated);
        self.copied.extend(other.copied);
        self.work.extend(other.work);
        self
    }

    /// The first demand that `limits` do not meet, as a sentence with the limit's name, what was asked
    /// and what is allowed.
    pub fn check(&self, limits: &wgpu::Limits) -> Result<(), String> {
        for need in &self.needs {
            let (name, allowed) = need.limit.name_and_value(limits);
            if need.requested > allowed {
                return Err(format!(
                    "{}: asks {} of {name}, the adapter allows {allowed}",
                    need.what, need.requested
                ));
            }
        }
        Ok(())
    }
}

fn total<'a>(parts: impl Iterator<Item = &'a (String, u64)>) -> u64 {
    parts.fold(0, |sum, (_, bytes)| sum.saturating_add(*bytes))
}

impl Gpu {
    /// Checks a demand against what this adapter can take, before any allocation.
    pub fn check(&self, demand: &Demand) -> Result<(), String> {
        self.capacity.check(demand)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{BindingKind, bindings};
    use crate::shader::{link, shader_paths};
    use fathom_base::embedded::{Folders, SHADERS};

    #[test]
    fn a_demand_beyond_a_limit_names_it_with_both_figures() {
        let limits = wgpu::Limits::default();
        let demand = Demand::new().texture_2d("view", 800, 600).texture_2d("light map", 9000, 16);
        let message = demand.check(&limits).unwrap_err();
        assert_eq!(
            message,
            "light map: asks 9000 of max_texture_dimension_2d, the adapter allows 8192"
        );
    }

    /// What a shader takes with its defaults.
    fn shading(module: &wgpu::naga::Module) -> ShaderUse {
        use wgpu::BufferBindingType::{Storage, Uniform};
        let bound = bindings(module);
        let count = |of: fn(&BindingKind) -> bool| {
            bound.iter().filter(|binding| of(&binding.kind)).count() as u32
        };
        let shared = module.global_variables.iter().map(|(_, variable)| variable);
        let shared = shared.filter(|v| v.space == wgpu::naga::AddressSpace::WorkGroup);
        let bytes = shared.map(|v| module.types[v.ty].inner.size(module.to_ctx()));
        let entries = module.entry_points.iter();
        ShaderUse {
            storage_buffers: count(|kind| matches!(kind, BindingKind::Buffer(Storage { .. }))),
            uniform_buffers: count(|kind| matches!(kind, BindingKind::Buffer(Uniform))),
            sampled_textures: count(|kind| matches!(kind, BindingKind::Texture(..))),
            samplers: count(|kind| matches!(kind, BindingKind::Sampler { .. })),
            storage_textures: count(|kind| matches!(kind, BindingKind::Stored(_))),
            groups: bound.iter().map(|binding| binding.group + 1).max().unwrap_or(0),
            invocations: entries.map(|entry| entry.workgroup_size.iter().product()).max().unwrap(),
            workgroup_bytes: bytes.sum(),
        }
    }

    #[test]
    fn what_every_shader_needs_of_an_adapter_is_stated() {
        let folders = Folders::new(SHADERS);
        let paths = shader_paths(&folders).into_iter().filter(|path| path != "voxel/alpha");
        let all = paths.map(|path| shading(&link(&folders, &path, &[]).unwrap()));
        let most = all.reduce(|a, b| ShaderUse {
            storage_buffers: a.storage_buffers.max(b.storage_buffers),
            uniform_buffers: a.uniform_buffers.max(b.uniform_buffers),
            sampled_textures: a.sampled_textures.max(b.sampled_textures),
            samplers: a.samplers.max(b.samplers),
            storage_textures: a.storage_textures.max(b.storage_textures),
            groups: a.groups.max(b.groups),
            invocations: a.invocations.max(b.invocations),
            workgroup_bytes: a.workgroup_bytes.max(b.workgroup_bytes),
        });
        assert_eq!(most, Some(MAX));
        assert_eq!(shortfall(&wgpu::Limits::downlevel_defaults()), None);
        let none = shortfall(&wgpu::Limits::downlevel_webgl2_defaults()).unwrap();
        assert_eq!(none, "64 of max_compute_invocations_per_workgroup (it has 0)");
    }

    #[test]
    fn demands_at_the_limit_pass() {
        let limits = wgpu::Limits::default();
        let groups = u64::from(limits.max_compute_workgroups_per_dimension);
        let demand = Demand::new()
            .storage("photons", limits.max_storage_buffer_binding_size)
            .dispatch("trace", [groups, 1, 1])
            .merge(Demand::new().uniform("frame", limits.max_uniform_buffer_binding_size));
        assert_eq!(demand.check(&limits), Ok(()));
        assert!(Demand::new().dispatch("trace", [1, groups + 1, 1]).check(&limits).is_err());
        assert!(Demand::new().indexed("voxels", 1 << 32).check(&limits).is_err());
    }
}
