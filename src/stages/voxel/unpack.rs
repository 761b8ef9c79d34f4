//! `voxel/unpack`: bit volumes to textures of a byte a voxel, for trilinear sampling. VAO §4.2.

use super::rows;
use crate::prelude::*;
use crate::voxels::Voxels;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/unpack",
    about: "bits to bytes of a volume texture, through rows in a buffer",
    source: "VAO §4.2",
};

/// What becomes bytes.
pub enum Packed {
    /// The volumes' bits.
    Bits,
    /// A word of 0 … 255 for each voxel, a buffer for each volume.
    Alphas(Vec<Buffer>),
}

impl Packed {
    fn buffers<'a>(&'a self, volumes: &'a [Voxels]) -> Vec<&'a Buffer> {
        match self {
            Packed::Bits => volumes.iter().map(|voxels| &voxels.bits).collect(),
            Packed::Alphas(alphas) => alphas.iter().collect(),
        }
    }
}

pub fn new(
    resources: &Resources<'_>,
    volumes: &[Voxels],
    packed: &Packed,
) -> Result<Stage, GpuError> {
    let defs = [("ALPHA", i32::from(matches!(packed, Packed::Alphas(_))))];
    let (mut dispatches, mut copies) = (Vec::new(), Vec::new());
    for (voxels, packed) in volumes.iter().zip(packed.buffers(volumes)) {
        let rows = resources.storage(INFO.name, rows::bytes(voxels.grid.cells));
        let group = Bindings::new(&[&voxels.uniforms, packed, &rows]);
        let [x, y, z] = voxels.grid.cells.map(u64::from);
        // An invocation for 32 voxels of a row.
        let workgroups = kit::linear_workgroups(x.div_ceil(32) * y * z);
        dispatches.push(Dispatch::new(resources, (INFO.name, &defs), &[&group], workgroups)?);
        copies.push((rows, voxels.texture.clone(), voxels.grid.cells));
    }
    let texels: u64 = volumes.iter().map(|voxels| voxels.grid.count()).sum();
    let work = Work {
        bytes_read: packed.buffers(volumes).iter().map(|buffer| buffer.size()).sum(),
        // To the rows and to the texture.
        bytes_written: 2 * texels,
        ..Work::default()
    };
    let stage = Stage::new(&INFO, work, move |scope| {
        Dispatch::pass(&dispatches, scope);
        scope.copy(|encoder| {
            for (rows, texture, cells) in &copies {
                rows::copy(encoder, (rows, 0), texture, (0, *cells));
            }
        });
    });
    Ok(stage.dumps(super::textures(volumes, 0)))
}
