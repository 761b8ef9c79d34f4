//! `ao/compose`: deferred direct light with shadows, and ambient light times visibility. VAO §6.

use glam::Vec2;

use crate::gbuffer::GbufferTextures;
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "ao/compose",
    about: "deferred direct light with shadows, and ambient light times visibility",
    source: "VAO §6",
};

shader_struct! {
    /// `Compose` in `shaders/ao/compose.wgsl`.
    pub struct LightingUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
        pub ambient: f32,
    }
}

/// The buffers that are composed.
pub struct Lit<'a> {
    pub gbuffer: &'a GbufferTextures,
    /// 1 − A, at any size.
    pub visibility: &'a wgpu::Texture,
    /// The light's depth.
    pub shadow: &'a wgpu::Texture,
}

/// With `shows_occlusion` the picture is the visibility itself, as it is.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    lit: &Lit<'_>,
    settings: &LightingUniforms,
    shows_occlusion: bool,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let uniforms = resources.uniform(INFO.name, settings);
    let GbufferTextures { albedo, normal, depth } = lit.gbuffer;
    let own = Group::new(&[&uniforms, albedo, normal, depth, lit.visibility, lit.shadow]);
    let defs = [("SHOW_OCCLUSION", i32::from(shows_occlusion))];
    let groups = [&shared.group, &own];
    let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let size_px = settings.size_px.as_uvec2().to_array();
    let pass = Pass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
    // Visibility and depth; and for the picture albedo, normal and four texels of the shadow map.
    let work = pass.work(if shows_occlusion { 2 } else { 8 }, 4);
    // The background has no colour, and surfaces that face away from the light ask no shadow map.
    let least = pass.work(2, 4);
    let meaning = if shows_occlusion { "visibility" } else { "display value, gamma 2.2" };
    let stage = pass.stage(&INFO, work).at_least(least);
    Ok(stage.shown("image", "the final image", Column::display(meaning)))
}
