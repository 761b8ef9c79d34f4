//! `refraction/compose`: the picture, through glass by its exit rays. SPT §4.

use glam::Vec2;

use super::Exits;
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::shader_struct;
use crate::stages::frame::Shared;
use crate::stages::gbuffer::GbufferTextures;
use crate::stages::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "refraction/compose",
    about: "the picture: the environment, what stands in it, and what is seen of it through glass",
    source: "SPT §4",
};

shader_struct! {
    /// `Compose` in `shaders/refraction/compose.wgsl`.
    pub struct ComposeUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
    }
}

pub struct Compose(ScreenPass);

impl Compose {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        gbuffer: &GbufferTextures,
        exits: &Exits,
        exposure: f64,
    ) -> Result<Self, GpuError> {
        let size_px = [gbuffer.depth.width(), gbuffer.depth.height()];
        let settings = ComposeUniforms {
            size_px: Vec2::from(size_px.map(|side| side as f32)),
            exposure: exposure as f32,
        };
        let settings = resources.uniform(INFO.name, &settings);
        let binds = [
            Bind::Uniform(&settings),
            Bind::Texels(&exits.positions),
            Bind::Texels(&exits.directions),
            Bind::Texels(&gbuffer.albedo),
            Bind::Texels(&gbuffer.normal),
            Bind::Depth(&gbuffer.depth),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
        let spec = RenderSpec::new(INFO.name, INFO.name, &groups, &targets);
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
            texel_fetches: pixels * 5,
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::image(self.texture())]
    }
}
