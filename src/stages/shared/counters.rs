//! Counters that a shader adds to, for figures of a frame that is run once more to count.

use crate::kit::{Bind, Buffer, Resource, Resources};
use fathom_gpu::{Gpu, GpuError, read_buffer};

/// Partial sums of each counter, so that fragments do not queue for one.
const SLOTS: usize = 64;

pub struct Counters(Buffer);

impl Counters {
    pub fn new(resources: &Resources<'_>, label: &str, counters: usize) -> Self {
        Self(resources.storage(label, (counters * SLOTS * 4) as u64))
    }

    /// What was counted, in the shader's order.
    pub fn sums(&self, gpu: &Gpu) -> Result<Vec<u64>, GpuError> {
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.0)?);
        let sum = |slots: &[u32]| slots.iter().map(|n| u64::from(*n)).sum();
        Ok(words.chunks(SLOTS).map(sum).collect())
    }
}

impl Bind for Counters {
    fn resource(&self) -> Resource {
        self.0.resource()
    }
}
