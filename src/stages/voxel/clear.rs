//! `voxel/clear`: slicemaps, bit volumes and opacities start from nothing. VAO §4.2.

use crate::prelude::*;

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

pub fn new(cleared: Vec<Cleared>) -> Stage {
    let bytes_written = cleared.iter().map(|cleared| cleared.bytes).sum();
    Stage::new(&INFO, Work { bytes_written, ..Work::default() }, move |scope| {
        scope.copy(|encoder| {
            for Cleared { buffer, bytes } in &cleared {
                encoder.clear_buffer(buffer, 0, Some(*bytes));
            }
        });
    })
}
