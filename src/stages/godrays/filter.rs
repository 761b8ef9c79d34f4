//! `godrays/filter`: a multi-tap low-pass. UW §3.5.

use crate::low_pass;
use crate::prelude::*;
use crate::splatting::SplatSums;

pub const INFO: StageInfo = low_pass::info("godrays/filter");

shader_struct! {
    pub struct FilterUniforms {
        pub taps: u32,
        pub radius_px: f32,
    }
}

/// The result has the size and format of the source.
pub fn new(
    resources: &Resources<'_>,
    source: &SplatSums,
    settings: &FilterUniforms,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let filter = resources.loop_settings(INFO.name, settings);
    let taps = u64::from(settings.taps);
    let group = Bindings::new(&[&filter, &source.texture]);
    low_pass::stage(resources, &INFO, &[&group], source, [taps, taps])
}
