//! `rays/march`: an invocation walks each ray and ends at the first hit. The single-shader form of SPT §2.1.

use crate::photon::Photons;
use crate::prelude::*;
use crate::screen_ray::{Rays, output, walk_turns};

pub const INFO: StageInfo = StageInfo {
    name: "rays/march",
    about: "photon rays, an invocation each, which ends at the first hit",
    source: "SPT §2.1",
};

pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    rays: &Rays<'_>,
) -> Result<Stage<Photons>, GpuError> {
    let count = rays.transfers.count;
    let photons = Photons::of_rays(resources, INFO.name, (count, rays.walking.max_hits));
    resources.turns("view × ldi.layers", walk_turns(rays.most(), rays.layers.count()));
    let own = rays.group(resources, INFO.name, Some(&photons));
    let groups = [&shared.group, &own];
    let workgroups = kit::linear_workgroups(count.into());
    let dispatch = Dispatch::new(resources, (INFO.name, &rays.defs()), &groups, workgroups)?;
    // Rays end early, and a photon that has ended is passed over on its later ways.
    let stage = Dispatch::stage([dispatch], &INFO, rays.work()).at_least(Work::default());
    let stage = stage.in_turns(rays.walking.ways).spending_inputs(rays.walking.ways > 1);
    Ok(stage.output(output(&photons)).leaving(photons))
}
