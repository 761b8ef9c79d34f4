//! `transfer/bounce`: photons that have met a mirror or glass go on from there. SPT §2.3.

use crate::frame::Shared;
use crate::kit::{Bind, Dispatch, Group, Kernel, Resources, linear_workgroups};
use crate::photon::Photons;
use crate::screen_ray::{Rays, Transfer};
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

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

/// Takes turns with the stages `rays/*`: behind each way of a tile of photons.
pub struct Bounce {
    kernel: Kernel,
    /// For each turn.
    turns: Vec<Dispatch>,
    outputs: Photons,
    work: Work,
}

impl Bounce {
    /// Of the photons that `tiles` turns trace on each way, `photons` being what they store. A stage that traces all at once has one
    /// tile.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        rays: &Rays<'_>,
        photons: &Photons,
        tiles: u32,
    ) -> Result<Self, GpuError> {
        let count = rays.transfers.count;
        let rows = if tiles == 1 { count } else { rays.rows() };
        let ways = rays.walking.ways;
        let walk = resources.uniform(INFO.name, &rays.uniforms());
        let group = |turn: u32| {
            let settings = BounceUniforms {
                first: turn % tiles * rows,
                rows,
                last: u32::from(turn / tiles + 1 == ways),
            };
            let settings = resources.uniform(INFO.name, &settings);
            let binds = [
                Bind::Uniform(&settings),
                Bind::Write(&rays.transfers.buffer),
                Bind::Write(&photons.buffer),
                Bind::Uniform(&walk),
                Bind::Layers(&rays.layers.depths),
                Bind::Layers(&rays.layers.surfaces),
            ];
            Group::new(resources.gpu, INFO.name, &binds)
        };
        let own: Vec<Group> = (0..tiles * ways).map(group).collect();
        let dispatch = |own: &Group| {
            let workgroups = linear_workgroups(rows.into());
            Dispatch::new(resources, INFO.name, &[&shared.group, own], workgroups)
        };
        let visits = u64::from(count) * u64::from(ways);
        let bytes = visits * size_of::<Transfer>() as u64 + Photons::bytes(visits);
        let defs = rays.defs();
        let shader = (INFO.name, &defs[..]);
        Ok(Self {
            kernel: Kernel::new(resources, INFO.name, shader, &[&shared.group, &own[0]])?,
            turns: own.iter().map(dispatch).collect(),
            outputs: photons.clone(),
            work: Work {
                photons: visits,
                texel_fetches: visits * STEPS * u64::from(rays.layers.count()),
                bytes_read: bytes,
                bytes_written: bytes / 2,
                ..Work::default()
            },
        })
    }
}

impl Stage for Bounce {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let dispatch = &self.turns[scope.turn() as usize];
        scope.compute(|pass| self.kernel.run(pass, dispatch));
    }

    fn turns(&self) -> u32 {
        self.turns.len() as u32
    }

    fn work(&self) -> Work {
        self.work
    }

    /// Photons that have ended are passed over.
    fn least_work(&self) -> Work {
        Work::default()
    }

    fn outputs(&self) -> Vec<Output> {
        vec![crate::screen_ray::output(&self.outputs)]
    }
}
