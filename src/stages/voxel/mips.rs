//! `voxel/mips`: the occupancy pyramid, as levels of the volumes' textures above the first. VAO §6.3.
//!
//! A cell of level 1 is full where any voxel of its 2 × 2 × 2 block or of the one-voxel border around it is. A trilinear sample
//! within the cell reads no other voxels: where the cell is empty, every sample in it is 0, and a ray may skip it. Cells of
//! higher levels are the OR of those below. Sizes are those of a texture's levels, max(1, ⌊n / 2⌋): the last cell along an axis
//! takes what is left over, so that voxel v lies in cell min(v ≫ level, size − 1).

use glam::UVec3;

use super::rows;
use crate::kit::{self, Bind, Buffer, Dispatch, Group, Kernel, Resources};
use crate::shader_struct;
use crate::voxels::Voxels;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;
use fathom_scene::Grid;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/mips",
    about: "occupancy pyramid: a cell is full where a trilinear sample within it may be above 0",
    source: "VAO §6.3",
};

/// Cells of a row that an invocation takes: of level 1, and of the levels above.
const PART: [u32; 2] = [16, 4];

shader_struct! {
    /// `Level` in `shaders/voxel/mips.wgsl`.
    pub struct LevelUniforms {
        pub below: UVec3,
        pub below_word: u32,
        pub size: UVec3,
        pub size_word: u32,
    }
}

/// Cells of a level of a grid.
pub fn level_cells(grid: &Grid, level: u32) -> [u32; 3] {
    grid.cells.map(|n| (n >> level).max(1))
}

/// Levels above the first.
fn levels(grid: &Grid) -> std::ops::RangeInclusive<u32> {
    1..=grid.cells.into_iter().max().unwrap_or(1).ilog2()
}

/// Bytes of the buffer between the passes and the copies.
fn rows_bytes(grid: &Grid) -> u64 {
    levels(grid).map(|level| rows::bytes(level_cells(grid, level))).sum()
}

/// Workgroups that a level of a grid needs.
fn workgroups(grid: &Grid, level: u32) -> [u32; 3] {
    let [x, y, z] = level_cells(grid, level);
    let part = PART[usize::from(level > 1)];
    kit::linear_workgroups(u64::from(x.div_ceil(part)) * u64::from(y) * u64::from(z))
}

struct Level {
    group: Group,
    dispatch: Dispatch,
    level: u32,
    /// Where its rows start, bytes.
    offset: u64,
}

struct Volume {
    levels: Vec<Level>,
    rows: Buffer,
    voxels: Voxels,
}

pub struct Mips {
    /// Of level 1 and of the levels above.
    kernels: [Kernel; 2],
    volumes: Vec<Volume>,
}

impl Mips {
    /// The volumes' textures must have all levels. Volumes of a single voxel have none above the first and are left out.
    pub fn new(resources: &Resources<'_>, volumes: &[Voxels]) -> Result<Self, GpuError> {
        let tall = |voxels: &&Voxels| rows_bytes(&voxels.grid) > 0;
        let volumes: Vec<Volume> =
            volumes.iter().filter(tall).map(|voxels| Volume::new(resources, voxels)).collect();
        let mut levels = volumes.iter().flat_map(|volume| &volume.levels);
        let groups: Vec<&Group> = levels.next().map(|level| &level.group).into_iter().collect();
        let kernel =
            |base| Kernel::new(resources, INFO.name, (INFO.name, &[("BASE", base)][..]), &groups);
        Ok(Self { kernels: [kernel(1)?, kernel(0)?], volumes })
    }
}

impl Volume {
    fn new(resources: &Resources<'_>, voxels: &Voxels) -> Self {
        let grid = &voxels.grid;
        let rows = resources.storage(INFO.name, rows_bytes(grid));
        let mut offset = 0;
        let mut below = 0;
        let levels = levels(grid).map(|level| {
            let uniforms = LevelUniforms {
                below: UVec3::from(level_cells(grid, level - 1)),
                below_word: (below / 4) as u32,
                size: UVec3::from(level_cells(grid, level)),
                size_word: (offset / 4) as u32,
            };
            let uniforms = resources.uniform(INFO.name, &uniforms);
            let binds = [Bind::Uniform(&uniforms), Bind::Read(&voxels.bits), Bind::Write(&rows)];
            let group = Group::new(resources.gpu, INFO.name, &binds);
            let workgroups = workgroups(grid, level);
            let dispatch = Dispatch::new(resources, INFO.name, &[&group], workgroups);
            let made = Level { group, dispatch, level, offset };
            below = offset;
            offset += rows::bytes(level_cells(grid, level));
            made
        });
        Self { levels: levels.collect(), rows: rows.clone(), voxels: voxels.clone() }
    }
}

impl Stage for Mips {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| {
            for level in self.volumes.iter().flat_map(|volume| &volume.levels) {
                self.kernels[usize::from(level.level > 1)].run(pass, &level.dispatch);
            }
        });
        scope.copy(|encoder| {
            for Volume { levels, rows, voxels } in &self.volumes {
                for Level { level, offset, .. } in levels {
                    let to = (*level, level_cells(&voxels.grid, *level));
                    rows::copy(encoder, (rows, *offset), &voxels.texture, to);
                }
            }
        });
    }

    fn work(&self) -> Work {
        let bits = self.volumes.iter().map(|v| v.voxels.bits.size());
        let cells = self.volumes.iter().flat_map(|volume| {
            let grid = &volume.voxels.grid;
            levels(grid)
                .map(|level| level_cells(grid, level).map(u64::from).iter().product::<u64>())
        });
        Work {
            bytes_read: bits.sum(),
            // To the rows and to the texture.
            bytes_written: 2 * cells.sum::<u64>(),
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        super::textures(self.volumes.iter().map(|v| &v.voxels), 1)
    }
}
