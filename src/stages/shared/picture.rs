//! A picture composed pixel by pixel from the G-buffer and a light of the stage's own: what the stages `*/compose` share. Their shaders
//! import `fathom::picture`.

use glam::Vec2;

use crate::gbuffer::GBuffer;
use crate::prelude::*;

/// Shafts of light over a picture.
#[derive(Clone, Copy)]
pub struct Shafts<'a> {
    /// What they add up to in each pixel, W.
    pub flux: &'a wgpu::Texture,
    /// Radiance for each W in a pixel, 1/(m² sr).
    pub scale: f64,
}

shader_struct! {
    pub struct PictureUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
        /// What a unit of the stage's own light comes to: see the stage.
        pub scale: f32,
    }
}

/// What a picture is made from, and how.
pub struct Picture<'a> {
    pub gbuffer: &'a GBuffer,
    pub exposure: f64,
    /// What a unit of the stage's own light comes to; 0 where it needs none.
    pub scale: f64,
    pub format: wgpu::TextureFormat,
}

impl<'a> Picture<'a> {
    /// For display.
    pub fn new(gbuffer: &'a GBuffer, exposure: f64, scale: f64) -> Self {
        Self { gbuffer, exposure, scale, format: wgpu::TextureFormat::Rgba8Unorm }
    }

    pub fn size_px(&self) -> [u32; 2] {
        kit::size_px(&self.gbuffer.depth)
    }

    /// Bind group 1: what all of these stages bind, and then `own`.
    pub(crate) fn group(
        &self,
        resources: &Resources<'_>,
        label: &str,
        own: &[&dyn Bind],
    ) -> Bindings {
        let GBuffer { albedo, normal, depth } = self.gbuffer;
        let size_px = Vec2::from(self.size_px().map(|side| side as f32));
        let (exposure, scale) = (self.exposure as f32, self.scale as f32);
        let settings = resources.uniform(label, &PictureUniforms { size_px, exposure, scale });
        Bindings::new(&[&settings, albedo, normal, depth]).and(own.iter().copied())
    }

    /// The stage `info`, whose shader has its path. A pixel reads so many texels, and one of the background so many.
    pub(crate) fn stage(
        &self,
        resources: &Resources<'_>,
        shared: &Shared,
        info: &'static StageInfo,
        defs: &[(&str, i32)],
        own: &[&dyn Bind],
        [texels, min]: [u64; 2],
    ) -> Result<Stage<wgpu::Texture>, GpuError> {
        let groups = [&shared.group, &self.group(resources, info.name, own)];
        let targets = [kit::opaque(self.format)];
        let spec = RenderSpec::new((info.name, defs), &groups, &targets);
        let pass = DrawPass::new(resources, &spec, self.size_px(), wgpu::Color::BLACK)?;
        let (work, min_work) = (pass.work(texels, 4), pass.work(min, 4));
        Ok(pass.stage(info, work).with_min_work(min_work))
    }
}
