//! `ao/query` against closed forms and stored figures, and what `ao/march` counts; against ray casting `ao/march` is a row of `effects.toml`.

mod counters;
mod laws;
mod points;

use crate::prelude::*;
use fathom_pipelines::hsao::Horizon;
use fathom_reference::occlusion as reference;
use fathom_stages::ao::query::{self, SurfacePoint};
use fathom_stages::marching::*;
use fathom_stages::voxel::mips;

pub fn cases() -> Vec<Case> {
    [points::cases(), laws::cases(), counters::cases()].into_iter().flatten().collect()
}

/// Edge of a voxel in these cases, metres.
const VOXEL_M: f64 = 0.1;

/// A volume of so many voxels a side around the origin; those are `level`, 1 … 255, for whose centres `inside` holds.
fn volume(rig: &Rig<'_>, side: u32, level: u8, inside: impl Fn(DVec3) -> bool) -> Result<Voxels> {
    let edge_m = VOXEL_M * f64::from(side);
    let grid = Grid::around(DVec3::ZERO, edge_m, side).map_err(GpuError::Limit)?;
    let voxels = Voxels::new(rig, "verify voxels", &grid, true);
    let full = super::voxel::subjects::cells(&grid).map(|cell| inside(grid.center(cell)));
    voxels.write(rig, &full.map(|full| level * u8::from(full)).collect::<Vec<u8>>());
    Ok(voxels)
}

/// A volume of full voxels with its occupancy pyramid.
fn pyramid(rig: &Rig<'_>, side: u32, inside: impl Fn(DVec3) -> bool) -> Result<Voxels> {
    let volume = volume(rig, side, 255, inside)?;
    rig.run(&[&mips::new(rig, std::slice::from_ref(&volume))?])?;
    Ok(volume)
}

/// The pipeline's defaults with fewer rays, and r_max of ten voxels.
fn marching(change: impl FnOnce(&mut Marching)) -> Marching {
    let mut marching = Marching { rays: 32, r_max_m: 10.0 * VOXEL_M, ..Marching::default() };
    change(&mut marching);
    marching
}

/// A of points on the GPU, by `ao/query`.
fn query(
    rig: &Rig<'_>,
    volume: &Voxels,
    points: &[(DVec3, DVec3)],
    marching: &Marching,
) -> Result<Vec<f64>> {
    let points: Vec<SurfacePoint> = points
        .iter()
        .map(|(p, n)| SurfacePoint { position_m: p.as_vec3(), normal: n.as_vec3() })
        .collect();
    let stage = query::new(rig, std::slice::from_ref(volume), &points, marching)?;
    rig.run(&[&stage])?;
    let visibility: Vec<f32> = rig.read(&stage)?;
    Ok(visibility.iter().map(|v| 1.0 - f64::from(*v)).collect())
}
