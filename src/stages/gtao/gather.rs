//! `gtao/gather`: ambient occlusion in slices of the hemisphere, over the depth buffer. Horizons: Jimenez, Wu, Pesce and Jarabo, *Practical
//! Realtime Strategies for Accurate Indirect Occlusion*, ATVI-TR-16-01, 2016 (GTAO), Eqs. 5 to 8. Bitmasks: Therrien, Levesque and Gilet,
//! *Screen Space Indirect Lighting with Visibility Bitmask*, The Visual Computer, 2023.

use glam::UVec2;
use serde::{Deserialize, Serialize};

use crate::bilateral::{VISIBILITY_FORMAT, Window, visible};
use crate::counters::Counters;
use crate::gbuffer::GBuffer;
use crate::prelude::*;
use fathom_base::choices;

pub const INFO: StageInfo = StageInfo {
    name: "gtao/gather",
    about: "ambient occlusion in slices of the hemisphere, by horizons (GTAO) or visibility bitmasks",
    source: "GTAO Eqs. 5 to 8; Therrien, Levesque and Gilet 2023",
};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Occluders {
    /// A slice is occluded below its two horizons: GTAO.
    Horizons,
    /// A slice is occluded in the sectors of a mask of 32 bits that samples cover: Therrien et al.
    Bitmask,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sectors {
    /// Of equal angle, and slices weigh the same: Therrien et al. A wall of 10° then occludes 0.056, where Eq. 1 of VAO gives 0.015.
    Uniform,
    /// Of equal share in the cosine-weighted integral of the slice, so that a mask estimates what horizons do.
    Cosine,
}

choices!(Occluders, Sectors);

shader_struct! {
    pub struct GatherUniforms {
        /// Pixels of the occlusion buffer.
        pub size_px: UVec2,
        pub r_max_m: f32,
        /// Of what is seen, along the view; bitmasks only.
        pub thickness_m: f32,
        /// Share by which the horizon falls to a lower sample; horizons only.
        pub fall: f32,
        pub slices: u32,
        /// Samples of depth on each side of a slice.
        pub steps: u32,
        /// Draws other numbers at every pixel; 0 leaves them as they are.
        pub seed: u32,
    }
}

/// How a slice's occlusion is gathered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GatherMethod {
    pub occluders: Occluders,
    pub sectors: Sectors,
    /// With a square the 16 texels of a tile of 4 × 4 take different rotations, and every tile the same.
    pub window: Window,
}

impl GatherUniforms {
    /// Samples of depth that a pixel takes at most.
    pub fn samples_per_pixel(&self) -> u64 {
        2 * u64::from(self.slices) * u64::from(self.steps)
    }
}

/// The occlusion buffer, 1 − A, 1 where nothing was drawn, has `settings.size_px` pixels; it may be smaller than the viewport. Occluders weigh the
/// same at any distance up to r_max. With `counters` the shader also counts samples of depth, and fragments where something was drawn.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GBuffer,
    settings: &GatherUniforms,
    method: GatherMethod,
    counters: Option<&Counters>,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let bitmask = method.occluders == Occluders::Bitmask;
    let defs = [
        ("BITMASK", i32::from(bitmask)),
        ("UNIFORM", i32::from(bitmask && method.sectors == Sectors::Uniform)),
        ("TILED", i32::from(method.window == Window::Square)),
        ("COUNT", i32::from(counters.is_some())),
    ];
    let turns = settings.samples_per_pixel() + 3 * u64::from(settings.slices) + 1;
    resources.iterations("2 × gtao.slices × gtao.steps", turns);
    let gather = resources.loop_settings(INFO.name, settings);
    let own = Bindings::new(&[&gather, &gbuffer.depth, &gbuffer.normal]).and(counters);
    let (groups, targets) = ([&shared.group, &own], [kit::opaque(VISIBILITY_FORMAT)]);
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let size_px = settings.size_px.to_array();
    let pass = DrawPass::new(resources, &spec, size_px, wgpu::Color::WHITE)?;
    // At most the depth and normal of each pixel, and the samples of its slices; the background has none.
    let work = pass.work(2 + settings.samples_per_pixel(), 2);
    let min_work = pass.work(1, 2);
    Ok(visible(pass.stage(&INFO, work).with_min_work(min_work), "visibility"))
}
