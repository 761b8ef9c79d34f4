//! `rays/march`: an invocation walks each ray and ends at the first hit. The single-shader form of SPT §2.1.

use crate::photon::Photons;
use crate::prelude::*;
use crate::screen_ray::{RayInputs, output, walk_iterations};

pub const INFO: StageInfo = StageInfo {
    name: "rays/march",
    about: "photon rays, an invocation each, which ends at the first hit",
    source: "SPT §2.1",
};

pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    rays: &RayInputs<'_>,
) -> Result<Stage<Photons>, GpuError> {
    let count = rays.transfers.count;
    let photons = Photons::of_rays(resources, INFO.name, count, rays.walking.max_hits);
    resources
        .iterations("view × ldi.layers", walk_iterations(rays.max_steps(), rays.layers.count()));
    let own = rays.group(resources, INFO.name, Some(&photons));
    let groups = [&shared.group, &own];
    let workgroups = kit::linear_workgroups(count.into());
    let dispatch = Dispatch::new(resources, (INFO.name, &rays.defs()), &groups, workgroups)?;
    // Of each photon the state, a word, is read: rays end early, and a photon that has ended is passed over.
    let min_work = Work { bytes_read: u64::from(count) * 4, ..Work::default() };
    let stage = Dispatch::stage([dispatch], &INFO, rays.work()).with_min_work(min_work);
    let stage = stage
        .with_iterations(rays.walking.path_segments)
        .with_spent_inputs(rays.walking.path_segments > 1);
    Ok(stage.dump(output(&photons)).with_output(photons))
}
