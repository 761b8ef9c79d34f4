//! `voxel/combine`: OR of the three slicemaps, brought to one frame of reference. VAO §4.2.

use super::bit_volumes;
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::scene::Grid;
use crate::stages::kit::{self, Bind, Group, Resources};
use crate::stages::voxels::Voxels;
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "voxel/combine",
    about: "OR of the slicemaps of three axes, turned to bits along x",
    source: "VAO §4.2",
};

/// Edge of the cube of voxels that a workgroup takes, as in the shader.
const CUBE: u32 = 32;

/// Workgroups that a grid needs.
pub fn workgroups(grid: &Grid) -> [u32; 3] {
    grid.cells.map(|n| n.div_ceil(CUBE))
}

pub struct Combine {
    pipeline: wgpu::ComputePipeline,
    volumes: Vec<(Group, Voxels)>,
    /// Of all slicemaps.
    slicemap_bytes: u64,
}

impl Combine {
    /// Each volume with its slicemaps along x, y and z. The bit volumes must have been cleared.
    pub fn new(
        resources: &Resources<'_>,
        volumes: &[(Voxels, [wgpu::Buffer; 3])],
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let shader = gpu.shader(INFO.name, &[])?;
        let slicemap_bytes = volumes.iter().flat_map(|v| &v.1).map(wgpu::Buffer::size);
        let slicemap_bytes = slicemap_bytes.sum();
        let volumes: Vec<_> = volumes
            .iter()
            .map(|(voxels, [x, y, z])| {
                let binds = [
                    Bind::Uniform(&voxels.uniforms),
                    Bind::Read(x),
                    Bind::Read(y),
                    Bind::Read(z),
                    Bind::Write(&voxels.bits),
                ];
                (Group::new(gpu, INFO.name, &binds), voxels.clone())
            })
            .collect();
        let groups: Vec<&Group> = volumes.iter().take(1).map(|(group, _)| group).collect();
        Ok(Self {
            pipeline: kit::compute_pipeline(gpu, INFO.name, &shader, &groups),
            volumes,
            slicemap_bytes,
        })
    }
}

impl Stage for Combine {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| {
            pass.set_pipeline(&self.pipeline);
            for (group, voxels) in &self.volumes {
                let [x, y, z] = workgroups(&voxels.grid);
                pass.set_bind_group(0, &group.group, &[]);
                pass.dispatch_workgroups(x, y, z);
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
