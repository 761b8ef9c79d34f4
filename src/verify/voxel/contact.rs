//! `voxel/overlap` and `voxel/alpha` against separating axes in f64.

use super::subjects::{VoxelScene, voxels_of};
use crate::prelude::*;
use fathom_reference::voxel::{BORDERLINE_VOXELS, Corners, errors, gaps, triangles};
use fathom_stages::voxel::{alpha, overlap};

const OVERLAP: &str = "voxel/overlap";
const ALPHA: &str = "voxel/alpha";
/// How far the controls' grids are moved.
const MOVED_VOXELS: f64 = 0.02;
/// Triangles that all workgroups share. Each takes some seven turns.
const HUGE: u32 = 10_500;
/// Of the objects of the case of `voxel/alpha`. The first is not seen at all.
const ALPHAS: [f32; 3] = [0.0, 0.8, 0.3];

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(OVERLAP, "conservative", overlap),
        Case::new(OVERLAP, "more huge triangles than a loop has turns", many_huge),
        Case::new(OVERLAP, "voxels that a plane touches at edges and corners", touched),
        Case::new(ALPHA, "largest alpha of three objects", alpha),
    ]
}

fn overlap(rig: &Rig<'_>) -> Checks {
    let groups = [
        ("soup", vec![VoxelScene::soup()?]),
        ("bunny 32", vec![VoxelScene::bunny(32)?]),
        ("bunny 64", vec![VoxelScene::bunny(64)?]),
        ("slanted quads of 1 to 16 grid edges", VoxelScene::slanted()?),
    ];
    let mut checks = Vec::new();
    for (name, subjects) in groups {
        let subjects: Vec<_> = subjects.into_iter().map(|s| (s.triangles(), s)).collect();
        checks.extend(no_errors(rig, &format!("conservative, {name}"), &subjects)?);
    }
    Ok(checks)
}

/// Copies of a huge triangle, more than an adapter may make turns of an invocation's loops for, and one other at the end.
fn many_huge(rig: &Rig<'_>) -> Checks {
    let subject = VoxelScene::huge(HUGE)?;
    let triangles = subject.triangles();
    let kinds = vec![triangles[0], triangles[triangles.len() - 1]];
    let name = format!("{HUGE} huge triangles");
    no_errors(rig, &name, &[(kinds, subject)])
}

/// A voxel that a triangle only touches counts, whichever way the corners were rounded.
fn touched(rig: &Rig<'_>) -> Result<Check> {
    /// More than the corners' rounding, and less than what the stage allows for it.
    const TOUCHING_VOXELS: f64 = 1e-5;
    let (mut exact, mut moved) = (0.0, 0.0);
    for subject in VoxelScene::diagonals()? {
        let found = subject.voxelized(rig, |geometry, parts| overlap::new(rig, geometry, parts))?;
        let missed = |grid: &Grid| {
            let gaps = gaps(&subject.triangles(), grid);
            found.iter().zip(gaps).filter(|(found, gap)| !**found && *gap < TOUCHING_VOXELS).count()
        };
        exact += missed(&subject.grid) as f64;
        moved += missed(&subject.shifted(2.0)) as f64;
    }
    Ok(Check::new(rig, "touched voxels missed")
        .within((0.0, "1"), exact)
        .control("grid moved by two voxels", moved))
}

/// No false negatives and no false positives outside the borderline band, over subjects with the triangles that count.
fn no_errors(rig: &Rig<'_>, name: &str, subjects: &[(Vec<Corners>, VoxelScene)]) -> Checks {
    let (mut found, mut exact, mut moved) = (Vec::new(), Vec::new(), Vec::new());
    for (triangles, subject) in subjects {
        found.extend(subject.voxelized(rig, |geometry, parts| overlap::new(rig, geometry, parts))?);
        exact.extend(gaps(triangles, &subject.grid));
        moved.extend(gaps(triangles, &subject.shifted(MOVED_VOXELS)));
    }
    let [exact, perturbed] = [exact, moved].map(|gaps| errors(&found, &gaps));
    let control = "grid moved by 0.02 voxels";
    Ok(vec![
        Check::new(rig, format!("{name}: voxels missed"))
            .within((0.0, "1"), exact.false_negatives as f64)
            .control(control, perturbed.false_negatives as f64)
            .with("occupied_voxels", exact.occupied as f64)
            .with("borderline_voxels", exact.borderline as f64),
        Check::new(rig, format!("{name}: voxels too many"))
            .within((0.0, "1"), exact.false_positives as f64)
            .control(control, perturbed.false_positives as f64),
    ])
}

fn alpha(rig: &Rig<'_>) -> Result<Check> {
    let mut subject = VoxelScene::soup()?;
    split(&mut subject.scene);
    let (geometry, part) = subject.upload(rig);
    let bits = part.voxels.bits.clone();
    let stage = alpha::new(rig, &geometry, &[part])?;
    rig.run(&[&stage])?;
    let alphas = stage.alphas.first().ok_or_else(|| rig.empty("volumes"))?;
    let (alphas, bits) = (rig.read::<u32>(alphas)?, voxels_of(&rig.read(&bits)?, &subject.grid));
    let [exact, perturbed] = [ALPHAS, [0.0, 0.3, 0.8]].map(|of| largest_alphas(&subject, of));
    let wrong = |twin: &[Option<u32>]| {
        let known = twin.iter().enumerate().filter_map(|(i, alpha)| Some((i, (*alpha)?)));
        let differs = |(i, alpha): &(usize, u32)| alphas[*i] != *alpha || bits[*i] != (*alpha > 0);
        known.filter(differs).count() as f64
    };
    let borderline = exact.iter().filter(|alpha| alpha.is_none()).count();
    Ok(Check::new(rig, "voxels with another alpha or bit")
        .within((0.0, "1"), wrong(&exact))
        .control("alphas of two objects exchanged", wrong(&perturbed))
        .with("borderline_voxels", borderline as f64))
}

/// Deals the triangles of the one object to three with the alphas of [`ALPHAS`].
fn split(scene: &mut Scene) {
    let whole = scene.objects.remove(0);
    for (number, alpha) in ALPHAS.into_iter().enumerate() {
        let mut object = whole.clone();
        let triangles = whole.mesh.indices.chunks_exact(3).skip(number).step_by(3);
        object.mesh.indices = triangles.flatten().copied().collect();
        object.material.alpha = alpha;
        scene.objects.push(object);
    }
}

/// The largest alpha of the objects that touch each voxel, 0 … 255; none where one of them is borderline.
fn largest_alphas(subject: &VoxelScene, alphas: [f32; 3]) -> Vec<Option<u32>> {
    let of_object = |object: &Object| gaps(&triangles(std::slice::from_ref(object)), &subject.grid);
    let gaps: Vec<Vec<f64>> = subject.scene.objects.iter().map(of_object).collect();
    let voxel = |index: usize| {
        let mut near = gaps.iter().map(|gaps| gaps[index]).zip(alphas);
        near.try_fold(0, |largest: u32, (gap, alpha)| match gap {
            gap if gap.abs() <= BORDERLINE_VOXELS => None,
            gap if gap < 0.0 => Some(largest.max((255.0 * alpha).round() as u32)),
            _ => Some(largest),
        })
    };
    (0..subject.grid.count() as usize).map(voxel).collect()
}
