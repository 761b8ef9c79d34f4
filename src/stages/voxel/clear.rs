//! `voxel/clear`: slicemaps, bit volumes and opacities start from nothing. VAO §4.2.

use crate::kit::Buffer;
use crate::{Stage, StageInfo};
use fathom_gpu::StageScope;
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/clear",
    about: "clears slicemaps, bit volumes and opacities",
    source: "VAO §4.2",
};

/// A buffer's part that is cleared: its first bytes.
#[derive(Clone)]
pub struct Cleared {
    pub buffer: Buffer,
    pub bytes: u64,
}

impl From<&Buffer> for Cleared {
    fn from(buffer: &Buffer) -> Self {
        Self { buffer: buffer.clone(), bytes: buffer.size() }
    }
}

pub struct Clear {
    cleared: Vec<Cleared>,
}

impl Clear {
    pub fn new(cleared: Vec<Cleared>) -> Self {
        Self { cleared }
    }
}

impl Stage for Clear {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.copy(|encoder| {
            for Cleared { buffer, bytes } in &self.cleared {
                encoder.clear_buffer(buffer, 0, Some(*bytes));
            }
        });
    }

    fn work(&self) -> Work {
        Work { bytes_written: self.cleared.iter().map(|c| c.bytes).sum(), ..Work::default() }
    }
}
