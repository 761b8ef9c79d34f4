//! Limits checked before anything is allocated.

use super::{Capacity, Gpu, MAX_ITERATIONS};
use fathom_record::Work;

/// What a pipeline will need of the adapter, collected before it is built; checked by [`Gpu::check`].
#[derive(Clone, Debug, Default)]
pub struct Demand {
    needs: Vec<Need>,
    /// Bytes of textures and buffers, by what they are for.
    allocated: Vec<(String, u64)>,
    /// Bytes that the host takes to read results back.
    copied: Vec<(String, u64)>,
    /// Work of a frame, where sizes and settings can make it long.
    work: Vec<(String, Work)>,
}

#[derive(Clone, Debug)]
struct Need {
    /// Name of the limit, for the message.
    limit: &'static str,
    allowed: fn(&Capacity) -> u64,
    /// The resource or stage, for the message.
    what: String,
    requested: u64,
}

/// A limit that fathom sets for all adapters.
const LOOP_ITERATIONS: &str = "loop iterations in an invocation";

/// A limit as wgpu names it.
macro_rules! limit {
    ($name:ident) => {
        (stringify!($name), |of| of.limits.$name.into())
    };
}

impl Demand {
    pub fn new() -> Self {
        Self::default()
    }

    fn need(
        &mut self,
        (limit, allowed): (&'static str, fn(&Capacity) -> u64),
        what: &str,
        requested: u64,
    ) -> &mut Self {
        self.needs.push(Need { limit, allowed, what: what.to_owned(), requested });
        self
    }

    /// A two-dimensional texture of this size in texels.
    pub fn texture_2d(&mut self, what: &str, width: u64, height: u64) -> &mut Self {
        self.need(limit!(max_texture_dimension_2d), what, width.max(height))
    }

    /// A volume texture of this size in texels.
    pub fn texture_3d(&mut self, what: &str, size: [u64; 3]) -> &mut Self {
        let longest = size.into_iter().max().unwrap_or(0);
        self.need(limit!(max_texture_dimension_3d), what, longest)
    }

    /// A buffer that is never bound whole as storage (vertices, indices, staging), in bytes.
    pub fn buffer(&mut self, what: &str, bytes: u64) -> &mut Self {
        self.need(limit!(max_buffer_size), what, bytes)
    }

    /// A buffer bound whole as storage, in bytes.
    pub fn storage(&mut self, what: &str, bytes: u64) -> &mut Self {
        self.buffer(what, bytes).need(limit!(max_storage_buffer_binding_size), what, bytes)
    }

    /// A uniform buffer, in bytes.
    pub fn uniform(&mut self, what: &str, bytes: u64) -> &mut Self {
        self.buffer(what, bytes).need(limit!(max_uniform_buffer_binding_size), what, bytes)
    }

    /// Things that shaders index, such as voxels. Shaders count in 32 bits on any adapter.
    pub fn indexed(&mut self, what: &str, count: u64) -> &mut Self {
        self.need(("indices of 32 bits", |_| u32::MAX.into()), what, count)
    }

    /// Shaders whose invocations make so many iterations of their loops: see [`MAX_ITERATIONS`].
    pub fn iterations(&mut self, what: &str, count: u64) -> &mut Self {
        self.need((LOOP_ITERATIONS, |_| MAX_ITERATIONS), what, count)
    }

    /// A dispatch of this many workgroups in each dimension.
    pub fn dispatch(&mut self, what: &str, groups: [u64; 3]) -> &mut Self {
        let max = groups.into_iter().max().unwrap_or(0);
        self.need(limit!(max_compute_workgroups_per_dimension), what, max)
    }

    /// A render pass with this many colour targets, of so many bytes per sample together.
    pub fn color_targets(&mut self, what: &str, count: u64, bytes_per_sample: u64) -> &mut Self {
        self.need(limit!(max_color_attachments), what, count);
        self.need(limit!(max_color_attachment_bytes_per_sample), what, bytes_per_sample)
    }

    /// A shader that binds so many storage buffers.
    pub fn storage_buffers(&mut self, what: &str, count: u64) -> &mut Self {
        self.need(limit!(max_storage_buffers_per_shader_stage), what, count)
    }

    /// A stage whose fragment shader writes storage.
    pub fn fragment_writes(&mut self, what: &str) -> &mut Self {
        let allowed = |of: &Capacity| u64::from(!of.read_only_fragments);
        self.need(("storage that fragment shaders write", allowed), what, 1)
    }

    /// Textures and buffers of the pipeline take so many bytes.
    pub fn holds(&mut self, what: &str, bytes: u64) -> &mut Self {
        self.allocated.push((what.to_owned(), bytes));
        self
    }

    /// The host takes so many bytes to make or read back what the pipeline holds.
    pub fn copies(&mut self, what: &str, bytes: u64) -> &mut Self {
        self.copied.push((what.to_owned(), bytes));
        self
    }

    /// Each frame does this work.
    pub fn takes(&mut self, what: &str, work: Work) -> &mut Self {
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

    /// The first demand that the limits of `capacity` do not meet, as a sentence with the limit's name, what was asked
    /// and what is allowed.
    pub fn check(&self, capacity: &Capacity) -> Result<(), String> {
        for Need { limit, allowed, what, requested } in &self.needs {
            let allowed = allowed(capacity);
            if *requested > allowed {
                let by = if *limit == LOOP_ITERATIONS { "fathom" } else { "the adapter" };
                return Err(format!("{what}: asks {requested} of {limit}, {by} allows {allowed}"));
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

    #[test]
    fn a_demand_beyond_a_limit_names_it_with_both_figures() {
        let limits = Capacity::default();
        let mut demand = Demand::new();
        demand.texture_2d("view", 800, 600).texture_2d("light map", 9000, 16);
        let message = demand.check(&limits).unwrap_err();
        assert_eq!(
            message,
            "light map: asks 9000 of max_texture_dimension_2d, the adapter allows 8192"
        );
    }

    #[test]
    fn demands_at_the_limit_pass() {
        let capacity = Capacity::default();
        let limits = &capacity.limits;
        let groups = u64::from(limits.max_compute_workgroups_per_dimension);
        let mut demand = Demand::new();
        demand
            .storage("photons", limits.max_storage_buffer_binding_size)
            .dispatch("trace", [groups, 1, 1])
            .uniform("frame", limits.max_uniform_buffer_binding_size);
        assert_eq!(demand.check(&capacity), Ok(()));
        assert!(Demand::new().dispatch("trace", [1, groups + 1, 1]).check(&capacity).is_err());
        assert!(Demand::new().indexed("voxels", 1 << 32).check(&capacity).is_err());
    }
}
