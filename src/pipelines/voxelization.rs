//! Volumes and the stages that fill them, as `voxelize` and `volume_ao` share them. VAO §4.

use super::settings::{Animation, Method, Voxel};
use crate::gpu::{ClockPlan, Demand, Encode, FrameTimer, Gpu, GpuError, SubmitCost};
use crate::scene::{Camera, Grid, Scene};
use crate::stages::Stage;
use crate::stages::geometry::Geometry;
use crate::stages::kit::Resources;
use crate::stages::voxel::Part;
use crate::stages::voxel::alpha::Alpha;
use crate::stages::voxel::clear::{Clear, Cleared};
use crate::stages::voxel::combine::{self, Combine};
use crate::stages::voxel::overlap::Overlap;
use crate::stages::voxel::slicemap::{Axis, Slicemap};
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
            Method::Slice => {
                return Err(GpuError::Limit(
                    "voxel.method slice is still to come".into(),
                ));
            }
            Method::Overlap => overlap(resources, geometry, &parts, false)?,
            Method::OverlapThin => overlap(resources, geometry, &parts, true)?,
            Method::MaxAlpha => max_alpha(resources, geometry, &parts)?,
        };
        let _ = &mut stages;
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
        vec![0..last]
    };
    let part = |(grid, indices)| Part {
        voxels: Voxels::new(resources, "voxels", grid, pyramid),
        indices,
    };
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

/// Runs stages as one untimed frame: those of volumes that are made once.
///
/// # Errors
/// What the GPU reports.
pub fn run_once(gpu: &Gpu, stages: &[&dyn Stage]) -> Result<(), GpuError> {
    let frame: Vec<&dyn Encode> = stages.iter().map(|stage| *stage as &dyn Encode).collect();
    let plan = ClockPlan::fenced(SubmitCost::default());
    // The bound is on timed passes, of which there are none.
    let mut timer = FrameTimer::new(gpu, plan, 1)?;
    timer.untimed(gpu, &frame).map(drop)
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
    Ok(grids.iter().fold(demand, |demand, grid| {
        of_grid(demand, grid, settings, pyramid)
    }))
}

fn of_grid(demand: Demand, grid: &Grid, settings: &Voxel, _pyramid: bool) -> Demand {
    let cells = grid.cells.map(u64::from);
    let name = settings.size_name();
    let mut demand = demand
        .texture_3d(name, cells)
        .storage(&format!("{name}: bit volume"), grid.words() * 4)
        .storage(
            &format!("{name}: rows of voxel/unpack"),
            unpack::rows_bytes(grid),
        )
        .dispatch("voxel/unpack", unpack::workgroups(grid).map(u64::from));
    if settings.method == Method::Slicemap {
        demand = demand.dispatch("voxel/combine", combine::workgroups(grid).map(u64::from));
        for axis in Axis::ALL {
            let [columns, rows, _] = axis.turned(grid).map(u64::from);
            demand = demand
                .texture_2d(
                    &format!("{name}: viewport of voxel/slicemap"),
                    columns,
                    rows,
                )
                .storage(&format!("{name}: slicemap"), axis.slicemap_bytes(grid));
        }
    }
    demand
}
