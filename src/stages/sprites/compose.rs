//! `sprites/compose`: the picture, lit by sprites and sky.

use glam::Vec2;

use crate::frame::Shared;
use crate::gbuffer::GbufferTextures;
use crate::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use crate::screen_picture::Shafts;
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

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

/// What is made of the light.
pub enum Composed<'a> {
    /// A picture, with the water between the camera and what it sees.
    Picture { shafts: Option<Shafts<'a>>, exposure: f64 },
    /// The radiance of what the camera sees, without the water, W/(m² sr).
    Dry,
}

pub struct Compose(ScreenPass);

impl Compose {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        gbuffer: &GbufferTextures,
        irradiance: &wgpu::Texture,
        composed: &Composed<'_>,
    ) -> Result<Self, GpuError> {
        let size_px = [irradiance.width(), irradiance.height()];
        let (shafts, exposure, format) = match composed {
            Composed::Picture { shafts, exposure } => {
                (*shafts, *exposure, wgpu::TextureFormat::Rgba8Unorm)
            }
            Composed::Dry => (None, 0.0, wgpu::TextureFormat::Rgba16Float),
        };
        let settings = ComposeUniforms {
            size_px: Vec2::from(size_px.map(|side| side as f32)),
            exposure: exposure as f32,
            shaft_scale: shafts.map_or(0.0, |shafts| shafts.scale as f32),
        };
        let settings = resources.uniform(INFO.name, &settings);
        let mut binds = vec![
            Bind::Uniform(&settings),
            Bind::Texels(&gbuffer.albedo),
            Bind::Texels(&gbuffer.normal),
            Bind::Depth(&gbuffer.depth),
            Bind::Texels(irradiance),
        ];
        binds.extend(shafts.map(|shafts| Bind::Texels(shafts.flux)));
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let targets = [kit::opaque(format)];
        let dry = i32::from(matches!(composed, Composed::Dry));
        let defs = [("DRY", dry), ("SHAFTS", i32::from(shafts.is_some()))];
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

    /// The background has no texels but its depth.
    fn least_work(&self) -> Work {
        Work { texel_fetches: self.0.pixels(), ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::image(self.texture())]
    }
}
