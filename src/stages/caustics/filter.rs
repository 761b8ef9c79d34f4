//! `caustics/filter`: a multi-tap low-pass that keeps to the pixel's surface. UW §3.5.

use crate::low_pass;
use crate::prelude::*;
use crate::splatting::SplatSums;

pub const INFO: StageInfo = low_pass::info("caustics/filter");

shader_struct! {
    pub struct GuidedUniforms {
        pub taps: u32,
        pub radius_px: f32,
        /// Distance of a tap's surface from the pixel's plane along the view up to which it counts, over the pixel's view depth.
        pub depth_share: f32,
    }
}

/// Guided by the camera's depth: taps on another surface than the pixel's do not count. The result has the size and format of the source.
pub fn new(
    resources: &Resources<'_>,
    source: &SplatSums,
    shared: &Shared,
    depth: &wgpu::Texture,
    settings: &GuidedUniforms,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let filter = resources.loop_settings(INFO.name, settings);
    let group = Bindings::new(&[&filter, &source.texture, depth]);
    // The pixel's depth and its four neighbours'; depth and light at each tap, but no light on another surface.
    let taps = u64::from(settings.taps);
    let texels = [5 + 2 * taps, 5 + taps];
    low_pass::stage(resources, &INFO, &[&shared.group, &group], source, texels)
}
