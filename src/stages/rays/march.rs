//! `rays/march`: an invocation walks each ray and ends at the first hit. The single-shader form of SPT §2.1, which is a pixel shader there.

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
    let (photons, own) = outputs(resources, rays);
    let workgroups = kit::linear_workgroups(rays.transfers.count.into());
    let (defs, groups) = (rays.defs(), [&shared.group, &own]);
    let dispatch = Dispatch::new(resources, (INFO.name, &defs), &groups, workgroups)?;
    Ok(finished(Dispatch::stage([dispatch], &INFO, rays.work()), rays, photons))
}

/// The same by a pixel shader: a pixel of a square target for each ray. The target keeps the distance of the first hit, metres.
///
/// # Errors
/// As of [`new`].
pub fn drawn(
    resources: &Resources<'_>,
    shared: &Shared,
    rays: &RayInputs<'_>,
) -> Result<Stage<Photons>, GpuError> {
    let (photons, own) = outputs(resources, rays);
    let side = f64::from(rays.transfers.count).sqrt().ceil().max(1.0) as u32;
    let [test] = rays.defs();
    let (defs, groups) = ([test, ("SIDE", side as i32)], [&shared.group, &own]);
    let targets = [kit::opaque(wgpu::TextureFormat::R32Float)];
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let pass = DrawPass::new(resources, &spec, [side; 2], wgpu::Color::TRANSPARENT)?;
    resources.fragment_writes(INFO.name);
    Ok(finished(pass.stage(&INFO, rays.work()).with_output(()), rays, photons))
}

fn outputs(resources: &Resources<'_>, rays: &RayInputs<'_>) -> (Photons, Bindings) {
    let (count, max_hits) = (rays.transfers.count, rays.walking.max_hits);
    let photons = Photons::of_rays(resources, INFO.name, count, max_hits);
    resources
        .iterations("view × ldi.layers", walk_iterations(rays.max_steps(), rays.layers.count()));
    let own = rays.group(resources, INFO.name, Some(&photons));
    (photons, own)
}

fn finished(stage: Stage, rays: &RayInputs<'_>, photons: Photons) -> Stage<Photons> {
    // Of each photon the state, a word, is read: rays end early, and a photon that has ended is passed over.
    let bytes_read = u64::from(rays.transfers.count) * 4;
    let stage = stage
        .with_min_work(Work { bytes_read, ..Work::default() })
        .with_iterations(rays.walking.path_segments)
        .with_spent_inputs(rays.walking.path_segments > 1);
    stage.dump(output(&photons)).with_output(photons)
}
