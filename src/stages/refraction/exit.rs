//! `refraction/exit`: what becomes of lines of sight where they leave glass. SPT §4.

use super::{Exits, FORMAT};
use crate::photon::Photons;
use crate::prelude::*;
use crate::screen_ray::{Layers, Transfers, WalkUniforms};
use crate::transfer::sight::SightUniforms;

pub const INFO: StageInfo = StageInfo {
    name: "refraction/exit",
    about: "lines of sight behind glass, refracted where their lines have left it",
    source: "SPT §4",
};

/// `ends` are those of the rays `transfers` of `transfer/sight`.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    (layers, walk): (&Layers, &WalkUniforms),
    (transfers, ends): (&Transfers, &Photons),
    sight: &SightUniforms,
) -> Result<Stage<Exits>, GpuError> {
    let sight = resources.uniform(INFO.name, sight);
    let walk = resources.uniform(INFO.name, walk);
    let own = Group::new(&[&sight, &walk, &layers.depths, &layers.surfaces, transfers, ends]);
    let groups = [&shared.group, &own];
    let targets = [FORMAT; 2].map(kit::opaque);
    let spec = RenderSpec::new(INFO.name, &groups, &targets);
    let pass = Pass::new(resources, &spec, layers.size_px(), wgpu::Color::TRANSPARENT)?;
    let exits = Exits::of(&pass);
    let (work, least) = (pass.work(2 * u64::from(layers.count()), 32), pass.work(0, 32));
    Ok(pass.stage(&INFO, work).at_least(least).outputs(exits.outputs()).leaving(exits))
}
