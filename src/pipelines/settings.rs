//! Settings that several pipelines share.

use glam::{DVec3, Vec2};
use serde::{Deserialize, Serialize};

use crate::gpu::{Demand, GpuError};
use crate::record::Work;
use crate::scene::{Bounds, Camera, Grid, Light, Scene, SceneFile};
use crate::stages::ao::compose::ComposeUniforms;
use crate::stages::bilateral::BilateralUniforms;
use crate::stages::frame;
use crate::stages::geometry::{self, Geometry};
use crate::stages::kit::{self, Resources};
pub use crate::stages::marching::Attenuation;
use crate::stages::scene::deform::{self, Motion};

/// Checks a setting's range; the error names it.
pub fn within(group: &str, name: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(format!("{group}.{name} is {value}: it must lie within {low} … {high}"))
    }
}

/// Leaves only the first objects of a scene file; 0 leaves all.
pub fn keep_first(file: &mut SceneFile, objects: u32) {
    if objects > 0 {
        file.objects.truncate(objects as usize);
    }
}

/// Pixels of the main viewport. VAO Fig. 8: 600 × 600.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct View {
    pub width: u32,
    pub height: u32,
}

impl Default for View {
    fn default() -> Self {
        Self { width: 600, height: 600 }
    }
}

impl View {
    pub fn validate(&self) -> Result<(), String> {
        within("view", "width", f64::from(self.width), 1.0, 1e6)?;
        within("view", "height", f64::from(self.height), 1.0, 1e6)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// One pass per axis, bits of slices set by atomics. VAO §4.2.
    Slicemap,
    /// One pass per slice and axis. VAO §4.1.
    Slice,
    /// Triangle-parallel compute, separating-axis test, every voxel that a triangle touches.
    Overlap,
    /// The same with the thin test: 6-separating surfaces.
    OverlapThin,
    /// Triangle-parallel compute that stores the largest alpha of the touching triangles. VAO Fig. 6.
    MaxAlpha,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Update {
    /// Voxelization is part of every frame.
    EveryFrame,
    /// The volume is made when the pipeline is built, and no frame pays for it.
    Once,
}

/// The volume and how it is filled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Voxel {
    pub method: Method,
    pub update: Update,
    /// Voxels along the longest side of the scene. VAO §6.4: 128 to 256.
    pub resolution: u32,
    /// A volume for each object, on a grid of its own, in place of one for the scene. VAO §3.
    pub per_object: bool,
    /// Edge of a cube around the viewer that is voxelized in place of the whole scene, metres; 0: the whole scene. VAO §4.2.
    pub around_viewer_m: f64,
    /// Voxels, origin and edge of a voxel, set by hand; [0, 0, 0] fits the grid to the scene.
    pub cells: [u32; 3],
    pub origin_m: [f64; 3],
    pub voxel_m: f64,
}

impl Default for Voxel {
    fn default() -> Self {
        Self {
            method: Method::Slicemap,
            update: Update::EveryFrame,
            resolution: 128,
            per_object: false,
            around_viewer_m: 0.0,
            cells: [0; 3],
            origin_m: [0.0; 3],
            voxel_m: 0.0,
        }
    }
}

impl Voxel {
    pub fn validate(&self) -> Result<(), String> {
        within("voxel", "resolution", f64::from(self.resolution), 4.0, 4096.0)?;
        within("voxel", "around_viewer_m", self.around_viewer_m, 0.0, 1e5)?;
        if self.cells == [0; 3] {
            return Ok(());
        }
        for n in self.cells {
            within("voxel", "cells", f64::from(n), 1.0, 4096.0)?;
        }
        for x in self.origin_m {
            within("voxel", "origin_m", x, -1e5, 1e5)?;
        }
        within("voxel", "voxel_m", self.voxel_m, 1e-6, 1e5)
    }

    /// The parameter that sets the size of the volume, for messages.
    pub fn size_name(&self) -> &'static str {
        if self.cells == [0; 3] { "voxel.resolution" } else { "voxel.cells" }
    }

    /// The grid of the whole scene, or one for each object in the scene's order, with room for the geometry's motion.
    ///
    /// # Errors
    /// Voxels by the object where the grid is set by hand or lies around the viewer; a scene without geometry; a grid that
    /// holds nothing of the scene.
    pub fn grids(
        &self,
        scene: &Scene,
        camera: &Camera,
        animation: &Animation,
    ) -> Result<Vec<Grid>, String> {
        let by_hand = self.cells != [0; 3];
        if self.per_object && (by_hand || self.around_viewer_m > 0.0) {
            return Err("voxel.per_object fits a grid to each object: \
                voxel.cells and voxel.around_viewer_m must be 0"
                .into());
        }
        if self.per_object {
            let fit = |object: &crate::scene::Object| {
                Grid::fit(&animation.room(&object.mesh.bounds()), self.resolution)
                    .map_err(|fault| format!("object `{}`: {fault}", object.name))
            };
            return scene.objects.iter().map(fit).collect();
        }
        let moving = scene.objects.iter();
        let moving = moving.map(|o| animation.room(&o.mesh.bounds()));
        let bounds = moving.fold(scene.solid_bounds(), Bounds::union);
        let grid = if by_hand {
            let grid = Grid {
                cells: self.cells,
                origin_m: DVec3::from(self.origin_m),
                voxel_m: self.voxel_m,
            };
            holds_some("voxel.cells, voxel.origin_m and voxel.voxel_m", &grid, &bounds)?;
            grid
        } else if self.around_viewer_m > 0.0 {
            let viewer = DVec3::from(camera.position_m);
            let grid = Grid::around(viewer, self.around_viewer_m, self.resolution)?;
            holds_some("voxel.around_viewer_m and camera.position_m", &grid, &bounds)?;
            grid
        } else {
            Grid::fit(&bounds, self.resolution)?
        };
        Ok(vec![grid])
    }
}

/// An error for a grid beside the scene: everything in it would be empty.
fn holds_some(parameters: &str, grid: &Grid, scene: &Bounds) -> Result<(), String> {
    if grid.bounds().meets(scene) {
        return Ok(());
    }
    let corners = |bounds: &Bounds| {
        let [min, max] = [bounds.min, bounds.max].map(|p| p.to_array());
        format!("{min:.3?} to {max:.3?} m")
    };
    Err(format!(
        "{parameters} place the grid at {}, and the scene lies at {}: they must overlap",
        corners(&grid.bounds()),
        corners(scene)
    ))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Deform {
    /// Geometry rests.
    None,
    /// Each object turns about its vertical axis.
    Spin,
    /// Each object swings about its vertical axis, the further the higher.
    Twist,
    /// Vertices move along their normals in a travelling wave.
    Wave,
}

/// Motion of the geometry, a function of time: each frame is the same work, and time is an axis like any other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Animation {
    pub deform: Deform,
    pub time_s: f64,
    /// Turns of `spin`, swings of `twist` and waves of `wave` per second.
    pub rate_hz: f64,
    /// Amplitude of `wave` as a share of the object's height; how far `twist` turns the top, in turns.
    pub amplitude: f64,
}

impl Default for Animation {
    fn default() -> Self {
        Self { deform: Deform::None, time_s: 0.0, rate_hz: 0.25, amplitude: 0.1 }
    }
}

impl Animation {
    pub fn validate(&self) -> Result<(), String> {
        within("animation", "time_s", self.time_s, -1e6, 1e6)?;
        within("animation", "rate_hz", self.rate_hz, 0.0, 1e3)?;
        within("animation", "amplitude", self.amplitude, 0.0, 10.0)
    }

    /// What moves the geometry; none where it rests.
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

    /// The box that an object stays in at all times, from its box at rest.
    pub fn room(&self, rest: &Bounds) -> Bounds {
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

/// Bytes of a pixel of the G-buffer: colour, normal and depth.
pub const GBUFFER_BYTES: u64 = 4 + 8 + 4;
/// Bytes of a pixel of the final image.
pub const IMAGE_BYTES: u64 = 4;
/// Bytes of a texel of a shadow map's depth.
pub const DEPTH_BYTES: u64 = 4;
/// Bytes of a texel of visibility.
pub const VISIBILITY_BYTES: u64 = 2;
/// Bytes that the host takes for a pixel of a picture: as it is read back, as four floats, and as it is written.
const PICTURE_BYTES: u64 = 4 + 16 + 4;
/// Texel fetches of a pixel of `ao/compose`, as it declares them.
pub const COMPOSE_FETCHES: u64 = 8;
/// What a demand calls the viewport.
pub const VIEWPORT: &str = "view.width × view.height";

/// A full-screen pass, or several, to targets of this size with so many bytes and texel fetches a pixel.
pub fn pass_demand(size_px: [u32; 2], what: &str, bytes: u64, fetches: u64) -> Demand {
    let [width, height] = size_px.map(u64::from);
    let pixels = width * height;
    let work = Work {
        fragments: pixels,
        texel_fetches: pixels.saturating_mul(fetches),
        ..Work::default()
    };
    Demand::new()
        .texture_2d(what, width, height)
        .holds(what, pixels.saturating_mul(bytes))
        .takes(what, work)
}

/// Texel fetches of a pixel of the bilateral filter, as it declares them; none without it.
pub fn filter_fetches(filtered: bool, filter: &Filter) -> u64 {
    if filtered { 5 + 2 * u64::from(filter.taps) } else { 0 }
}

/// What reading the image back for a picture asks.
pub fn picture_demand(size_px: [u32; 2]) -> Demand {
    let pixels = size_px.map(u64::from).iter().product::<u64>();
    Demand::new().copies(VIEWPORT, pixels.saturating_mul(PICTURE_BYTES))
}

/// What the uniforms and tables that all stages share ask.
pub fn shared_demand() -> Demand {
    Demand::new().holds("noise", frame::NOISE_BYTES)
}

/// What a scene's vertices and indices ask.
pub fn geometry_demand(scene: &Scene) -> Demand {
    let (vertices, indices) = geometry::buffer_bytes(scene);
    Demand::new()
        .buffer("scene vertices", vertices)
        .buffer("scene indices", indices)
        .holds("scene vertices", vertices)
        .holds("scene indices", indices)
}

/// What moving the geometry asks of an adapter.
pub fn deform_demand(demand: Demand, scene: &Scene, animation: &Animation) -> Demand {
    if animation.motion().is_none() {
        return demand;
    }
    let corners: usize = scene.objects.iter().map(|o| o.mesh.positions.len()).sum();
    let groups = kit::linear_workgroups(corners as u64);
    demand
        .storage("scene vertices", geometry::buffer_bytes(scene).0)
        .dispatch("scene/deform", groups.map(u64::from))
}

/// The stage that moves the geometry; none where it rests.
///
/// # Errors
/// Shaders that do not link.
pub fn deform(
    resources: &Resources<'_>,
    geometry: &Geometry,
    scene: &Scene,
    animation: &Animation,
) -> Result<Option<deform::Deform>, GpuError> {
    let amount = (animation.cycles(), animation.amplitude);
    animation
        .motion()
        .map(|motion| deform::Deform::new(resources, geometry, scene, motion, amount))
        .transpose()
}

/// The scene file with a pipeline's floor, camera and light put in, and of its objects the first `objects` (0: all).
pub fn staged(
    file: &SceneFile,
    floor_depth_m: f64,
    camera: Camera,
    light: Light,
    objects: u32,
) -> SceneFile {
    let mut file = SceneFile { floor_depth_m, camera, light, ..file.clone() };
    keep_first(&mut file, objects);
    file
}

/// Pixels of a buffer of `scale` times the viewport's sides.
pub fn scaled(view: &View, scale: f64) -> [u32; 2] {
    [view.width, view.height].map(|side| ((f64::from(side) * scale).round() as u32).max(1))
}

/// Step between neighbouring texels of the light's depth, for pipelines that do not trace photons: their stages do not read it.
pub const UNUSED_EDGE_M: f64 = 0.1;

/// The light's depth, for shadows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Shadow {
    /// Texels per side.
    pub size: u32,
}

impl Default for Shadow {
    fn default() -> Self {
        Self { size: 1024 }
    }
}

impl Shadow {
    pub fn validate(&self) -> Result<(), String> {
        within("shadow", "size", f64::from(self.size), 1.0, 1e6)
    }
}

/// Default of r_max over the scene's longest side. VAO gives none; tuned on scenes bunny_dry, dragon_dry and sponza.
pub const R_MAX_SHARE: f64 = 0.25;

/// Distance up to which geometry occludes, metres: as set, or where that is 0 a share of the scene's longest side.
pub fn r_max_m(scene: &Scene, r_max_m: f64, r_max_share: f64) -> f64 {
    if r_max_m > 0.0 { r_max_m } else { r_max_share * scene.solid_bounds().size().max_element() }
}

/// Joint bilateral filter of the ambient-occlusion buffer. VAO §6 gives the taps and no more.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Filter {
    /// VAO §6: 17.
    pub taps: u32,
    /// Radius of the disc, texels of the buffer that is filtered. 17 taps over a disc of this radius lie about 1.7 texels
    /// apart.
    pub radius_px: f64,
    /// Standard deviation of the Gaussian, texels: half the radius, where the weight has fallen to e⁻².
    pub sigma_px: f64,
    /// Standard deviation of a tap's distance from the pixel's tangent plane along the view, over the pixel's view depth.
    /// Tuned on scenes bunny_dry, dragon_dry, room, sponza and corner: from 0.001 to 0.005 errors against ray casting change by
    /// less than 5 %, in scene corner by 12 %, and they grow beyond.
    pub depth_sigma: f64,
}

impl Default for Filter {
    fn default() -> Self {
        Self { taps: 17, radius_px: 4.0, sigma_px: 2.0, depth_sigma: 0.0025 }
    }
}

impl Filter {
    pub fn validate(&self) -> Result<(), String> {
        within("filter", "taps", f64::from(self.taps), 1.0, 1024.0)?;
        within("filter", "radius_px", self.radius_px, 0.0, 256.0)?;
        within("filter", "sigma_px", self.sigma_px, 0.01, 1e3)?;
        within("filter", "depth_sigma", self.depth_sigma, 1e-6, 1e3)
    }

    /// For a buffer of `source_px` texels of a view.
    pub fn uniforms(&self, view: &frame::View, source_px: [u32; 2]) -> BilateralUniforms {
        BilateralUniforms {
            size_px: view.size_px.as_vec2(),
            source_px: Vec2::from(source_px.map(|side| side as f32)),
            pixel_tangent: view.pixel_tangent(view.size_px.y) as f32,
            taps: self.taps,
            radius_px: self.radius_px as f32,
            sigma_px: self.sigma_px as f32,
            depth_sigma: self.depth_sigma as f32,
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

/// How the picture is made of direct and ambient light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Compose {
    pub exposure: f64,
    /// Irradiance of the ambient light over that of the direct light. Outdoors it is 0.1 to 0.2; more shows more of the
    /// occlusion.
    pub ambient: f64,
    pub show: Show,
}

impl Default for Compose {
    fn default() -> Self {
        Self { exposure: 0.5, ambient: 0.4, show: Show::Image }
    }
}

impl Compose {
    pub fn validate(&self) -> Result<(), String> {
        within("compose", "exposure", self.exposure, 0.0, 1e6)?;
        within("compose", "ambient", self.ambient, 0.0, 1e3)
    }

    pub fn uniforms(&self, view: &frame::View) -> ComposeUniforms {
        ComposeUniforms {
            size_px: view.size_px.as_vec2(),
            exposure: self.exposure as f32,
            ambient: self.ambient as f32,
        }
    }

    pub fn shows_occlusion(&self) -> bool {
        self.show == Show::Occlusion
    }
}

#[cfg(test)]
mod tests;
