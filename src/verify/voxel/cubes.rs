//! `voxel/view` against rays through all cubes in f64.

use super::subjects::{cells, random_voxels};
use crate::prelude::*;
use fathom_stages::voxel::view;

const STAGE: &str = "voxel/view";
const SIZE: [u32; 2] = [64, 48];
/// Rays that pass an edge within rounding may see either side.
const SHARE: f64 = 0.001;
/// Metres.
const DISTANCE_M: f64 = 1e-3;

pub fn cases() -> Vec<Case> {
    vec![Case::new(STAGE, "cubes seen from outside", check)]
}

fn check(rig: &Rig<'_>) -> Result<Check> {
    let grid = Grid { cells: [9, 6, 7], origin_m: DVec3::new(-2.03, -2.57, -6.01), voxel_m: 0.5 };
    let voxels = random_voxels(&mut Random::new(17), &grid, 0.15);
    let volume = Voxels::new(rig, "verify voxels", &grid, false);
    let values: Vec<u8> = voxels.iter().map(|full| u8::from(*full)).collect();
    volume.write(rig, &values);
    let view = rig::synthetic_view(SIZE, 0.0)?;
    let stage = view::new(rig, &Shared::new(rig, &view), &[volume], SIZE)?;
    let depth = rig.draw(&[&stage], &stage.depth, 0)?;

    let rays = rig::rays(&view);
    let wrong = |grid: &Grid| {
        let full = cells(grid).zip(&voxels).filter(|(_, full)| **full);
        let cubes: Vec<DVec3> = full.map(|(cell, _)| grid.center(cell)).collect();
        share(pixels(SIZE).map(|(x, y)| {
            let (origin, direction, length_m) = rays.ray(x, y);
            let expected = nearest(origin, direction, &cubes, grid.voxel_m / 2.0);
            let seen = depth.get((x, y));
            match expected.filter(|distance| *distance < length_m) {
                None => seen < 1.0,
                Some(distance) => {
                    let point = rays.unproject(f64::from(x) + 0.5, f64::from(y) + 0.5, seen);
                    point.distance(origin + direction * distance) > DISTANCE_M
                }
            }
        }))
    };
    let moved = Grid { origin_m: grid.origin_m + DVec3::new(0.01, 0.0, 0.0), ..grid };
    Ok(Check::new(rig, "share of pixels that see another place")
        .within((SHARE, "1"), wrong(&grid))
        .control("cubes moved by a centimetre", wrong(&moved)))
}

/// Distance to the nearest of cubes with these centres along a ray: the slab test on each.
fn nearest(origin: DVec3, direction: DVec3, cubes: &[DVec3], half_m: f64) -> Option<f64> {
    let enter = |center: &DVec3| {
        let [a, b] = [-half_m, half_m].map(|side| (*center + side - origin) / direction);
        let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
        (near < far && far > 0.0).then_some(near.max(0.0))
    };
    cubes.iter().filter_map(enter).min_by(f64::total_cmp)
}
