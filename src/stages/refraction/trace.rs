//! `refraction/trace`: lines of sight through glass, refracted several times, through layers of depth. SPT §4.

use glam::UVec2;

use super::{Exits, FORMAT};
use crate::photon::Photons;
use crate::prelude::*;
use crate::screen_ray::{Layers, SightUniforms, WalkUniforms, walk_iterations};

pub const INFO: StageInfo = StageInfo {
    name: "refraction/trace",
    about: "lines of sight through glass, refracted several times, through layers of depth",
    source: "SPT §4",
};

shader_struct! {
    pub struct ExitUniforms {
        /// Surfaces that refract a ray.
        pub refractions: u32,
        /// ENDS 1: the rectangle of pixels that have lines.
        pub first: UVec2,
        pub count: UVec2,
    }
}

/// Lines of sight of a rectangle of pixels, and the ends of their lines.
pub struct SightLines<'a> {
    pub sight: &'a SightUniforms,
    pub ends: &'a Photons,
}

/// Through `layers` of what refracts, at most `refractions` times. Without lines each ray is walked.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    layers: &Layers,
    walk: &WalkUniforms,
    refractions: u32,
    lines: Option<SightLines<'_>>,
) -> Result<Stage<Exits>, GpuError> {
    let iterations = u64::from(refractions) * (walk_iterations(walk.max_steps, 0) + 2) + 1;
    resources.iterations("refractions × view", iterations);
    let walked = resources.uniform(INFO.name, walk);
    let [first, count] =
        lines.as_ref().map_or([UVec2::ZERO; 2], |lines| [lines.sight.first, lines.sight.count]);
    let settings = resources.uniform(INFO.name, &ExitUniforms { refractions, first, count });
    let own = Bindings::new(&[&walked, &settings, &layers.depths, &layers.surfaces])
        .and(lines.as_ref().map(|lines| lines.ends));
    let groups = [&shared.group, &own];
    let defs = [("ENDS", i32::from(lines.is_some()))];
    let targets = [FORMAT; 2].map(kit::opaque);
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let pass = DrawPass::new(resources, &spec, layers.size_px(), wgpu::Color::TRANSPARENT)?;
    let exits = Exits::from_pass(&pass);
    // At most: each ray as long as the picture.
    let max = if lines.is_some() { layers.count() } else { walk.max_steps };
    let steps = u64::from(refractions.saturating_sub(1)) * u64::from(max);
    let work = pass.work(4 * steps + 2, 32);
    // A ray may end at its first texel.
    let min_work = pass.work(1, 32);
    Ok(pass.stage(&INFO, work).with_min_work(min_work).dumps(exits.outputs()).with_output(exits))
}
