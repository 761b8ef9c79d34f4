//! `transfer/bounce`: photons that have met a mirror or glass go on from there. SPT §2.3.

use crate::photon::Photons;
use crate::prelude::*;
use crate::screen_ray::{self, Layers, RayInputs, Transfer};

pub const INFO: StageInfo = StageInfo {
    name: "transfer/bounce",
    about: "photons that have met a mirror or glass, reflected or refracted",
    source: "SPT §2.3",
};

shader_struct! {
    /// `Bounce` in `shaders/transfer/bounce.wgsl`.
    pub struct BounceUniforms {
        pub first: u32,
        pub rows: u32,
        pub last: u32,
    }
}

/// Steps of a ray that are walked again for the surface that it has hit, as in `fathom::screen_ray`.
const STEPS: u64 = 3;

/// Takes turns with the stages `rays/*`: behind each way of a tile of photons. Of the photons that `tiles` turns trace on each way,
/// `photons` being what they store. A stage that traces all at once has one tile.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    rays: &RayInputs<'_>,
    photons: &Photons,
    tiles: u32,
) -> Result<Stage, GpuError> {
    let count = rays.transfers.count;
    let rows = if tiles == 1 { count } else { rays.rows() };
    let path_segments = rays.walking.path_segments;
    let walk = resources.uniform(INFO.name, &rays.uniforms());
    let defs = rays.defs();
    let turn = |turn: u32| {
        let settings = BounceUniforms {
            first: turn % tiles * rows,
            rows,
            last: u32::from(turn / tiles + 1 == path_segments),
        };
        let settings = resources.uniform(INFO.name, &settings);
        let Layers { depths, surfaces } = rays.layers;
        let own = Bindings::new(&[&settings, rays.transfers, photons, &walk, depths, surfaces]);
        let workgroups = kit::linear_workgroups(rows.into());
        Dispatch::new(resources, (INFO.name, &defs), &[&shared.group, &own], workgroups)
    };
    let turns = (0..tiles * path_segments).map(turn).collect::<Result<Vec<_>, _>>()?;
    let visits = u64::from(count) * u64::from(path_segments);
    let bytes = visits * size_of::<Transfer>() as u64 + Photons::bytes(visits);
    let work = Work {
        photons: visits,
        texel_fetches: visits * STEPS * u64::from(rays.layers.count()),
        bytes_read: bytes,
        bytes_written: bytes / 2,
        ..Work::default()
    };
    let stage = Stage::new(&INFO, work, move |scope| {
        let dispatch = &turns[scope.iteration() as usize];
        scope.compute(|pass| dispatch.run(pass));
    });
    // Photons that have ended are passed over.
    let stage = stage
        .with_min_work(Work::default())
        .with_iterations(tiles * path_segments)
        .with_spent_inputs(true);
    Ok(stage.dump(screen_ray::output(photons)))
}
