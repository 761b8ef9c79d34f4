//! Volumes and the stages that fill them, as `voxelize` and `volume_ao` share them. VAO §4.

use super::settings::{Animation, Method, Voxel};
use crate::gpu::{Demand, GpuError};
use crate::record::Work;
use crate::scene::{Camera, Grid, Scene};
use crate::stages::Stage;
use crate::stages::geometry::{self, Geometry};
use crate::stages::kit::Resources;
use crate::stages::voxel::Part;
use crate::stages::voxel::alpha::{self, Alpha};
use crate::stages::voxel::clear::{Clear, Cleared};
use crate::stages::voxel::combine::{self, Combine};
use crate::stages::voxel::mips::{self, Mips};
use crate::stages::voxel::overlap::Overlap;
use crate::stages::voxel::slice::{self, Slice};
use crate::stages::voxel::slicemap::{Axis, Slicemap};
use crate::stages::voxel::triangles;
use crate::stages::voxel::unpack::{self, Packed, Unpack};
use crate::stages::voxels::Voxels;

/// Volumes of a scene and what fills them in a frame.
pub struct Voxelization {
    /// One for the scene, or one for each object in the scene's order.
    pub volumes: Vec<Voxels>,
    /// In frame order.
    stages: Vec<Box<dyn Stage>>,
}

impl Voxelization {
    /// `pyramid`: the textures get all levels, and `voxel/mips` fills them.
    ///
    /// # Errors
    /// Settings that give no grid, and shaders that do not link.
    pub fn new(
        resources: &Resources<'_>,
        geometry: &Geometry,
        scene: &Scene,
        camera: &Camera,
        settings: &Voxel,
        animation: &Animation,
        pyramid: bool,
    ) -> Result<Self, GpuError> {
        let grids = settings.grids(scene, camera, animation);
        let grids = grids.map_err(GpuError::Limit)?;
        let parts = parts(resources, geometry, &grids, settings, pyramid);
        let volumes: Vec<Voxels> = parts.iter().map(|part| part.voxels.clone()).collect();
        let mut stages = match settings.method {
            Method::Slicemap => slicemap(resources, geometry, &parts)?,
            Method::Slice => slice(resources, geometry, &parts)?,
            Method::Overlap => overlap(resources, geometry, &parts, false)?,
            Method::OverlapThin => overlap(resources, geometry, &parts, true)?,
            Method::MaxAlpha => max_alpha(resources, geometry, &parts)?,
        };
        // A single voxel has no levels.
        if pyramid && grids.iter().any(|grid| grid.count() > 1) {
            stages.push(Box::new(Mips::new(resources, &volumes)?));
        }
        Ok(Self { volumes, stages })
    }

    /// In frame order.
    pub fn stages(&self) -> Vec<&dyn Stage> {
        self.stages.iter().map(AsRef::as_ref).collect()
    }
}

/// A volume for the whole scene, or one for each object.
fn parts(
    resources: &Resources<'_>,
    geometry: &Geometry,
    grids: &[Grid],
    settings: &Voxel,
    pyramid: bool,
) -> Vec<Part> {
    let indices = if settings.per_object {
        geometry.objects.clone()
    } else {
        let last = geometry.objects.last().map_or(0, |object| object.end);
        std::iter::once(0..last).collect()
    };
    let part =
        |(grid, indices)| Part { voxels: Voxels::new(resources, "voxels", grid, pyramid), indices };
    grids.iter().zip(indices).map(part).collect()
}

type Stages = Vec<Box<dyn Stage>>;

/// VAO §4.2: three passes, one per axis, and their OR.
fn slicemap(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[Part],
) -> Result<Stages, GpuError> {
    let make = |axis| Slicemap::new(resources, geometry, parts, axis);
    let [x, y, z] = [make(Axis::X)?, make(Axis::Y)?, make(Axis::Z)?];
    let maps = x.slicemaps().zip(y.slicemaps()).zip(z.slicemaps());
    let volumes: Vec<_> = parts
        .iter()
        .zip(maps)
        .map(|(part, ((x, y), z))| (part.voxels.clone(), [x.clone(), y.clone(), z.clone()]))
        .collect();
    let cleared = volumes
        .iter()
        .flat_map(|(voxels, maps)| maps.iter().chain([&voxels.bits]))
        .map(Cleared::from)
        .collect();
    let combine = Combine::new(resources, &volumes)?;
    Ok(vec![
        Box::new(Clear::new(cleared)),
        Box::new(x),
        Box::new(y),
        Box::new(z),
        Box::new(combine),
        unpack(resources, parts, &Packed::Bits)?,
    ])
}

/// VAO §4.1: a pass for each slice of each axis.
fn slice(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[Part],
) -> Result<Stages, GpuError> {
    Ok(vec![
        Box::new(Slice::new(resources, geometry, parts)?),
        unpack(resources, parts, &Packed::Bits)?,
    ])
}

fn overlap(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[Part],
    thin: bool,
) -> Result<Stages, GpuError> {
    let overlap = Overlap::new(resources, geometry, parts, thin)?;
    Ok(vec![
        Box::new(Clear::new(overlap.cleared())),
        Box::new(overlap),
        unpack(resources, parts, &Packed::Bits)?,
    ])
}

/// VAO Fig. 6: opacities in place of bits.
fn max_alpha(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[Part],
) -> Result<Stages, GpuError> {
    let alpha = Alpha::new(resources, geometry, parts)?;
    let alphas = Packed::Alphas(alpha.alphas().cloned().collect());
    Ok(vec![
        Box::new(Clear::new(alpha.cleared())),
        Box::new(alpha),
        unpack(resources, parts, &alphas)?,
    ])
}

fn unpack(
    resources: &Resources<'_>,
    parts: &[Part],
    packed: &Packed,
) -> Result<Box<dyn Stage>, GpuError> {
    let volumes: Vec<Voxels> = parts.iter().map(|part| part.voxels.clone()).collect();
    Ok(Box::new(Unpack::new(resources, &volumes, packed)?))
}

/// What volumes and their stages ask of an adapter; an error names the parameter at fault.
///
/// # Errors
/// Settings that give no grid.
pub fn demand(
    demand: Demand,
    scene: &Scene,
    camera: &Camera,
    settings: &Voxel,
    animation: &Animation,
    pyramid: bool,
) -> Result<Demand, String> {
    let grids = settings.grids(scene, camera, animation)?;
    let (vertices, indices) = geometry::buffer_bytes(scene);
    let triangles = indices / 12;
    let mut demand = demand;
    if is_by_triangle(settings.method) {
        demand = demand
            .storage("scene vertices", vertices)
            .storage("scene indices", indices)
            .storage("voxel queue", triangles::queue_bytes(triangles))
            .holds("voxel queue", triangles::queue_bytes(triangles))
            .dispatch("voxel/overlap", triangles::workgroups(triangles).map(u64::from));
    }
    for grid in &grids {
        demand = demand.and(of_grid(grid, settings));
        if pyramid {
            demand = demand.and(of_pyramid(grid, settings));
        }
    }
    Ok(demand)
}

fn is_by_triangle(method: Method) -> bool {
    matches!(method, Method::Overlap | Method::OverlapThin | Method::MaxAlpha)
}

fn of_grid(grid: &Grid, settings: &Voxel) -> Demand {
    let name = settings.size_name();
    let demand = Demand::new()
        .texture_3d(name, grid.cells.map(u64::from))
        .indexed(name, grid.count())
        .holds(name, grid.count() + grid.words() * 4 + unpack::rows_bytes(grid))
        .takes(name, filling(grid))
        .storage(&format!("{name}: bit volume"), grid.words() * 4)
        .storage(&format!("{name}: rows of voxel/unpack"), unpack::rows_bytes(grid))
        .dispatch("voxel/unpack", unpack::workgroups(grid).map(u64::from));
    match settings.method {
        Method::Slicemap => Axis::ALL.into_iter().fold(
            demand.dispatch("voxel/combine", combine::workgroups(grid).map(u64::from)),
            |demand, axis| {
                let [columns, rows, _] = axis.turned(grid).map(u64::from);
                demand
                    .holds(name, columns * rows + axis.slicemap_bytes(grid))
                    .texture_2d(&format!("{name}: viewport of {}", axis.name()), columns, rows)
                    .storage(
                        &format!("{name}: slices of {}", axis.name()),
                        axis.slicemap_bytes(grid),
                    )
            },
        ),
        Method::Slice => demand
            .holds(name, grid.count() * Axis::ALL.len() as u64)
            .dispatch("voxel/slice", slice::workgroups(grid).map(u64::from)),
        Method::Overlap | Method::OverlapThin => demand,
        Method::MaxAlpha => demand
            .holds(name, alpha::alphas_bytes(grid))
            .storage(&format!("{name}: alphas of voxel/alpha"), alpha::alphas_bytes(grid)),
    }
}

/// Every voxel is cleared, written as a byte of a row, and copied.
fn filling(grid: &Grid) -> Work {
    Work {
        bytes_written: grid.words() * 4 + unpack::rows_bytes(grid) + grid.count(),
        ..Work::default()
    }
}

fn of_pyramid(grid: &Grid, settings: &Voxel) -> Demand {
    let name = settings.size_name();
    // All levels above the first have a seventh of its texels.
    Demand::new()
        .holds(name, grid.count() / 7 + mips::rows_bytes(grid))
        .storage(&format!("{name}: rows of voxel/mips"), mips::rows_bytes(grid))
        .dispatch("voxel/mips", mips::workgroups(grid, 1).map(u64::from))
}
