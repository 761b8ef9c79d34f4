//! `sprites/compose`: the picture, lit by sprites and sky.

use glam::Vec2;

use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::shader_struct;
use crate::stages::frame::Shared;
use crate::stages::gbuffer::GbufferTextures;
use crate::stages::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "sprites/compose",
    about: "the picture: what the camera sees, lit by sprites and sky",
    source: "SPT §3",
};

shader_struct! {
    /// `Compose` in `shaders/sprites/compose.wgsl`.
    pub struct ComposeUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
        pub shaft_scale: f32,
    }
}

pub struct Compose(ScreenPass);

impl Compose {
    /// `shafts` is what they add up to in each pixel, W, and the radiance for each of these.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        gbuffer: &GbufferTextures,
        irradiance: &wgpu::Texture,
        shafts: Option<(&wgpu::Texture, f64)>,
        exposure: f64,
    ) -> Result<Self, GpuError> {
        let size_px = [irradiance.width(), irradiance.height()];
        let settings = ComposeUniforms {
            size_px: Vec2::from(size_px.map(|side| side as f32)),
            exposure: exposure as f32,
            shaft_scale: shafts.map_or(0.0, |(_, scale)| scale as f32),
        };
        let settings = resources.uniform(INFO.name, &settings);
        let mut binds = vec![
            Bind::Uniform(&settings),
            Bind::Texels(&gbuffer.albedo),
            Bind::Texels(&gbuffer.normal),
            Bind::Depth(&gbuffer.depth),
            Bind::Texels(irradiance),
        ];
        binds.extend(shafts.map(|(texture, _)| Bind::Texels(texture)));
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
        let defs = [("SHAFTS", i32::from(shafts.is_some()))];
        let spec = RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets);
        ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK).map(Self)
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.0.texture()
    }
}

impl Stage for Compose {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.0.encode(scope);
    }

    fn work(&self) -> Work {
        let pixels = self.0.pixels();
        Work {
            fragments: pixels,
            texel_fetches: pixels * 4,
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::image(self.texture())]
    }
}
