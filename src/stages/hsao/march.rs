//! `hsao/march`: horizon-split ambient occlusion over the depth buffer. Dimitrov, Bavoil and Sainz, I3D 2008, with the
//! changes of VAO §6.

use glam::UVec2;

use crate::bilateral::{VISIBILITY_FORMAT, visible};
use crate::counters::Counters;
use crate::gbuffer::GBuffer;
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "hsao/march",
    about: "horizon-split ambient occlusion: horizons in the depth buffer, rays marched above them",
    source: "VAO §6; Dimitrov, Bavoil and Sainz, I3D 2008",
};

shader_struct! {
    pub struct HorizonUniforms {
        /// Pixels of the occlusion buffer.
        pub size_px: UVec2,
        pub r_max_m: f32,
        /// Difference of depth beyond which samples belong to another layer of surfaces.
        pub layer_m: f32,
        pub directions: u32,
        /// Samples of depth along each direction.
        pub steps: u32,
        /// Above the horizon, shared among the directions.
        pub rays: u32,
        pub ray_steps: u32,
        /// Draws other numbers at every pixel; 0 leaves them as they are.
        pub seed: u32,
    }
}

impl HorizonUniforms {
    /// Samples of depth that a pixel takes at most. Rays end early at hits and at the picture's border.
    pub fn samples_per_pixel(&self) -> u64 {
        u64::from(self.directions) * u64::from(self.steps)
            + u64::from(self.rays) * u64::from(self.ray_steps)
    }

    /// Turns of loops of a pixel at most, the ones that find a loop's end included.
    fn loop_bound(&self) -> u64 {
        self.samples_per_pixel() + 3 * u64::from(self.directions) + 2 * u64::from(self.rays) + 1
    }
}

/// The occlusion buffer, 1 − A, 1 where nothing was drawn, has `settings.size_px` pixels; it may be smaller than the viewport. `hard`:
/// occluders weigh the same at any distance up to r_max. With `counters` the shader also counts samples of depth, and
/// fragments where something was drawn.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GBuffer,
    settings: &HorizonUniforms,
    hard: bool,
    counters: Option<&Counters>,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let defs = [("HARD", i32::from(hard)), ("COUNT", i32::from(counters.is_some()))];
    resources.iterations(
        "hsao.directions × hsao.steps + hsao.rays × hsao.ray_steps",
        settings.loop_bound(),
    );
    let march = resources.loop_settings(INFO.name, settings);
    let own = Bindings::new(&[&march, &gbuffer.depth, &gbuffer.normal]).and(counters);
    let (groups, targets) = ([&shared.group, &own], [kit::opaque(VISIBILITY_FORMAT)]);
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let size_px = settings.size_px.to_array();
    let pass = DrawPass::new(resources, &spec, size_px, wgpu::Color::WHITE)?;
    // Samples at most: the depth and normal of each pixel, and those of its directions and rays.
    let work = pass.work(2 + settings.samples_per_pixel(), 2);
    // The background has no samples.
    let min_work = pass.work(1, 2);
    Ok(visible(pass.stage(&INFO, work).with_min_work(min_work), "visibility"))
}
