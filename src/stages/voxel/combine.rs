//! `voxel/combine`: OR of the three slicemaps, brought to one frame of reference. VAO §4.2.

use super::bit_volumes;
use crate::prelude::*;
use crate::voxels::Voxels;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/combine",
    about: "OR of the slicemaps of three axes, turned to bits along x",
    source: "VAO §4.2",
};

/// Edge of the cube of voxels that a workgroup takes, as in the shader.
const CUBE: u32 = 32;

/// Each volume with its slicemaps along x, y and z. The bit volumes must have been cleared.
pub fn new(
    resources: &Resources<'_>,
    volumes: &[(Voxels, [Buffer; 3])],
) -> Result<Stage, GpuError> {
    let dispatch = |(voxels, [x, y, z]): &(Voxels, [Buffer; 3])| {
        let group = Bindings::new(&[&voxels.uniforms, x, y, z, &voxels.bits]);
        let workgroups = voxels.grid.cells.map(|n| n.div_ceil(CUBE));
        Dispatch::new(resources, INFO.name, &[&group], workgroups)
    };
    let dispatches = volumes.iter().map(dispatch).collect::<Result<Vec<_>, _>>()?;
    let work = Work {
        bytes_read: volumes.iter().flat_map(|(_, slicemaps)| slicemaps).map(Buffer::size).sum(),
        bytes_written: volumes.iter().map(|(voxels, _)| voxels.bits.size()).sum(),
        ..Work::default()
    };
    let outputs = bit_volumes(volumes.iter().map(|(voxels, _)| voxels));
    Ok(Dispatch::stage(dispatches, &INFO, work).dumps(outputs))
}
