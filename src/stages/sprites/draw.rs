//! `sprites/draw`: a sprite in the receiver's tangent plane for each photon that has landed. SPT §3.1, Eq. 1.

use glam::Vec2;

use crate::frame::Shared;
use crate::kit::{self, Bind, Buffer, Group, Raster, RenderSpec, Resources};
use crate::photon::Photons;
use crate::screen_ray::Layers;
use crate::shader_struct;
use crate::splatting::{PHOTONS_PER_INSTANCE, index_pattern};
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "sprites/draw",
    about: "a sprite in the receiver's tangent plane for each photon, on visible pixels",
    source: "SPT §3.1, Eq. 1",
};

shader_struct! {
    /// `Sprites` in `shaders/sprites/draw.wgsl`.
    pub struct SpriteUniforms {
        pub size_px: Vec2,
        pub radius_m: f32,
        pub visible_m: f32,
        pub rise_w_m3: f32,
        pub photons_per_instance: u32,
        pub photons: u32,
        pub layers: u32,
    }
}

/// What a sprite looks like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sprite {
    /// s of Eq. 1: the distance at which nothing is left.
    pub radius_m: f64,
    pub visible_m: f64,
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

pub struct Sprites {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    indices: Buffer,
    view: wgpu::TextureView,
    /// W/m² on what each pixel shows.
    pub irradiance: wgpu::Texture,
    photons: u32,
    fragments: u64,
}

impl Sprites {
    /// On receivers that `layers` hold, where the camera's depth `seen` shows them.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        (photons, weights): (&Photons, &Buffer),
        layers: &Layers,
        seen: &wgpu::Texture,
        sprite: &Sprite,
    ) -> Result<Self, GpuError> {
        let size_px = layers.size_px();
        let settings = SpriteUniforms {
            size_px: Vec2::from(size_px.map(|side| side as f32)),
            radius_m: sprite.radius_m as f32,
            visible_m: sprite.visible_m as f32,
            rise_w_m3: sprite.rise_w_m3() as f32,
            photons_per_instance: PHOTONS_PER_INSTANCE,
            photons: photons.count,
            layers: layers.count(),
        };
        let settings = resources.uniform(INFO.name, &settings);
        let binds = [
            Bind::Uniform(&settings),
            Bind::Read(&photons.buffer),
            Bind::Layers(&layers.depths),
            Bind::Layers(&layers.surfaces),
            Bind::Depth(seen),
            Bind::Read(weights),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let format = kit::accumulation_format(resources.gpu);
        let targets = [kit::additive(format)];
        let spec = RenderSpec::new(INFO.name, INFO.name, &groups, &targets);
        let irradiance = resources.target(INFO.name, size_px, format);
        Ok(Self {
            raster: Raster::new(resources, &spec)?,
            groups: kit::bare(&groups),
            indices: index_pattern(resources),
            view: kit::view(&irradiance),
            irradiance,
            photons: photons.count,
            fragments: (f64::from(photons.count) * sprite.side_px.powi(2)) as u64,
        })
    }
}

impl Stage for Sprites {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let clear = Some(wgpu::Color::BLACK);
        let color = [ColorTarget { view: &self.view, clear, slice: None }];
        scope.render(&Targets { color: &color, depth: None }, |pass| {
            self.raster.bind(pass);
            kit::bind_groups(pass, &self.groups);
            pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint16);
            let instances = self.photons.div_ceil(PHOTONS_PER_INSTANCE);
            pass.draw_indexed(0..PHOTONS_PER_INSTANCE * 6, 0, 0..instances);
        });
    }

    fn work(&self) -> Work {
        let photons = u64::from(self.photons);
        Work {
            photons,
            primitives: photons * 2,
            fragments: self.fragments,
            bytes_read: Photons::bytes(photons),
            bytes_written: self.fragments * 4,
            ..Work::default()
        }
    }

    /// Sprites may lie outside the picture.
    fn least_work(&self) -> Work {
        Work { fragments: 0, bytes_written: 0, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        let column =
            Column::new("irradiance", "W/m²", "what the photons bring to the surface seen");
        vec![Output::texture("irradiance", column.meaning, vec![column.clone()], &self.irradiance)]
    }
}
