//! Settings that several pipelines share.

use glam::{DVec2, DVec3, UVec2, Vec2};
use serde::{Deserialize, Serialize};

use fathom_base::choices;
use fathom_base::parameter::{ParamError, check_range};
use fathom_base::settings;
use fathom_gpu::GpuError;
use fathom_gpu::kit::Resources;
use fathom_scene::{Bounds, Camera, Grid, Light, Motion, Scene, VolumeFile, Water};
use fathom_stages::ao::glass::GlassUniforms;
use fathom_stages::bilateral::BilateralUniforms;
use fathom_stages::geometry::Geometry;
pub use fathom_stages::marching::{Attenuation, R_MAX_SHARE};
use fathom_stages::scene::deform;
use fathom_stages::transfer::map::MapUniforms;
use fathom_stages::voxel::slicemap::Rasterizer;
use fathom_stages::{Stage, uniforms};

settings! {
    /// Pixels of the main viewport. Where a pipeline gives no other: 600 × 600, as in VAO Fig. 8.
    pub struct Viewport {
        /// Columns.
        width: u32 = 600 => 1 ..= 1_000_000, "px";
        /// Rows.
        height: u32 = 600 => 1 ..= 1_000_000, "px";
    }
}

impl Viewport {
    #[must_use]
    pub fn upscaled(&self, factor: u32) -> Self {
        Self { width: self.width * factor, height: self.height * factor }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VoxelMethod {
    /// One pass per axis, bits of slices set by atomics. VAO §4.2.
    Slicemap,
    /// One pass per slice and axis. VAO §4.1.
    Slice,
    /// Triangle-parallel compute, separating-axis test, every voxel that a triangle touches.
    Overlap,
    /// Triangle-parallel compute that stores the largest alpha of the touching triangles. VAO Fig. 6.
    MaxAlpha,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Update {
    /// Voxelization is part of every frame.
    EveryFrame,
    /// The volume is filled when the pipeline is built, and in no frame.
    Once,
}

settings! {
    /// The volume and how it is filled.
    pub struct Voxel {
        /// How triangles become voxels.
        method: VoxelMethod = VoxelMethod::Slicemap;
        /// Who rasterizes the triangles of slicemaps. Where they are twisted or wave, it is the hardware in any case.
        rasterizer: Rasterizer = Rasterizer::Mixed;
        /// Axes along which slicemaps are drawn: of less than three, x and y come first. VAO §4.1: one alone leaves holes.
        axes: u32 = 3 => 1 ..= 3, "1";
        /// When the volume is filled.
        update: Update = Update::EveryFrame;
        /// Voxels along the longest side of the scene. VAO §6.4: 128 to 256.
        resolution: u32 = 128 => 4 ..= 4096, "1";
        /// A volume for each object, on a grid of its own, in place of one for the scene. VAO §3.
        per_object: bool = false;
        /// Voxels along x, y and z, set by hand with origin and edge; [0, 0, 0] fits the grid to the scene.
        cells: [u32; 3] = [0; 3] => 0 ..= 4096, "1";
        /// Corner of smallest coordinates of a grid set by hand.
        origin_m: [f64; 3] = [0.0; 3] => -1e5 ..= 1e5, "m";
        /// Edge of a voxel of a grid set by hand.
        voxel_m: f64 = 0.0 => 0.0 ..= 1e5, "m";
    }
}

impl Voxel {
    /// # Errors
    /// A grid set by hand that lacks cells or their size.
    pub fn consistent(&self) -> Result<(), ParamError> {
        if self.cells == [0; 3] {
            return Ok(());
        }
        for n in self.cells {
            check_range("voxel.cells", f64::from(n), 1.0, 4096.0)?;
        }
        check_range("voxel.voxel_m", self.voxel_m, 1e-6, 1e5)
    }

    /// The parameter that sets the size of the volume, for messages.
    pub fn size_name(&self) -> &'static str {
        if self.cells == [0; 3] { "voxel.resolution" } else { "voxel.cells" }
    }

    /// The grid of the whole scene, or one for each object in the scene's order, with room for the geometry's motion.
    ///
    /// # Errors
    /// Voxels by the object where the grid is set by hand; a scene without geometry; a grid that holds nothing of the scene.
    pub fn grids(&self, scene: &Scene, animation: &Animation) -> Result<Vec<Grid>, ParamError> {
        let by_hand = self.cells != [0; 3];
        if self.per_object && by_hand {
            let fault = "voxel.per_object fits a grid to each object: voxel.cells must be 0";
            return Err(ParamError::Unfit(fault.into()));
        }
        if self.per_object {
            let fit = |object: &fathom_scene::Object| {
                Grid::fit(&animation.motion_bounds(&object.mesh.bounds()), self.resolution).map_err(
                    |fault| ParamError::Unfit(format!("object `{}`: {fault}", object.name)),
                )
            };
            return scene.objects.iter().map(fit).collect();
        }
        let bounds = animation.bounds(scene);
        let grid = if by_hand {
            let grid = Grid {
                cells: self.cells,
                origin_m: DVec3::from(self.origin_m),
                voxel_m: self.voxel_m,
            };
            holds_some(&grid, &bounds)?;
            grid
        } else {
            Grid::fit(&bounds, self.resolution)?
        };
        Ok(vec![grid])
    }
}

/// An error for a grid beside the scene: everything in it would be empty.
fn holds_some(grid: &Grid, scene: &Bounds) -> Result<(), String> {
    if grid.bounds().meets(scene) {
        return Ok(());
    }
    let corners = |bounds: &Bounds| {
        let [min, max] = [bounds.min, bounds.max].map(|p| p.to_array());
        format!("{min:.3?} to {max:.3?} m")
    };
    Err(format!(
        "voxel.cells, voxel.origin_m and voxel.voxel_m place the grid at {}, and the scene lies at {}: they must overlap",
        corners(&grid.bounds()),
        corners(scene)
    ))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Deform {
    /// The geometry does not move.
    None,
    /// Each object turns about its vertical axis.
    Spin,
    /// Each object swings about its vertical axis, the further the higher.
    Twist,
    /// Vertices move along their normals in a travelling wave.
    Wave,
}

choices!(VoxelMethod, Update, Deform, Show);

settings! {
    /// Motion of the geometry, a function of time: each frame is the same work, and time is an axis like any other.
    pub struct Animation {
        /// The motion.
        deform: Deform = Deform::None;
        /// The moment shown.
        time_s: f64 = 0.0 => -1e6 ..= 1e6, "s";
        /// Turns of `spin`, swings of `twist` and waves of `wave` per second.
        rate_hz: f64 = 0.25 => 0.0 ..= 1e3, "Hz";
        /// Amplitude of `wave` as a share of the object's height; how far `twist` turns the top, in turns.
        amplitude: f64 = 0.1 => 0.0 ..= 10.0, "1";
    }
}

impl Animation {
    /// None where the geometry rests.
    pub fn motion(&self) -> Option<Motion> {
        match self.deform {
            Deform::None => None,
            Deform::Spin => Some(Motion::Spin),
            Deform::Twist => Some(Motion::Twist),
            Deform::Wave => Some(Motion::Wave),
        }
    }

    /// Cycles since time 0.
    pub fn cycles(&self) -> f64 {
        self.rate_hz * self.time_s
    }

    /// The box that a scene without its water stays in at all times.
    pub fn bounds(&self, scene: &Scene) -> Bounds {
        let moving = scene.objects.iter().map(|object| self.motion_bounds(&object.mesh.bounds()));
        moving.fold(scene.solid_bounds(), Bounds::union)
    }

    /// The box that an object stays in at all times, from its box at rest.
    pub fn motion_bounds(&self, rest: &Bounds) -> Bounds {
        let half = rest.size() / 2.0;
        let reach = match self.deform {
            Deform::None => half,
            Deform::Spin | Deform::Twist => {
                let radius = half.x.hypot(half.z);
                DVec3::new(radius, half.y, radius)
            }
            Deform::Wave => half + self.amplitude * rest.size().y,
        };
        Bounds { min: rest.center() - reach, max: rest.center() + reach }
    }
}

/// What messages call the size of the viewport.
pub const VIEWPORT: &str = "view.width × view.height";

/// The stage that moves the geometry; none where it rests.
///
/// # Errors
/// Shaders that do not link.
pub fn deform(
    resources: &Resources<'_>,
    geometry: &Geometry,
    scene: &Scene,
    animation: &Animation,
) -> Result<Option<Stage>, GpuError> {
    let Some(motion) = animation.motion() else { return Ok(None) };
    let (cycles, amplitude) = (animation.cycles(), animation.amplitude);
    deform::new(resources, geometry, scene, motion, cycles, amplitude).map(Some)
}

/// The same without water, of what lies within these bounds: default water, which a dry scene has too, moves no shadow.
pub fn without_water(view: uniforms::View, bounds: Bounds) -> uniforms::View {
    let water = Water { amplitude_m: 0.0, refractive_index: 1.0, ..Water::default() };
    uniforms::View { bounds, water, ..view }
}

/// What a pipeline shows its stages where none of them looks photons up in the light's depth. Its bounds hold the water.
pub fn view(view: &Viewport, camera: &Camera, light: &Light, scene: &Scene) -> uniforms::View {
    uniforms::View {
        camera: camera.clone(),
        light: light.clone(),
        water: scene.water.clone(),
        bounds: scene.bounds,
        size_px: UVec2::new(view.width, view.height),
        edge_m: 0.0,
        photon_reach: DVec2::ZERO,
        photons_fitted: true,
    }
}

/// What the stages of a frame share, written by its first stage.
pub fn begin(resources: &Resources<'_>, view: &uniforms::View) -> uniforms::Shared {
    let shared = uniforms::Shared::new(resources, view);
    resources.push(uniforms::new(view.clone(), &shared));
    shared
}

/// Pixels of a buffer of `scale` times the viewport's sides.
pub fn scaled(viewport: [u32; 2], scale: f64) -> [u32; 2] {
    viewport.map(|side| ((f64::from(side) * scale).round() as u32).max(1))
}

settings! {
    /// The light's depth, for shadows.
    pub struct Shadow {
        /// Texels per side.
        size: u32 = 1024 => 1 ..= 1_000_000, "px";
    }
}

settings! {
    /// The water's surface as the light sees it.
    pub struct WaterGrid {
        /// Quads per side of the grid that draws the water.
        cells: u32 = 128 => 1 ..= 8192, "1";
    }
}

settings! {
    /// The transfer map: a photon an entry. SPT §2.
    pub struct TransferGrid {
        /// Photons along the light's screen, to the right and upwards. SPT §5: 256 × 256.
        grid: [u32; 2] = [256, 256] => 1 ..= 16384, "1";
        /// Place of each photon within its cell of the grid; [0.5, 0.5] is the middle.
        offset: [f64; 2] = [0.5, 0.5] => 0.0 ..= 1.0, "1";
    }
}

impl TransferGrid {
    pub fn photons(&self) -> u32 {
        self.grid[0] * self.grid[1]
    }

    pub fn uniforms(&self) -> MapUniforms {
        MapUniforms {
            grid: UVec2::from(self.grid),
            offset: Vec2::from(self.offset.map(|share| share as f32)),
        }
    }
}

settings! {
    /// How finely the scene's volume is sampled.
    pub struct VolumeCells from volume: VolumeFile {
        /// Cells along x, y and z of a generated volume; all 0: the generator's own number.
        cells: [u32; 3] = volume.cells => 0 ..= 4_294_967_295u32, "1";
        /// Each axis has so many times fewer cells.
        reduce: u32 = volume.reduce => 0 ..= 4_294_967_295u32, "1";
    }
}

impl VolumeCells {
    /// The scene's volume with these cells.
    ///
    /// # Errors
    /// Cells that a file or an asset gives itself.
    pub fn apply_to(&self, volume: &VolumeFile) -> Result<VolumeFile, ParamError> {
        if self.cells != volume.cells && volume.generator.is_none() {
            return Err(ParamError::Unfit(format!(
                "volume.cells is {:?}: the scene's volume is not generated, only volume.reduce changes its cells",
                self.cells
            )));
        }
        let volume = VolumeFile { cells: self.cells, reduce: self.reduce, ..volume.clone() };
        volume.validate()?;
        Ok(volume)
    }
}

/// Distance up to which geometry occludes, metres: as set, or where that is 0 a share of the scene's longest side.
pub fn r_max_m(scene: &Scene, r_max_m: f64, r_max_share: f64) -> f64 {
    if r_max_m > 0.0 { r_max_m } else { r_max_share * scene.solid_bounds().size().max_element() }
}

settings! {
    /// Joint bilateral filter of the ambient-occlusion buffer. VAO §6 gives the taps and no more.
    pub struct Filter {
        /// VAO §6: 17.
        taps: u32 = 17 => 1 ..= 1024, "1";
        /// Radius of the disc, texels of the buffer that is filtered. 17 taps over a disc of this radius lie about 1.7 texels
        /// apart.
        radius_px: f64 = 4.0 => 0.0 ..= 256.0, "px";
        /// Standard deviation of the Gaussian, texels: half the radius, where the weight has fallen to e⁻².
        sigma_px: f64 = 2.0 => 0.01 ..= 1e3, "px";
        /// Standard deviation of a tap's distance from the pixel's tangent plane along the view, over the pixel's view depth.
        /// Tuned on scenes bunny_dry, dragon_dry, room, sponza and corner: from 0.001 to 0.005 errors against ray casting
        /// change by less than 5 %, in scene corner by 12 %, and they grow beyond.
        depth_sigma: f64 = 0.0025 => 1e-6 ..= 1e3, "1";
        /// Standard deviation of the distance between the unit normals of a tap and of the pixel; 1000 (`NO_NORMALS`): they are not read. VAO §6
        /// guides by depth alone, which blurs around edges: with 0.3 errors against ray casting fall by up to 10 % on scenes sponza,
        /// robot_room and level from 150 to 600 pixels a side, in 7 of 9 cells, and rise by 3 % at most.
        normal_sigma: f64 = 0.3 => 1e-3 ..= 1e3, "1";
    }
}

impl Filter {
    /// For a buffer of `source_px` texels of a view.
    pub fn uniforms(&self, view: &uniforms::View, source_px: [u32; 2]) -> BilateralUniforms {
        BilateralUniforms {
            size_px: view.size_px.as_vec2(),
            source_px: Vec2::from(source_px.map(|side| side as f32)),
            pixel_tangent: view.pixel_tangent(view.size_px.into()) as f32,
            taps: self.taps,
            radius_px: self.radius_px as f32,
            sigma_px: self.sigma_px as f32,
            depth_sigma: self.depth_sigma as f32,
            normal_sigma: self.normal_sigma as f32,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Show {
    /// The lit scene.
    Image,
    /// Visibility, 1 − A, as grey: 1 is white.
    Occlusion,
}

settings! {
    /// How the picture is made of direct and ambient light.
    pub struct Compose {
        /// Radiance is mapped by 1 − exp(−exposure × radiance).
        exposure: f64 = 0.5 => 0.0 ..= 1e6, "1";
        /// Irradiance of the ambient light over that of the direct light. Outdoors it is 0.1 to 0.2; more shows more of the
        /// occlusion.
        ambient: f64 = 0.4 => 0.0 ..= 1e3, "1";
        /// What the picture shows.
        show: Show = Show::Image;
    }
}

impl Compose {
    pub fn glass(&self) -> GlassUniforms {
        GlassUniforms { exposure: self.exposure as f32, ambient: self.ambient as f32 }
    }

    pub fn shows_occlusion(&self) -> bool {
        self.show == Show::Occlusion
    }
}

#[cfg(test)]
mod tests;
