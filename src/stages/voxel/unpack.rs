//! `voxel/unpack`: bit volumes to textures of a byte a voxel, for trilinear sampling. VAO §4.2.

use super::rows;
use crate::kit::{self, Bind, Buffer, Dispatch, Group, Kernel, Resources};
use crate::voxels::Voxels;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/unpack",
    about: "bits to bytes of a volume texture, through rows in a buffer",
    source: "VAO §4.2",
};

struct Volume {
    group: Group,
    dispatch: Dispatch,
    rows: Buffer,
    voxels: Voxels,
}

pub struct Unpack {
    kernel: Kernel,
    volumes: Vec<Volume>,
    bytes_read: u64,
}

/// What becomes bytes.
pub enum Packed {
    /// The volumes' bits.
    Bits,
    /// A word of 0 … 255 for each voxel, a buffer for each volume.
    Alphas(Vec<Buffer>),
}

impl Packed {
    fn of<'a>(&'a self, volumes: &'a [Voxels]) -> Vec<&'a Buffer> {
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
        let defs = [("ALPHA", i32::from(matches!(packed, Packed::Alphas(_))))];
        let packed = packed.of(volumes);
        let bytes_read = packed.iter().map(|buffer| buffer.size()).sum();
        let pairs = volumes.iter().zip(packed);
        let volumes: Vec<Volume> =
            pairs.map(|(voxels, packed)| Volume::new(resources, voxels, packed)).collect();
        let groups: Vec<&Group> = volumes.iter().take(1).map(|v| &v.group).collect();
        let kernel = Kernel::new(resources, INFO.name, (INFO.name, &defs[..]), &groups)?;
        Ok(Self { kernel, volumes, bytes_read })
    }
}

impl Volume {
    fn new(resources: &Resources<'_>, voxels: &Voxels, packed: &Buffer) -> Self {
        let rows = resources.storage(INFO.name, rows::bytes(voxels.grid.cells));
        let binds = [Bind::Uniform(&voxels.uniforms), Bind::Read(packed), Bind::Write(&rows)];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let [x, y, z] = voxels.grid.cells.map(u64::from);
        // An invocation for 32 voxels of a row.
        let workgroups = kit::linear_workgroups(x.div_ceil(32) * y * z);
        let dispatch = Dispatch::new(resources, INFO.name, &[&group], workgroups);
        Self { group, dispatch, rows, voxels: voxels.clone() }
    }
}

impl Stage for Unpack {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| {
            self.kernel.bind(pass);
            for volume in &self.volumes {
                volume.dispatch.run(pass);
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
