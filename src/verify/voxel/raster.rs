//! `voxel/slicemap-x`, `-y`, `-z`, what they make together, and `voxel/slice`, against samples in f64.

use super::subjects::{TILED_PX, VoxelScene, cells, voxels_of};
use crate::prelude::*;
use fathom_record::Adapter;
use fathom_reference::voxel::{MIN_SUBPIXELS, disagreements, sampled};
use fathom_stages::voxel::combine;
use fathom_stages::voxel::slice;
use fathom_stages::voxel::slicemap::{self, Rasterizer, SliceAxis};

const COMBINE: &str = "voxel/combine";
const SLICE: &str = "voxel/slice";

/// How far the controls' grids are moved.
const MOVED_VOXELS: f64 = 1.0 / 3.0;
const MOVED: &str = "grid moved by a third of a voxel";
const ALL_AXES: [usize; 3] = [0, 1, 2];

pub fn cases() -> Vec<Case> {
    let one_axis = SliceAxis::ALL.into_iter().flat_map(|axis| {
        let case = |name, rasterizer| {
            Case::new(axis.info().name, name, move |rig| {
                slicemap_against_samples(rig, axis, rasterizer)
            })
        };
        [
            case("bits along one axis", Rasterizer::Mixed),
            case("bits along one axis, by raster units alone", Rasterizer::Hardware),
        ]
    });
    let together = Case::new(COMBINE, "the slicemaps' voxels", |rig| {
        let bunnies = [VoxelScene::bunny(32)?, VoxelScene::bunny(64)?];
        let [soup, crates] = [VoxelScene::soup()?, VoxelScene::crates(64)?];
        let subjects: Vec<_> = [soup, crates].into_iter().chain(bunnies).collect();
        on_all_axes(rig, &subjects, |subject| three_way(rig, subject))
    });
    let slices = Case::new(SLICE, "the slices' voxels", |rig| {
        let subjects = [VoxelScene::soup()?, VoxelScene::bunny(32)?];
        on_all_axes(rig, &subjects, |subject| {
            subject.voxelized(rig, |geometry, parts| slice::new(rig, geometry, parts))
        })
    });
    one_axis.chain([together, slices]).collect()
}

/// A slicemap's voxels in the order of [`Grid::index`].
fn slices_of(words: &[u32], grid: &Grid, axis: SliceAxis) -> Vec<bool> {
    let [columns, rows, _] = axis.turn(grid.cells);
    let bit = |cell: [u32; 3]| {
        let [column, row, slice] = axis.turn(cell);
        let word = column + columns * (row + rows * (slice / 32));
        words[word as usize] >> (slice % 32) & 1 == 1
    };
    cells(grid).map(bit).collect()
}

fn slicemap_against_samples(rig: &Rig<'_>, axis: SliceAxis, rasterizer: Rasterizer) -> Checks {
    let axes = &[axis as usize];
    let found = |subject: &VoxelScene| voxelize_along(rig, subject, axis, rasterizer);
    let mut checks = Vec::new();
    for subject in [VoxelScene::soup()?, VoxelScene::bunny(32)?] {
        let name = subject.name;
        checks.push(
            against_samples(rig, std::slice::from_ref(&subject), axes, found)?
                .check(rig, format!("{name}: voxels that differ from samples at pixel centres")),
        );
    }
    checks.push(slanted_quads(rig, axes, found)?);
    // A centre on an edge belongs to one of the triangles that share it, whoever draws them: Vulkan, "Basic Polygon Rasterization".
    let not_once = |moved_px: f64| -> Result<f64> {
        let tiles = VoxelScene::tiles(axis, moved_px)?;
        let mut met = [[0; TILED_PX as usize]; TILED_PX as usize];
        for (cell, _) in cells(&tiles.grid).zip(found(&tiles)?).filter(|(_, found)| *found) {
            let [column, row, _] = axis.turn(cell).map(|k| k as usize);
            if let Some(met) = met.get_mut(row).and_then(|row| row.get_mut(column)) {
                *met += 1;
            }
        }
        let inner = met[1..].iter().flat_map(|row| &row[1..]);
        Ok(inner.filter(|met| **met != 1).count() as f64)
    };
    checks.push(
        Check::new(rig, "pixels that no or two of adjoining triangles meet")
            .within((0.0, "1"), not_once(0.0)?)
            .control("every second one a 16th of a pixel aside", not_once(1.0 / 16.0)?),
    );
    Ok(checks)
}

/// The voxels of one slicemap.
fn voxelize_along(
    rig: &Rig<'_>,
    subject: &VoxelScene,
    axis: SliceAxis,
    rasterizer: Rasterizer,
) -> Result<Vec<bool>> {
    let (geometry, part) = subject.upload(rig);
    let stages = slicemap::new(rig, &geometry, &[part], rasterizer)?;
    let stage = &stages[axis as usize];
    rig.run(&[stage])?;
    let slices = stage.first().ok_or_else(|| rig.empty("volumes"))?;
    Ok(slices_of(&rig.read(slices)?, &subject.grid, axis))
}

/// Voxels on which rasterizations and their samples disagree.
#[derive(Default)]
struct Disagreement {
    exact: f64,
    moved: f64,
    /// Voxels that are set.
    set: usize,
}

impl Disagreement {
    fn check(&self, rig: &Rig<'_>, what: String) -> Check {
        Check::new(rig, what).within((0.0, "1"), self.exact).control(MOVED, self.moved)
    }
}

/// Rasterizations of all subjects along some axes against their samples.
fn against_samples(
    rig: &Rig<'_>,
    subjects: &[VoxelScene],
    axes: &[usize],
    voxelized: impl Fn(&VoxelScene) -> Result<Vec<bool>>,
) -> Result<Disagreement> {
    let steps = subpixels(&rig.gpu.adapter);
    let mut all = Disagreement::default();
    for subject in subjects {
        let found = voxelized(subject)?;
        let against = |grid: &Grid| {
            disagreements(&found, &sampled(&subject.triangles(), grid, axes, steps)) as f64
        };
        all.exact += against(&subject.grid);
        all.moved += against(&subject.shifted(MOVED_VOXELS));
        all.set += found.iter().filter(|found| **found).count();
    }
    Ok(all)
}

/// Triangles that the grid's border clips at a slant, all in one check.
fn slanted_quads(
    rig: &Rig<'_>,
    axes: &[usize],
    voxelized: impl Fn(&VoxelScene) -> Result<Vec<bool>>,
) -> Result<Check> {
    let all = against_samples(rig, &VoxelScene::slanted()?, axes, voxelized)?;
    let name = "slanted quads of 1 to 16 grid edges: voxels that differ from samples";
    let steps = f64::from(subpixels(&rig.gpu.adapter));
    let check = all.check(rig, name.to_owned());
    Ok(check.with("voxels", all.set as f64).with("steps_per_pixel", steps))
}

/// Steps per pixel to which the adapter's rasterizer rounds corners. wgpu does not tell `subPixelPrecisionBits`: Mesa's
/// llvmpipe has 8 bits, SwiftShader 4, and 4 are the fewest that Vulkan allows.
fn subpixels(adapter: &Adapter) -> u32 {
    if adapter.name.starts_with("llvmpipe") { 256 } else { MIN_SUBPIXELS }
}

/// The voxels of three slicemaps and their OR.
fn three_way(rig: &Rig<'_>, subject: &VoxelScene) -> Result<Vec<bool>> {
    let (geometry, part) = subject.upload(rig);
    let parts = [part];
    let [x, y, z] = slicemap::new(rig, &geometry, &parts, Rasterizer::Mixed)?;
    let maps = [&x, &y, &z].map(|pass| pass.first().cloned());
    let [Some(a), Some(b), Some(c)] = maps else { return Err(rig.empty("volumes")) };
    let voxels = &parts[0].voxels;
    let combine = combine::new(rig, &[(voxels.clone(), [a, b, c])])?;
    rig.run(&[&x, &y, &z, &combine])?;
    Ok(voxels_of(&rig.read(&voxels.bits)?, &subject.grid))
}

/// Voxels of all three axes against samples, of each subject and of slanted quads.
fn on_all_axes(
    rig: &Rig<'_>,
    subjects: &[VoxelScene],
    voxelized: impl Fn(&VoxelScene) -> Result<Vec<bool>>,
) -> Checks {
    let mut checks = Vec::new();
    for subject in subjects {
        let resolution = subject.grid.cells.into_iter().max().unwrap_or(0);
        let what = "voxels that differ from samples on three axes";
        let what = format!("{} {resolution}: {what}", subject.name);
        let samples = against_samples(rig, std::slice::from_ref(subject), &ALL_AXES, &voxelized)?;
        checks.push(samples.check(rig, what));
    }
    checks.push(slanted_quads(rig, &ALL_AXES, voxelized)?);
    Ok(checks)
}
