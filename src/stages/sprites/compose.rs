//! `sprites/compose`: the picture, lit by sprites and sky.

use glam::Vec2;

use crate::gbuffer::GbufferTextures;
use crate::prelude::*;
use crate::screen_picture::Shafts;

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

pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GbufferTextures,
    irradiance: &wgpu::Texture,
    composed: &Composed<'_>,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let size_px = kit::size_px(irradiance);
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
    let GbufferTextures { albedo, normal, depth } = gbuffer;
    let own = Group::new(&[&settings, albedo, normal, depth, irradiance])
        .and(shafts.map(|shafts| shafts.flux));
    let (groups, targets) = ([&shared.group, &own], [kit::opaque(format)]);
    let dry = i32::from(matches!(composed, Composed::Dry));
    let defs = [("DRY", dry), ("SHAFTS", i32::from(shafts.is_some()))];
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let pass = Pass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
    // The background has no texels but its depth.
    let (work, least) = (pass.work(4, 4), pass.work(1, 4));
    Ok(pass.stage(&INFO, work).at_least(least).image())
}
