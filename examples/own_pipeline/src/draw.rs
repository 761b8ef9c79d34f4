//! `ripple/draw`: the sum of rings at each pixel.

use fathom::stages::prelude::*;
use glam::Vec2;

use crate::pipeline::Params;

pub const INFO: StageInfo = StageInfo {
    name: "ripple/draw",
    about: "rings of ripples added up at each pixel",
    source: "an example of a stage of one's own",
};

shader_struct! {
    pub struct RippleUniforms {
        pub size_px: Vec2,
        pub wavelength: f32,
        pub rings: u32,
    }
}

pub fn new(
    resources: &Resources<'_>,
    size_px: [u32; 2],
    params: &Params,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let uniforms = RippleUniforms {
        size_px: Vec2::from(size_px.map(|side| side as f32)),
        // The water's wavelength over its half size.
        wavelength: (params.water.wavelength_m / params.water.half_size_m[0]) as f32,
        rings: params.ripples.rings,
    };
    let settings = resources.loop_settings(INFO.name, &uniforms);
    let groups = [&Bindings::new(&[&settings])];
    let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
    let spec = RenderSpec::new(INFO.name, &groups, &targets);
    let pass = DrawPass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
    let work = pass.work(0, 4);
    Ok(pass.stage(&INFO, work).image())
}
