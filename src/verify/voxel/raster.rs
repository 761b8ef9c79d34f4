//! `voxel/slicemap-x`, `-y`, `-z`, what they make together, and `voxel/slice`, against samples in f64; and the law that a fragment's voxel is one
//! that the surface touches.

use super::subjects::{VoxelScene, cells, voxels_of};
use crate::{Case, Check, Checks, Result, Rig, VerifyError};
use fathom_record::Adapter;
use fathom_reference::voxel::{Contact, FEWEST_SUBPIXELS, disagreements, errors, gaps, sampled};
use fathom_scene::Grid;
use fathom_stages::voxel::combine;
use fathom_stages::voxel::slice;
use fathom_stages::voxel::slicemap::{self, Axis};

const COMBINE: &str = "voxel/combine";
const SLICE: &str = "voxel/slice";

pub fn cases() -> Vec<Case> {
    let one_axis = Axis::ALL.map(|axis| {
        Case::new(axis.info().name, "bits along one axis", move |rig| {
            slicemap_against_samples(rig, axis)
        })
    });
    let together = Case::new(COMBINE, "the slicemaps' voxels", |rig| {
        let mut checks = Vec::new();
        for subject in [VoxelScene::soup()?, VoxelScene::bunny(32)?, VoxelScene::bunny(64)?] {
            checks.extend(against_surface(COMBINE, rig, &subject, &three_way(rig, &subject)?));
        }
        checks.push(slanted_quads(rig, COMBINE, &[0, 1, 2], |s| three_way(rig, s))?);
        Ok(checks)
    });
    let slices = Case::new(SLICE, "the slices' voxels", |rig| {
        let mut checks = Vec::new();
        for subject in [VoxelScene::soup()?, VoxelScene::bunny(32)?] {
            checks.extend(against_surface(SLICE, rig, &subject, &sliced(rig, &subject)?));
        }
        checks.push(slanted_quads(rig, SLICE, &[0, 1, 2], |s| sliced(rig, s))?);
        Ok(checks)
    });
    one_axis.into_iter().chain([together, slices]).collect()
}

/// A slicemap's voxels in the order of [`Grid::index`].
fn slices_of(words: &[u32], grid: &Grid, axis: Axis) -> Vec<bool> {
    let [columns, rows, _] = axis.turned(grid);
    let bit = |cell: [u32; 3]| {
        let [column, row, slice] = axis.turn(cell);
        let word = column + columns * (row + rows * (slice / 32));
        words[word as usize] >> (slice % 32) & 1 == 1
    };
    cells(grid).map(bit).collect()
}

fn slicemap_against_samples(rig: &Rig<'_>, axis: Axis) -> Checks {
    let mut checks = Vec::new();
    for subject in [VoxelScene::soup()?, VoxelScene::bunny(32)?] {
        let found = one_way(rig, &subject, axis)?;
        let against = |grid: &Grid| differing(rig, &found, &subject, grid, &[axis as usize]);
        checks.push(
            Check::of(
                axis.info().name,
                format!("{}: voxels that differ from samples at pixel centres", subject.name),
            )
            .within((0.0, "1"), against(&subject.grid))
            .control("grid moved by a third of a voxel", against(&subject.moved(1.0 / 3.0))),
        );
    }
    let slanted = |subject: &VoxelScene| one_way(rig, subject, axis);
    checks.push(slanted_quads(rig, axis.info().name, &[axis as usize], slanted)?);
    Ok(checks)
}

/// The voxels of one slicemap.
fn one_way(rig: &Rig<'_>, subject: &VoxelScene, axis: Axis) -> Result<Vec<bool>> {
    let (geometry, part) = subject.upload(&rig.resources);
    let stage = slicemap::new(&rig.resources, &geometry, &[part], axis)?;
    rig.run(&[&stage])?;
    let Some(slices) = stage.first() else {
        return Err(VerifyError::Empty { stage: axis.info().name, what: "volumes".into() });
    };
    Ok(slices_of(&rig.read(slices)?, &subject.grid, axis))
}

/// Triangles that the grid's border clips at a slant, all in one check.
fn slanted_quads(
    rig: &Rig<'_>,
    stage: &'static str,
    axes: &[usize],
    voxelized: impl Fn(&VoxelScene) -> Result<Vec<bool>>,
) -> Result<Check> {
    let (mut exact, mut moved, mut set) = (0.0, 0.0, 0);
    for subject in VoxelScene::slanted()? {
        let found = voxelized(&subject)?;
        set += found.iter().filter(|found| **found).count();
        exact += differing(rig, &found, &subject, &subject.grid, axes);
        moved += differing(rig, &found, &subject, &subject.moved(1.0 / 3.0), axes);
    }
    let name = "slanted quads of 1 to 16 grid edges: voxels that differ from samples";
    let check = Check::of(stage, name.to_owned())
        .within((0.0, "1"), exact)
        .control("grid moved by a third of a voxel", moved);
    let steps = f64::from(subpixels(&rig.gpu.adapter));
    Ok(check.with("voxels", set as f64).with("steps_per_pixel", steps))
}

/// Steps per pixel to which the adapter's rasterizer rounds corners. wgpu does not tell `subPixelPrecisionBits`: Mesa's
/// llvmpipe has 8 bits, SwiftShader 4, and 4 are the fewest that Vulkan allows.
fn subpixels(adapter: &Adapter) -> u32 {
    if adapter.name.starts_with("llvmpipe") { 256 } else { FEWEST_SUBPIXELS }
}

/// Voxels on which a rasterization along some axes and its samples on a grid disagree.
fn differing(
    rig: &Rig<'_>,
    found: &[bool],
    subject: &VoxelScene,
    grid: &Grid,
    axes: &[usize],
) -> f64 {
    let steps = subpixels(&rig.gpu.adapter);
    let twin = sampled(&subject.triangles(), grid, axes, steps);
    disagreements(found, &twin) as f64
}

/// The voxels of three slicemaps and their OR.
fn three_way(rig: &Rig<'_>, subject: &VoxelScene) -> Result<Vec<bool>> {
    let (geometry, part) = subject.upload(&rig.resources);
    let parts = [part];
    let pass = |axis| slicemap::new(&rig.resources, &geometry, &parts, axis);
    let (x, y, z) = (pass(Axis::X)?, pass(Axis::Y)?, pass(Axis::Z)?);
    let maps = [&x, &y, &z].map(|pass| pass.first().cloned());
    let [Some(a), Some(b), Some(c)] = maps else {
        return Ok(Vec::new());
    };
    let voxels = &parts[0].voxels;
    let combine = combine::new(&rig.resources, &[(voxels.clone(), [a, b, c])])?;
    rig.run(&[&x, &y, &z, &combine])?;
    Ok(voxels_of(&rig.read(&voxels.bits)?, &subject.grid))
}

/// The voxels of passes of a slice each.
fn sliced(rig: &Rig<'_>, subject: &VoxelScene) -> Result<Vec<bool>> {
    subject.voxelized(rig, |geometry, parts| slice::new(&rig.resources, geometry, parts))
}

/// A three-way rasterization against samples, against the cubes that the surface touches, and, as figures alone, the voxels it
/// misses.
///
/// A fragment lies on the triangle, at the middle of its pixel and at its depth: a voxel that holds it touches the triangle.
/// Sub-pixel rounding moves the triangle by far less than the half voxel between that middle and the voxel's sides.
fn against_surface(
    stage: &'static str,
    rig: &Rig<'_>,
    subject: &VoxelScene,
    found: &[bool],
) -> Vec<Check> {
    let triangles = subject.triangles();
    let resolution = subject.grid.cells.into_iter().max().unwrap_or(0);
    let name = format!("{} {resolution}", subject.name);
    let moved = subject.moved(1.0 / 3.0);
    let against = |grid: &Grid| differing(rig, found, subject, grid, &[0, 1, 2]);
    let touched = |grid: &Grid| errors(found, &gaps(&triangles, grid, Contact::Cube));
    let [exact, perturbed] = [touched(&subject.grid), touched(&moved)];
    let thin = errors(found, &gaps(&triangles, &subject.grid, Contact::Lines));
    vec![
        Check::of(stage, format!("{name}: voxels that differ from samples on three axes"))
            .within((0.0, "1"), against(&subject.grid))
            .control("grid moved by a third of a voxel", against(&moved)),
        Check::of(stage, format!("{name}: voxels that no triangle touches"))
            .within((0.0, "1"), exact.false_positives as f64)
            .control("grid moved by a third of a voxel", perturbed.false_positives as f64)
            .with("touched_voxels", exact.occupied as f64)
            .with("borderline_voxels", exact.borderline as f64)
            .with("missed_share_of_touched", exact.false_negative_rate())
            .with("missed_share_of_thin", thin.false_negative_rate()),
    ]
}
