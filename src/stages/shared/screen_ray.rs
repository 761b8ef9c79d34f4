//! Photon rays in the camera's screen space: what the stages `rays/*` share. Krüger, Bürger and Westermann (SPT) §2.

use bytemuck::{Pod, Zeroable};
use glam::{UVec2, Vec2, Vec3};

use crate::photon::{Photon, Photons};
use crate::prelude::*;
use fathom_gpu::kit::Resource;
use fathom_scene::Bounds;

shader_struct! {
    /// A texel of SPT's transfer map: where a photon leaves its last specular surface, and in which direction. Metres.
    #[repr(C)]
    #[derive(Copy, Pod, Zeroable)]
    pub struct Transfer {
        /// Where the photon leaves its last specular surface.
        pub position_m: Vec3,
        /// [`NEVER`], or another of `shaders/shared/transfer.wgsl`.
        pub state: u32,
        /// Unit vector along which it goes on.
        pub direction: Vec3,
        /// Way under water that is behind it.
        pub path_m: f32,
    }
}

/// State of a photon that never got here.
pub const NEVER: u32 = 0;

/// The transfer map: a photon an entry.
#[derive(Clone)]
pub struct Transfers {
    pub buffer: Buffer,
    pub count: u32,
}

impl Transfers {
    pub fn new(resources: &Resources<'_>, label: &str, count: u32) -> Self {
        Self { buffer: resources.struct_storage::<Transfer>(label, count.into()), count }
    }

    /// For dumps.
    pub fn output(&self) -> StageDump {
        let mut columns =
            Column::many(["x_m", "y_m", "z_m"], "m", "where the photon leaves the surface");
        let state = "0 for a photon that never gets here, 4 for one that has ended";
        columns.push(Column::new("state", "1", state));
        let directions = ["direction_x", "direction_y", "direction_z"];
        columns.extend(Column::many(directions, "1", "unit direction behind the surface"));
        columns.push(Column::new("path_m", "m", "way under water that is behind it"));
        let meaning =
            "the transfer map: a photon a row, in the order of the light's grid or of the pixels";
        let rows = (&*self.buffer, size_of::<Transfer>() / 4, self.count);
        let row = |stored: &[f32]| {
            let mut row = stored.to_vec();
            row[3] = stored[3].to_bits() as f32;
            row
        };
        StageDump::rows("transfers", meaning, columns, rows, row)
    }
}

impl Bind for Transfers {
    fn resource(&self) -> Resource {
        self.buffer.resource()
    }
}

/// A layered depth image: the surfaces behind each pixel, the nearest first.
#[derive(Clone)]
pub struct Layers {
    /// Device depth, 1 where there is no surface; a layer each.
    pub depths: wgpu::Texture,
    /// Shading and geometric unit normals in the world's axes, and what becomes of light there: `shaders/shared/surface_texel.wgsl`.
    pub surfaces: wgpu::Texture,
}

impl Layers {
    /// Format of surfaces. Every adapter can draw and store it.
    pub const SURFACES: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;

    /// Drawn into, a layer a pass: depths are what passes test against.
    pub fn drawn(resources: &Resources<'_>, label: &str, size_px: [u32; 2], layers: u32) -> Self {
        let [depths, surfaces] = [kit::DEPTH_FORMAT, Self::SURFACES]
            .map(|format| resources.layers(label, size_px, format, layers));
        Self { depths, surfaces }
    }

    /// The nearest layer, for dumps.
    pub fn output(&self) -> StageDump {
        let column = Column::new("depth", "1", "normalised device depth of the camera");
        let meaning = "depth of the nearest layer, 0 near plane to 1 far plane";
        StageDump::texture("depth", meaning, vec![column], &self.depths)
    }

    pub fn size_px(&self) -> [u32; 2] {
        [self.depths.width(), self.depths.height()]
    }

    pub fn count(&self) -> u32 {
        self.depths.depth_or_array_layers()
    }
}

/// What counts as a hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HitTest {
    /// The ray comes within a distance of a layer, along the pixel's line of sight: SPT §5.
    Tolerance,
    /// The same, or the ray is between the first and the second, the third and the fourth layer and so on: the additional in-out test
    /// of SPT §5, for closed objects.
    InOut,
    /// The ray passes through the tangent plane of a layer's texel.
    Crossing,
}

/// What a line of sight in glass is held against.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GlassSurface {
    /// The depths of the layer that it starts on and of the next, by lines, a row of pixels each: SPT §4. Two refractions.
    Depth,
    /// The same, of all layers: what the paper saves.
    AllDepths,
    /// The tangent planes of the surfaces in the pixels that it passes, by an invocation each.
    Plane,
}

fathom_base::choices!(HitTest, GlassSurface);

/// How rays are walked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkRules {
    pub test: HitTest,
    /// Rays in glass, which end where they are out, in place of `test`: SPT §4.
    pub in_glass: Option<GlassSurface>,
    pub tolerance_m: f64,
    pub start_m: f64,
    /// Fewest steps of a ray: SPT §2.1 enforces a minimum and does not say which.
    pub min_steps: u32,
    /// Most rows of the target that lines are drawn into.
    pub rows: u32,
    /// Ways of a photon: one, and one behind each mirror or surface of glass. SPT §2.3.
    pub path_segments: u32,
    /// Most intersections of a ray that are kept, from its start on. 1: it ends at the first. SPT Fig. 3 shows the others.
    pub max_hits: u32,
    /// Most steps of a ray; none: those across the picture.
    pub longest_px: Option<u32>,
}

shader_struct! {
    pub struct WalkUniforms {
        /// The scene's box, at which rays end.
        pub low_m: Vec3,
        /// SPT §5: 0.01.
        pub tolerance_m: f32,
        pub high_m: Vec3,
        /// Nothing is hit nearer to the start than this.
        pub start_m: f32,
        /// Pixels of the layers.
        pub size_px: Vec2,
        pub layers: u32,
        pub photons: u32,
        /// Fewest and most steps of a ray.
        pub min_steps: u32,
        pub max_steps: u32,
        /// Photons of a tile: rows of the target that lines are drawn into.
        pub rows: u32,
        /// Most intersections of a ray that are kept.
        pub max_hits: u32,
    }
}

shader_struct! {
    pub struct SightUniforms {
        pub size_px: Vec2,
        /// The rectangle of pixels that may show glass.
        pub first: UVec2,
        pub count: UVec2,
    }
}

/// What rays are traced through, and what becomes of them.
pub struct RayInputs<'a> {
    pub transfers: &'a Transfers,
    pub layers: &'a Layers,
    pub bounds: Bounds,
    pub walking: WalkRules,
}

/// Share of the scene's size by which its box is larger, so that rays end behind what bounds it.
const ROOM: f64 = 0.01;
/// The same in pixels of a view as wide as the scene: a plane is found up to a pixel behind it.
const ROOM_PX: f64 = 2.0;

fn max_steps([width, height]: [u32; 2], min: u32) -> u32 {
    (width.max(height) + 1).max(min)
}

/// Turns of loops of a ray at most: its steps, at each of which it is held against each layer of a pixel, or of one of four about an empty
/// one. Planes that it crosses far from their pixel, which are few, are not counted.
pub fn walk_iterations(steps: u32, layers: u32) -> u64 {
    1 + u64::from(steps) * (u64::from(layers) + 7)
}

/// Of rays through layers within a box, of so many steps at least.
pub fn walk_uniforms(layers: &Layers, bounds: Bounds, min: u32) -> WalkUniforms {
    WalkUniforms { layers: layers.count(), ..walk_without_layers(layers.size_px(), bounds, min) }
}

/// The same over so many pixels.
pub fn walk_without_layers(size_px: [u32; 2], bounds: Bounds, min: u32) -> WalkUniforms {
    let [width, height] = size_px;
    let room = bounds.size().max_element() * ROOM.max(ROOM_PX / f64::from(width.min(height)));
    WalkUniforms {
        low_m: (bounds.min - room).as_vec3(),
        tolerance_m: 0.0,
        high_m: (bounds.max + room).as_vec3(),
        start_m: 0.0,
        size_px: Vec2::new(width as f32, height as f32),
        layers: 0,
        photons: 0,
        min_steps: min,
        max_steps: max_steps(size_px, min),
        rows: 0,
        max_hits: 1,
    }
}

impl RayInputs<'_> {
    /// Rows of a tile.
    pub fn rows(&self) -> u32 {
        self.walking.rows.min(self.transfers.count).max(1)
    }

    /// Tiles of so many rows.
    pub fn tiles(&self) -> u32 {
        self.transfers.count.div_ceil(self.rows()).max(1)
    }

    /// Most pixels that a ray covers along one axis of the screen.
    pub fn max_steps(&self) -> u32 {
        let min = self.walking.min_steps;
        self.walking.longest_px.map_or(max_steps(self.layers.size_px(), min), |px| px.max(min))
    }

    pub fn uniforms(&self) -> WalkUniforms {
        WalkUniforms {
            tolerance_m: self.walking.tolerance_m as f32,
            start_m: self.walking.start_m as f32,
            photons: self.transfers.count,
            max_steps: self.max_steps(),
            rows: self.rows(),
            max_hits: self.walking.max_hits,
            ..walk_uniforms(self.layers, self.bounds, self.walking.min_steps)
        }
    }

    /// What shaders that walk rays are compiled with.
    pub fn defs(&self) -> [(&'static str, i32); 1] {
        let test = match (self.walking.in_glass, self.walking.test) {
            (None, HitTest::Tolerance) => 0,
            (None, HitTest::Crossing) => 1,
            (None, HitTest::InOut) => 2,
            (Some(GlassSurface::AllDepths), _) => 4,
            (Some(_), _) => 3,
        };
        [("TEST", test)]
    }

    /// Bind group of a stage that walks rays; `photons` are written by those that find hits.
    pub fn group(
        &self,
        resources: &Resources<'_>,
        label: &str,
        photons: Option<&Photons>,
    ) -> Bindings {
        let uniforms = resources.uniform(label, &self.uniforms());
        let Layers { depths, surfaces } = self.layers;
        Bindings::new(&[&uniforms, self.transfers, depths, surfaces]).and(photons)
    }

    /// Work at most: every ray as long as the picture, every layer read at each step, all photons on all ways.
    pub fn work(&self) -> Work {
        let photons = u64::from(self.transfers.count) * u64::from(self.walking.path_segments);
        let steps = photons * u64::from(self.max_steps());
        Work {
            photons,
            texel_fetches: steps * u64::from(self.layers.count()),
            bytes_read: photons * size_of::<Transfer>() as u64,
            bytes_written: Photons::bytes(photons * u64::from(self.walking.max_hits)),
            ..Work::default()
        }
    }
}

/// Photons where their rays end, for dumps.
pub fn output(photons: &Photons) -> StageDump {
    let m = |name, meaning| Column::new(name, "m", meaning);
    let columns = vec![
        m("start_x_m", "where the ray starts"),
        m("start_y_m", "the same along y"),
        m("start_z_m", "the same along z"),
        m(
            "residual_m",
            "0 for a hit, −1 for a photon without a ray, −2 for a ray without a hit, −3 after too many bounces",
        ),
        m("hit_x_m", "where the ray ends"),
        m("hit_y_m", "the same along y"),
        m("hit_z_m", "the same along z"),
        m("distance_m", "way under water up to the hit"),
    ];
    let meaning = "photons and the first surface of the layers that each ray meets";
    let rows = (&*photons.buffer, size_of::<Photon>() / 4, photons.count);
    let row = |stored: &[f32]| {
        let photon: &Photon = bytemuck::from_bytes(bytemuck::cast_slice(stored));
        let mut row = stored.to_vec();
        row[3] = photon.residual_column();
        row
    };
    StageDump::rows("photons", meaning, columns, rows, row)
}
