//! `voxel/mips`: the occupancy pyramid, as levels of the volumes' textures above the first. VAO §6.3.
//!
//! A cell of level 1 is full where any voxel of its 2 × 2 × 2 block or of the one-voxel border around it is. A trilinear sample
//! within the cell reads no other voxels: where the cell is empty, every sample in it is 0, and a ray may skip it. Cells of
//! higher levels are the OR of those below. Sizes are those of a texture's levels, max(1, ⌊n / 2⌋): the last cell along an axis
//! takes what is left over, so that voxel v lies in cell min(v ≫ level, size − 1).

use glam::UVec3;

use super::rows;
use crate::prelude::*;
use crate::voxels::Voxels;
use fathom_scene::Grid;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/mips",
    about: "occupancy pyramid: a cell is full where a trilinear sample within it may be above 0",
    source: "VAO §6.3",
};

/// Cells of a row that an invocation takes: of level 1, and of the levels above.
const PART: [u32; 2] = [16, 4];

shader_struct! {
    pub struct LevelUniforms {
        pub below: UVec3,
        /// Where the rows of the level below start, in words.
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

/// A volume's levels above the first: which, the dispatch, and where the level's rows start, bytes.
struct VolumeLevels {
    levels: Vec<(u32, Dispatch, u64)>,
    rows: Buffer,
    voxels: Voxels,
}

/// The volumes' textures must have all levels. Volumes of a single voxel have none above the first and are left out.
pub fn new(resources: &Resources<'_>, volumes: &[Voxels]) -> Result<Stage, GpuError> {
    let tall = |voxels: &&Voxels| rows_bytes(&voxels.grid) > 0;
    let volumes = volumes.iter().filter(tall).map(|voxels| VolumeLevels::new(resources, voxels));
    let volumes = volumes.collect::<Result<Vec<_>, _>>()?;
    let cells = volumes.iter().flat_map(|volume| {
        let grid = &volume.voxels.grid;
        levels(grid).map(|level| level_cells(grid, level).map(u64::from).iter().product::<u64>())
    });
    let work = Work {
        bytes_read: volumes.iter().map(|v| v.voxels.bits.size()).sum(),
        // To the rows and to the texture.
        bytes_written: 2 * cells.sum::<u64>(),
        ..Work::default()
    };
    let outputs = super::textures(volumes.iter().map(|v| &v.voxels), 1);
    let stage = Stage::new(&INFO, work, move |scope| {
        scope.compute(|pass| {
            for (_, dispatch, _) in volumes.iter().flat_map(|volume| &volume.levels) {
                dispatch.run(pass);
            }
        });
        scope.copy(|encoder| {
            for VolumeLevels { levels, rows, voxels } in &volumes {
                for (level, _, offset) in levels {
                    let to = (*level, level_cells(&voxels.grid, *level));
                    rows::copy(encoder, (rows, *offset), &voxels.texture, to);
                }
            }
        });
    });
    Ok(stage.dumps(outputs))
}

impl VolumeLevels {
    fn new(resources: &Resources<'_>, voxels: &Voxels) -> Result<Self, GpuError> {
        let grid = &voxels.grid;
        let rows = resources.storage(INFO.name, rows_bytes(grid));
        let mut offset = 0;
        let mut below = 0;
        let level = |level: u32| {
            let uniforms = LevelUniforms {
                below: UVec3::from(level_cells(grid, level - 1)),
                below_word: (below / 4) as u32,
                size: UVec3::from(level_cells(grid, level)),
                size_word: (offset / 4) as u32,
            };
            let uniforms = resources.uniform(INFO.name, &uniforms);
            let group = Bindings::new(&[&uniforms, &voxels.bits, &rows]);
            let defs = [("BASE", i32::from(level == 1))];
            let workgroups = workgroups(grid, level);
            let dispatch = Dispatch::new(resources, (INFO.name, &defs), &[&group], workgroups)?;
            let start = offset;
            below = start;
            offset += rows::bytes(level_cells(grid, level));
            Ok((level, dispatch, start))
        };
        let levels = levels(grid).map(level).collect::<Result<_, GpuError>>()?;
        Ok(Self { levels, rows: rows.clone(), voxels: voxels.clone() })
    }
}
