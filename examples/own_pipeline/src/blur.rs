//! `ripple/blur`: the mean of a square around each pixel.

use fathom::stages::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "ripple/blur",
    about: "mean of a square around each pixel",
    source: "an example of a stage of one's own",
};

shader_struct! {
    pub struct BlurUniforms {
        pub radius_px: u32,
    }
}

/// The result has the size of the source.
pub fn new(
    resources: &Resources<'_>,
    source: &wgpu::Texture,
    radius_px: u32,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let settings = resources.loop_settings(INFO.name, &BlurUniforms { radius_px });
    let groups = [&Bindings::new(&[&settings, source])];
    let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
    let spec = RenderSpec::new(INFO.name, &groups, &targets);
    let pass = DrawPass::new(resources, &spec, kit::size_px(source), wgpu::Color::BLACK)?;
    let work = pass.work(u64::from(2 * radius_px + 1).pow(2), 4);
    Ok(pass.stage(&INFO, work).image())
}
