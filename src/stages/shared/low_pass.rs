//! What `caustics/filter` and `godrays/filter` are: a multi-tap low-pass with a kernel rotated per pixel. UW §3.5.

use crate::prelude::*;
use crate::splatting::SplatSums;

pub const CAUSTICS: StageInfo = low_pass("caustics/filter");
pub const GODRAYS: StageInfo = low_pass("godrays/filter");

const fn low_pass(name: &'static str) -> StageInfo {
    StageInfo {
        name,
        about: "multi-tap low-pass with a kernel rotated per pixel",
        source: "UW §3.5",
    }
}

shader_struct! {
    pub struct FilterUniforms {
        pub taps: u32,
        pub radius_px: f32,
    }
}

shader_struct! {
    pub struct GuidedUniforms {
        pub taps: u32,
        pub radius_px: f32,
        /// Distance of a tap's surface from the pixel's plane along the view up to which it counts, over the pixel's view depth.
        pub depth_share: f32,
    }
}

/// The stage `info`. The result has the size and format of the source.
pub fn new(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    source: &SplatSums,
    settings: &FilterUniforms,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let filter = resources.loop_settings(info.name, settings);
    let taps = u64::from(settings.taps);
    let group = Bindings::new(&[&filter, &source.texture]);
    stage(resources, info, &[&group], source, [taps, taps])
}

/// The same, guided by the camera's depth: taps on another surface than the pixel's do not count.
pub fn guided(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    source: &SplatSums,
    shared: &Shared,
    depth: &wgpu::Texture,
    settings: &GuidedUniforms,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let filter = resources.loop_settings(info.name, settings);
    let group = Bindings::new(&[&filter, &source.texture, depth]);
    // The pixel's depth and its four neighbours'; depth and light at each tap, but no light on another surface.
    let taps = u64::from(settings.taps);
    stage(resources, info, &[&shared.group, &group], source, [5 + 2 * taps, 5 + taps])
}

/// A pixel reads so many texels, and so many at least.
fn stage(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    groups: &[&Bindings],
    source: &SplatSums,
    [texels, least]: [u64; 2],
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let targets = [kit::opaque(source.texture.format())];
    let spec = RenderSpec::new(info.name, groups, &targets);
    let pass = DrawPass::new(resources, &spec, kit::size_px(&source.texture), wgpu::Color::BLACK)?;
    let (work, least) = (pass.work(texels, 4), pass.work(least, 4));
    let meaning = "what the photons add up to, averaged over the low-pass's disc";
    let stage = pass.stage(info, work).with_min_work(least);
    Ok(stage.dump_as("filtered", meaning, vec![source.column.clone()]))
}
