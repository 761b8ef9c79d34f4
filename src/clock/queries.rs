//! Results of queries, read back from the GPU.

use crate::{Device, DeviceError};

/// Bytes of a result.
pub(crate) const RESULT_BYTES: u64 = size_of::<u64>() as u64;

/// The buffers that results go through.
pub(crate) struct QueryResults {
    resolved: wgpu::Buffer,
    read_back: wgpu::Buffer,
}

impl QueryResults {
    pub(crate) fn new(gpu: &Device, label: &str, max_count: u64) -> Self {
        use wgpu::BufferUsages as Usage;
        let buffer = |usage| gpu.buffer(label, max_count * RESULT_BYTES, usage);
        Self {
            resolved: buffer(Usage::QUERY_RESOLVE | Usage::COPY_SRC),
            read_back: buffer(Usage::MAP_READ | Usage::COPY_DST),
        }
    }

    /// The first `count` results, which `resolve` puts into the buffer that it is given. In a submission of its own.
    pub(crate) fn read(
        &self,
        gpu: &Device,
        count: u64,
        resolve: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer),
    ) -> Result<Vec<u64>, DeviceError> {
        let bytes = count * RESULT_BYTES;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        resolve(&mut encoder, &self.resolved);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read_back, 0, bytes);
        gpu.queue.submit([encoder.finish()]);
        gpu.map(&self.read_back, bytes, |raw| {
            let (results, _) = raw.as_chunks::<8>();
            results.iter().map(|result| u64::from_le_bytes(*result)).collect()
        })
    }
}
