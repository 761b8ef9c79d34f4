//! Counters that a shader adds to, for figures of a frame that is run once more to count.

use fathom_gpu::kit::{Bind, Buffer, Resource, Resources};
use fathom_gpu::{Gpu, GpuError, Stage, read_buffer};

/// Partial sums of each counter, so that fragments do not queue for one: 64 bits each, the lower word first.
const SLOTS: usize = 64;

pub struct Counters(pub Buffer);

impl Counters {
    pub fn new(resources: &Resources<'_>, label: &str, counters: usize) -> Self {
        Self(resources.storage(label, (counters * SLOTS * 8) as u64))
    }

    /// What was counted, in the shader's order.
    pub fn sums(&self, gpu: &Gpu) -> Result<Vec<u64>, GpuError> {
        let sums: Vec<u64> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.0)?);
        Ok(sums.chunks(SLOTS).map(|slots| slots.iter().sum()).collect())
    }
}

impl Bind for Counters {
    fn resource(&self) -> Resource {
        self.0.resource()
    }
}

/// The sums of a stage that counts, run once.
pub fn count<T, const N: usize>(
    gpu: &Gpu,
    stage: impl FnOnce(&Resources<'_>, &Counters) -> Result<Stage<T>, GpuError>,
) -> Result<[u64; N], GpuError> {
    let resources = Resources::new(gpu);
    let counters = Counters::new(&resources, "counters", N);
    let stage = stage(&resources, &counters)?;
    gpu.run(&[&stage])?;
    let sums = counters.sums(gpu)?;
    Ok(std::array::from_fn(|index| sums[index]))
}
