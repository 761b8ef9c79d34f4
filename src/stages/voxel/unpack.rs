//! `voxel/unpack`: bit volumes to textures of a byte a voxel, for trilinear sampling. VAO §4.2.

use super::rows;
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::scene::Grid;
use crate::stages::kit::{self, Bind, Group, Resources};
use crate::stages::voxels::Voxels;
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "voxel/unpack",
    about: "bits to bytes of a volume texture, through rows in a buffer",
    source: "VAO §4.2",
};

/// Bytes of the buffer between the pass and the copy.
pub fn rows_bytes(grid: &Grid) -> u64 {
    rows::bytes(grid.cells)
}

/// Workgroups that a grid needs: an invocation for 32 voxels of a row.
pub fn workgroups(grid: &Grid) -> [u32; 3] {
    let [x, y, z] = grid.cells;
    kit::linear_workgroups(u64::from(x.div_ceil(32)) * u64::from(y) * u64::from(z))
}

struct Volume {
    group: Group,
    rows: wgpu::Buffer,
    voxels: Voxels,
}

pub struct Unpack {
    pipeline: wgpu::ComputePipeline,
    volumes: Vec<Volume>,
    bytes_read: u64,
}

/// What becomes bytes.
pub enum Packed {
    /// The volumes' bits.
    Bits,
    /// A word of 0 … 255 for each voxel, a buffer for each volume.
    Alphas(Vec<wgpu::Buffer>),
}

impl Packed {
    fn of<'a>(&'a self, volumes: &'a [Voxels]) -> Vec<&'a wgpu::Buffer> {
        match self {
            Packed::Bits => volumes.iter().map(|voxels| &voxels.bits).collect(),
            Packed::Alphas(alphas) => alphas.iter().collect(),
        }
    }
}

impl Unpack {
    pub fn new(
        resources: &Resources<'_>,
        volumes: &[Voxels],
        packed: &Packed,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let alpha = i32::from(matches!(packed, Packed::Alphas(_)));
        let shader = gpu.shader(INFO.name, &[("ALPHA", alpha)])?;
        let packed = packed.of(volumes);
        let bytes_read = packed.iter().map(|buffer| buffer.size()).sum();
        let volumes: Vec<Volume> = volumes
            .iter()
            .zip(packed)
            .map(|(voxels, packed)| {
                let rows = rows::buffer(resources, INFO.name, &voxels.grid);
                let binds =
                    [Bind::Uniform(&voxels.uniforms), Bind::Read(packed), Bind::Write(&rows)];
                Volume { group: Group::new(gpu, INFO.name, &binds), rows, voxels: voxels.clone() }
            })
            .collect();
        let groups: Vec<&Group> = volumes.iter().take(1).map(|v| &v.group).collect();
        Ok(Self {
            pipeline: kit::compute_pipeline(gpu, INFO.name, &shader, &groups),
            volumes,
            bytes_read,
        })
    }
}

impl Stage for Unpack {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| {
            pass.set_pipeline(&self.pipeline);
            for volume in &self.volumes {
                let [x, y, z] = workgroups(&volume.voxels.grid);
                pass.set_bind_group(0, &volume.group.group, &[]);
                pass.dispatch_workgroups(x, y, z);
            }
        });
        scope.copy(|encoder| {
            for Volume { rows, voxels, .. } in &self.volumes {
                rows::copy(encoder, (rows, 0), &voxels.texture, (0, voxels.grid.cells));
            }
        });
    }

    fn work(&self) -> Work {
        let texels = self.volumes.iter().map(|v| v.voxels.grid.count());
        Work {
            bytes_read: self.bytes_read,
            // To the rows and to the texture.
            bytes_written: 2 * texels.sum::<u64>(),
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        super::textures(self.volumes.iter().map(|v| &v.voxels), 0)
    }
}
