//! `refraction/trace`: lines of sight through glass, refracted several times, through layers of depth. SPT §4.

use super::{Exits, FORMAT};
use crate::prelude::*;
use crate::screen_ray::{Layers, WalkUniforms, walk_turns};

pub const INFO: StageInfo = StageInfo {
    name: "refraction/trace",
    about: "lines of sight through glass, refracted several times, through layers of depth",
    source: "SPT §4",
};

shader_struct! {
    /// `Trace` in `shaders/refraction/trace.wgsl`.
    pub struct TraceUniforms {
        pub refractions: u32,
    }
}

/// Through `layers` of what refracts, at most `refractions` times.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    layers: &Layers,
    walk: &WalkUniforms,
    refractions: u32,
) -> Result<Stage<Exits>, GpuError> {
    let turns = u64::from(refractions) * (walk_turns(walk.most, 0) + 2) + 1;
    resources.turns("refractions × view", turns);
    let walked = resources.uniform(INFO.name, walk);
    let settings = resources.uniform(INFO.name, &TraceUniforms { refractions });
    let own = Group::new(&[&walked, &settings, &layers.depths, &layers.surfaces]);
    let groups = [&shared.group, &own];
    let targets = [FORMAT; 2].map(kit::opaque);
    let spec = RenderSpec::new(INFO.name, &groups, &targets);
    let pass = Pass::new(resources, &spec, layers.size_px(), wgpu::Color::TRANSPARENT)?;
    let exits = Exits::of(&pass);
    // At most: each ray as long as the picture.
    let steps = u64::from(refractions.saturating_sub(1)) * u64::from(walk.most);
    let work = pass.work(4 * steps + 2, 32);
    // A ray may end at its first texel.
    let least = pass.work(1, 32);
    Ok(pass.stage(&INFO, work).at_least(least).outputs(exits.outputs()).leaving(exits))
}
