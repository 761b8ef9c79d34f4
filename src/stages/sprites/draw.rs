//! `sprites/draw`: a sprite for each photon that has landed, in the receiver's tangent plane or in the screen's. SPT §3.1, Eq. 1, Fig. 6.

use glam::Vec2;

use crate::photon::Photons;
use crate::prelude::*;
use crate::screen_ray::Layers;
use crate::splatting::{PHOTONS_PER_INSTANCE, quads};

pub const INFO: StageInfo = StageInfo {
    name: "sprites/draw",
    about: "a sprite for each photon, in the receiver's tangent plane or the screen's, on visible pixels",
    source: "SPT §3.1, Eq. 1",
};

shader_struct! {
    pub struct SpriteUniforms {
        pub size_px: Vec2,
        /// s of Eq. 1.
        pub radius_m: f32,
        /// A pixel is lit when what it shows lies this near to the sprite's plane, along its line of sight.
        pub visible_m: f32,
        /// Irradiance of a photon for each metre of s − r, W/m³.
        pub irradiance_per_m: f32,
        pub photons_per_instance: u32,
        pub photons: u32,
        pub layers: u32,
        /// Photons of a weight.
        pub per_ray: u32,
    }
}

/// What a sprite looks like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sprite {
    /// s of Eq. 1: the distance at which nothing is left.
    pub radius_m: f64,
    pub visible_m: f64,
    /// Whether it lies in the screen's plane, not in the receiver's.
    pub facing: bool,
    /// Flux of a photon.
    pub photon_w: f64,
    /// Side of a sprite in the middle of the view, for the declared work.
    pub side_px: f64,
}

impl Sprite {
    /// What a photon adds for each metre of s − r, so that all it adds is its flux: the integral of s − r over the disc is π s³ / 3.
    pub fn rise_w_m3(&self) -> f64 {
        self.photon_w * 3.0 / (std::f64::consts::PI * self.radius_m.powi(3))
    }
}

/// On receivers that `layers` hold, where the camera's depth `seen` shows them. The stage leaves W/m² on what each pixel shows.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    photons: &Photons,
    weights: &Buffer,
    layers: &Layers,
    seen: &wgpu::Texture,
    sprite: &Sprite,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let size_px = layers.size_px();
    let settings = SpriteUniforms {
        size_px: Vec2::from(size_px.map(|side| side as f32)),
        radius_m: sprite.radius_m as f32,
        visible_m: sprite.visible_m as f32,
        irradiance_per_m: sprite.rise_w_m3() as f32,
        photons_per_instance: PHOTONS_PER_INSTANCE,
        photons: photons.count,
        layers: layers.count(),
        per_ray: photons.per_ray,
    };
    let settings = resources.uniform(INFO.name, &settings);
    let Layers { depths, surfaces } = layers;
    let own = Bindings::new(&[&settings, photons, depths, surfaces, seen, weights]);
    let groups = [&shared.group, &own];
    let targets = [kit::additive(kit::accumulation_format(resources.gpu))];
    let defs = [("FACING", i32::from(sprite.facing))];
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let pass = DrawPass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
    let count = u64::from(photons.count);
    let fragments = (f64::from(photons.count) * sprite.side_px.powi(2)) as u64;
    let work = Work {
        photons: count,
        primitives: count * 2,
        fragments,
        bytes_read: Photons::bytes(count),
        bytes_written: fragments * 4,
        ..Work::default()
    };
    // Sprites may lie outside the picture.
    let min_work = Work { fragments: 0, bytes_written: 0, ..work };
    let stage = pass.drawing(&INFO, work, quads(resources, photons.count)).with_min_work(min_work);
    let meaning = "what the photons bring to the surface seen";
    Ok(stage.dump_as("irradiance", meaning, vec![Column::new("irradiance", "W/m²", meaning)]))
}
