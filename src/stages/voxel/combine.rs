//! `voxel/combine`: OR of the three slicemaps, brought to one frame of reference. VAO §4.2.

use super::bit_volumes;
use crate::kit::{Bind, Buffer, Dispatch, Group, Kernel, Resources};
use crate::voxels::Voxels;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/combine",
    about: "OR of the slicemaps of three axes, turned to bits along x",
    source: "VAO §4.2",
};

/// Edge of the cube of voxels that a workgroup takes, as in the shader.
const CUBE: u32 = 32;

pub struct Combine {
    kernel: Kernel,
    volumes: Vec<(Dispatch, Voxels)>,
    /// Of all slicemaps.
    slicemap_bytes: u64,
}

impl Combine {
    /// Each volume with its slicemaps along x, y and z. The bit volumes must have been cleared.
    pub fn new(
        resources: &Resources<'_>,
        volumes: &[(Voxels, [Buffer; 3])],
    ) -> Result<Self, GpuError> {
        let group = |(voxels, [x, y, z]): &(Voxels, [Buffer; 3])| {
            let binds = [
                Bind::Uniform(&voxels.uniforms),
                Bind::Read(x),
                Bind::Read(y),
                Bind::Read(z),
                Bind::Write(&voxels.bits),
            ];
            Group::new(resources.gpu, INFO.name, &binds)
        };
        let groups: Vec<Group> = volumes.iter().map(group).collect();
        let first: Vec<&Group> = groups.iter().take(1).collect();
        let dispatch = |(group, (voxels, _)): (&Group, &(Voxels, _))| {
            let workgroups = voxels.grid.cells.map(|n| n.div_ceil(CUBE));
            (Dispatch::new(resources, INFO.name, &[group], workgroups), voxels.clone())
        };
        Ok(Self {
            kernel: Kernel::new(resources, INFO.name, INFO.name, &first)?,
            volumes: groups.iter().zip(volumes).map(dispatch).collect(),
            slicemap_bytes: volumes.iter().flat_map(|v| &v.1).map(Buffer::size).sum(),
        })
    }
}

impl Stage for Combine {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| {
            self.kernel.bind(pass);
            for (dispatch, _) in &self.volumes {
                dispatch.run(pass);
            }
        });
    }

    fn work(&self) -> Work {
        Work {
            bytes_read: self.slicemap_bytes,
            bytes_written: self.volumes.iter().map(|(_, v)| v.bits.size()).sum(),
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        bit_volumes(self.volumes.iter().map(|(_, voxels)| voxels))
    }
}
