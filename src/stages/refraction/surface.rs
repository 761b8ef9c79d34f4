//! `refraction/surface`: the picture with the water's surface, which refracts and reflects lines of sight. SPT §4.

use glam::Vec2;

use crate::entry::{REFINEMENTS, step_iterations};
use crate::picture::Shafts;
use crate::prelude::*;
use crate::screen_ray::{Layers, WalkUniforms, walk_iterations};
use fathom_gpu::MAX_ITERATIONS;
use fathom_scene::Water;

pub const INFO: StageInfo = StageInfo {
    name: "refraction/surface",
    about: "the picture with the water's surface, at which lines of sight are refracted and reflected",
    source: "SPT §4",
};

shader_struct! {
    pub struct SurfaceUniforms {
        pub size_px: Vec2,
        pub exposure: f32,
        /// Radiance of a shaft for each W in its pixel, 1/(m² sr).
        pub shaft_scale: f32,
        /// Largest slope of the water's surface.
        pub steepest: f32,
        /// Most steps of a line of sight towards it.
        pub searches: u32,
    }
}

/// Most steps towards the water's surface: at a sixteenth of the shortest wave they cross sixteen such waves. Long lists of waves leave room
/// for fewer in large pictures.
const MAX_SEARCHES: u64 = 256;

/// What the camera sees without the water.
pub struct DryView<'a> {
    /// The first layer is what is seen.
    pub layers: &'a Layers,
    pub depth: &'a wgpu::Texture,
    pub radiance: &'a wgpu::Texture,
}

/// Of `walk`'s layers the first is used.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    dry: &DryView<'_>,
    walk: &WalkUniforms,
    water: &Water,
    shafts: Option<Shafts<'_>>,
    exposure: f64,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let size_px = dry.layers.size_px();
    // The height of the water at the place found, and a ray to either side.
    let found = (REFINEMENTS + 3) * (2 + shared.water_iterations);
    let rest = found + 2 * walk_iterations(walk.max_steps, 1);
    let step = step_iterations(water);
    let searches = (MAX_ITERATIONS.saturating_sub(rest) / step).clamp(1, MAX_SEARCHES);
    resources.iterations("water.waves and view", searches * step + rest);
    let settings = SurfaceUniforms {
        size_px: Vec2::from(size_px.map(|side| side as f32)),
        exposure: exposure as f32,
        shaft_scale: shafts.map_or(0.0, |shafts| shafts.scale as f32),
        steepest: water.steepest() as f32,
        searches: searches as u32,
    };
    let settings = resources.uniform(INFO.name, &settings);
    let walked = resources.uniform(INFO.name, &WalkUniforms { layers: 1, ..walk.clone() });
    let Layers { depths, surfaces } = dry.layers;
    let own = Bindings::new(&[&settings, &walked, depths, surfaces, dry.depth, dry.radiance])
        .and(shafts.map(|shafts| shafts.flux));
    let groups = [&shared.group, &own];
    let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
    let defs = [("SHAFTS", i32::from(shafts.is_some())), shared.water_def()];
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let pass = DrawPass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
    // At most: two rays a pixel, each as long as the picture.
    let work = pass.work(4 + 4 * u64::from(walk.max_steps), 4);
    // A ray may end at its first texel.
    let min_work = pass.work(1, 4);
    Ok(pass.stage(&INFO, work).with_min_work(min_work).image())
}
