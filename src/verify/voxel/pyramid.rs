//! `voxel/mips`: against a twin that scatters voxels where the shader gathers them.

use super::subjects::{cells, plain, random_voxels};
use crate::prelude::*;
use fathom_stages::voxel::mips::{self, level_cells};

const STAGE: &str = "voxel/mips";
const SIZES: [[u32; 3]; 5] = [[64, 32, 32], [37, 20, 45], [5, 70, 33], [35, 3, 1], [1, 1, 1]];
/// Sparse enough that cells of every level stay empty somewhere.
const SHARE: f64 = 0.0005;

pub fn cases() -> Vec<Case> {
    vec![Case::new(STAGE, "occupancy pyramid of random voxels", check)]
}

struct Pyramid {
    grid: Grid,
    voxels: Vec<bool>,
    /// Levels above the first, as the GPU has them.
    levels: Vec<Vec<bool>>,
}

fn check(rig: &Rig<'_>) -> Result<Check> {
    let pyramids = pyramids(rig)?;
    let all = |border: i64| pyramids.iter().map(|p| against_twin(p, border)).sum();
    Ok(Check::new(rig, "cells that differ from the twin")
        .within((0.0, "1"), all(1))
        .control("twin without the border", all(0)))
}

fn pyramids(rig: &Rig<'_>) -> Result<Vec<Pyramid>, GpuError> {
    let mut random = Random::new(23);
    let mut made = Vec::new();
    for size in SIZES {
        let grid = plain(size);
        let mut voxels = random_voxels(&mut random, &grid, SHARE);
        // One at the end of every axis, where sizes leave something over.
        if let Some(last) = voxels.last_mut() {
            *last = true;
        }
        let volume = Voxels::new(rig, "verify voxels", &grid, true);
        let values: Vec<u8> = voxels.iter().map(|full| u8::from(*full) * 255).collect();
        volume.write(rig, &values);
        made.push((volume, voxels));
    }
    let volumes: Vec<Voxels> = made.iter().map(|(volume, _)| volume.clone()).collect();
    rig.run(&[&mips::new(rig, &volumes)?])?;
    let pyramid = |(volume, voxels): (Voxels, Vec<bool>)| {
        let count = volume.texture.mip_level_count();
        let level = |level| {
            let texels = read_volume(rig.gpu, &volume.texture, level)?.data;
            Ok(texels.into_iter().map(|v| v > 0.5).collect())
        };
        let levels = (1..count).map(level).collect::<Result<_, GpuError>>()?;
        Ok(Pyramid { grid: volume.grid, voxels, levels })
    };
    made.into_iter().map(pyramid).collect()
}

/// The cell of a level that holds a voxel.
fn cell_of(voxel: [u32; 3], grid: &Grid, level: u32) -> [u32; 3] {
    let size = level_cells(grid, level);
    [0, 1, 2].map(|k| (voxel[k] >> level).min(size[k] - 1))
}

fn against_twin(pyramid: &Pyramid, border: i64) -> f64 {
    let grid = &pyramid.grid;
    let twin = |level: u32| {
        let size = plain(level_cells(grid, level));
        let mut full = vec![false; size.count() as usize];
        for (voxel, _) in cells(grid).zip(&pyramid.voxels).filter(|(_, full)| **full) {
            for near in around(voxel, grid, border) {
                full[size.index(cell_of(near, grid, level)) as usize] = true;
            }
        }
        full
    };
    let levels = pyramid.levels.iter().zip(1..);
    levels.map(|(found, level)| differing(found, &twin(level))).sum()
}

/// Voxels of the grid within `border` of another one.
fn around(voxel: [u32; 3], grid: &Grid, border: i64) -> impl Iterator<Item = [u32; 3]> + use<> {
    let n = grid.cells.map(i64::from);
    let at = voxel.map(i64::from);
    let range = move |k: usize| (at[k] - border).max(0)..=(at[k] + border).min(n[k] - 1);
    range(2).flat_map(move |z| {
        range(1).flat_map(move |y| range(0).map(move |x| [x, y, z].map(|c| c as u32)))
    })
}
