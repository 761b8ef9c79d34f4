//! A picture composed pixel by pixel from the G-buffer and from what a pixel's ray has met: what `shadow/compose` and
//! `refraction/compose` are.

use glam::Vec2;

use super::frame::Shared;
use super::gbuffer::GbufferTextures;
use super::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use super::{Output, Stage, StageInfo};
use crate::shader_struct;
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

/// Shafts of light over a picture.
#[derive(Clone, Copy)]
pub struct Shafts<'a> {
    /// What they add up to in each pixel, W.
    pub flux: &'a wgpu::Texture,
    /// Radiance for each W in a pixel, 1/(m² sr).
    pub scale: f64,
}

shader_struct! {
    /// `Compose` in the shaders.
    pub struct ComposeUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
    }
}

pub struct Picture {
    info: &'static StageInfo,
    pass: ScreenPass,
    work: Work,
}

impl Picture {
    /// The stage `info`, whose shader has its path. It binds settings, albedo, normals, depth and then `rays`. `of_pixel` is the work for each
    /// pixel beside the G-buffer's.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        info: &'static StageInfo,
        (gbuffer, rays): (&GbufferTextures, Vec<Bind<'_>>),
        exposure: f64,
        of_pixel: Work,
    ) -> Result<Self, GpuError> {
        let size_px = [gbuffer.depth.width(), gbuffer.depth.height()];
        let settings = ComposeUniforms {
            size_px: Vec2::from(size_px.map(|side| side as f32)),
            exposure: exposure as f32,
        };
        let settings = resources.uniform(info.name, &settings);
        let mut binds = vec![
            Bind::Uniform(&settings),
            Bind::Texels(&gbuffer.albedo),
            Bind::Texels(&gbuffer.normal),
            Bind::Depth(&gbuffer.depth),
        ];
        binds.extend(rays);
        let group = Group::new(resources.gpu, info.name, &binds);
        let groups = [&shared.group, &group];
        let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
        let spec = RenderSpec::new(info.name, info.name, &groups, &targets);
        let pass = ScreenPass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
        let pixels = pass.pixels();
        let work = Work {
            fragments: pixels,
            texel_fetches: pixels * (3 + of_pixel.texel_fetches),
            bytes_read: pixels * of_pixel.bytes_read,
            bytes_written: pixels * 4,
            ..Work::default()
        };
        Ok(Self { info, pass, work })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        self.pass.texture()
    }
}

impl Stage for Picture {
    fn info(&self) -> &'static StageInfo {
        self.info
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    fn work(&self) -> Work {
        self.work
    }

    /// The background has no texels but its depth.
    fn least_work(&self) -> Work {
        let pixels = self.work.fragments;
        Work { texel_fetches: pixels, bytes_read: 0, ..self.work }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::image(self.texture())]
    }
}
