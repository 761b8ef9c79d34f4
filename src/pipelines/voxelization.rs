//! Volumes and the stages that fill them, as `voxelize` and `volume_ao` share them. VAO §4.

use super::settings::{self, Animation, Deform, Update, Voxel, VoxelMethod};
use fathom_gpu::kit::{Resources, When};
use fathom_gpu::{GpuError, Stage};
use fathom_scene::{Grid, Scene};
use fathom_stages::geometry::Geometry;
use fathom_stages::voxel::clear::{self, Cleared};
use fathom_stages::voxel::combine;
use fathom_stages::voxel::mips;
use fathom_stages::voxel::slice;
use fathom_stages::voxel::slicemap::{self, Rasterizer};
use fathom_stages::voxel::unpack::{self, Packed};
use fathom_stages::voxel::{VoxelPart, alpha, overlap};
use fathom_stages::voxels::Voxels;

/// Which volumes are made, and when they are filled.
pub struct Volumes {
    /// One for the scene, or one for each object in the scene's order.
    pub grids: Vec<Grid>,
    pub update: Update,
    /// The textures get all levels, and `voxel/mips` fills them.
    pub pyramid: bool,
}

/// Pushes the stage that moves the geometry, if it moves, and those that fill the volumes: into the frame, or where the
/// volumes are filled once among what runs once. Gives the volumes, in the order of the grids.
pub fn voxelize(
    resources: &Resources<'_>,
    geometry: &Geometry,
    scene: &Scene,
    settings: &Voxel,
    animation: &Animation,
    Volumes { grids, update, pyramid }: Volumes,
) -> Result<Vec<Voxels>, GpuError> {
    if let Some(deform) = settings::deform(resources, geometry, scene, animation)? {
        let once = update == Update::Once;
        resources.push_as(deform, if once { When::Both } else { When::EveryFrame });
    }
    let resources = &resources.with_size_hint(settings.size_name());
    let parts = parts(resources, geometry, &grids, settings, pyramid);
    let volumes: Vec<Voxels> = parts.iter().map(|part| part.voxels.clone()).collect();
    let filling = Filling { resources, geometry, parts: &parts, update };
    match settings.method {
        VoxelMethod::Slicemap => {
            filling.slicemap(rasterizer(settings, animation), settings.axes as usize)?;
        }
        VoxelMethod::Slice => filling.slice()?,
        VoxelMethod::Overlap => filling.overlap()?,
        VoxelMethod::MaxAlpha => filling.max_alpha()?,
    }
    // A single voxel has no levels.
    if pyramid && grids.iter().any(|grid| grid.count() > 1) {
        filling.push(mips::new(resources, &volumes)?);
    }
    Ok(volumes)
}

/// Triangles that are twisted or wave may grow beyond what the compute shader's integers hold: the raster units draw them all.
fn rasterizer(settings: &Voxel, animation: &Animation) -> Rasterizer {
    match animation.deform {
        Deform::None | Deform::Spin => settings.rasterizer,
        Deform::Twist | Deform::Wave => Rasterizer::Hardware,
    }
}

/// A volume for the whole scene, or one for each object.
fn parts(
    resources: &Resources<'_>,
    geometry: &Geometry,
    grids: &[Grid],
    settings: &Voxel,
    pyramid: bool,
) -> Vec<VoxelPart> {
    let indices = if settings.per_object {
        geometry.objects.clone()
    } else {
        let last = geometry.objects.last().map_or(0, |object| object.end);
        std::iter::once(0..last).collect()
    };
    let part = |(grid, indices)| VoxelPart {
        voxels: Voxels::new(resources, "voxels", grid, pyramid),
        indices,
    };
    grids.iter().zip(indices).map(part).collect()
}

/// Stages that fill volumes, and where they are pushed.
struct Filling<'a> {
    resources: &'a Resources<'a>,
    geometry: &'a Geometry,
    parts: &'a [VoxelPart],
    update: Update,
}

impl Filling<'_> {
    fn push<L>(&self, stage: Stage<L>) -> L {
        let once = self.update == Update::Once;
        self.resources.push_as(stage, if once { When::Once } else { When::EveryFrame })
    }

    /// VAO §4.2: three passes, one per axis, and their OR. What the axes behind the first so many would draw stays empty.
    fn slicemap(&self, rasterizer: Rasterizer, axes: usize) -> Result<(), GpuError> {
        let Self { resources, geometry, parts, .. } = *self;
        let [x, y, z] = slicemap::new(resources, geometry, parts, rasterizer)?;
        let maps = x.iter().zip(&**y).zip(&**z);
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
        self.push(clear::new(cleared));
        for pass in [x, y, z].into_iter().take(axes) {
            self.push(pass);
        }
        self.push(combine::new(resources, &volumes)?);
        self.unpack(&Packed::Bits)
    }

    /// VAO §4.1: a pass for each slice of each axis.
    fn slice(&self) -> Result<(), GpuError> {
        self.push(slice::new(self.resources, self.geometry, self.parts)?);
        self.unpack(&Packed::Bits)
    }

    fn overlap(&self) -> Result<(), GpuError> {
        let overlap = overlap::new(self.resources, self.geometry, self.parts)?;
        self.push(clear::new(overlap.cleared.clone()));
        self.push(overlap);
        self.unpack(&Packed::Bits)
    }

    /// VAO Fig. 6: opacities in place of bits.
    fn max_alpha(&self) -> Result<(), GpuError> {
        let alpha = alpha::new(self.resources, self.geometry, self.parts)?;
        self.push(clear::new(alpha.cleared.clone()));
        let alphas = self.push(alpha).alphas;
        self.unpack(&Packed::Alphas(alphas))
    }

    fn unpack(&self, packed: &Packed) -> Result<(), GpuError> {
        let volumes: Vec<Voxels> = self.parts.iter().map(|part| part.voxels.clone()).collect();
        self.push(unpack::new(self.resources, &volumes, packed)?);
        Ok(())
    }
}
