//! A picture composed pixel by pixel from the G-buffer and from what a pixel's ray has met: what `shadow/compose` and
//! `refraction/compose` are.

use glam::Vec2;

use super::gbuffer::GbufferTextures;
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
    /// `Compose` in the shaders.
    pub struct ComposeUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
    }
}

impl ComposeUniforms {
    pub fn new(size_px: [u32; 2], exposure: f64) -> Self {
        Self { size_px: Vec2::from(size_px.map(|side| side as f32)), exposure: exposure as f32 }
    }
}

/// The stage `info`, whose shader has its path. It binds settings, albedo, normals, depth and then `rays`. `of_pixel` is the work for each
/// pixel beside the G-buffer's.
pub(super) fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    info: &'static StageInfo,
    (gbuffer, rays): (&GbufferTextures, &[&dyn Bind]),
    exposure: f64,
    of_pixel: Work,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let GbufferTextures { albedo, normal, depth } = gbuffer;
    let size_px = kit::size_px(depth);
    let settings = resources.uniform(info.name, &ComposeUniforms::new(size_px, exposure));
    let own = Group::new(&[&settings, albedo, normal, depth]).and(rays.iter().copied());
    let groups = [&shared.group, &own];
    let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
    let spec = RenderSpec::new(info.name, &groups, &targets);
    let pass = Pass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
    let bytes_read = pass.pixels() * of_pixel.bytes_read;
    let work = Work { bytes_read, ..pass.work(3 + of_pixel.texel_fetches, 4) };
    // The background has no texels but its depth.
    let least = pass.work(1, 4);
    Ok(pass.stage(info, work).at_least(least).image())
}
