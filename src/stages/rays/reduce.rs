//! `rays/reduce`: the first hit of each row, in steps that halve the width. SPT §2.1.

use crate::kit::{self, Bind, Dispatch, Group, Kernel, Resources};
use crate::photon::Photons;
use crate::screen_ray::{self, Rays};
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "rays/reduce",
    about: "first hit of each photon's row, by halving the rows",
    source: "SPT §2.1",
};

/// Sides of a workgroup, as in the shader.
const WORKGROUP: u32 = 8;
const LAST_WORKGROUP: u32 = 64;

shader_struct! {
    /// `Tile` in `shaders/rays/reduce.wgsl`.
    pub struct TileUniforms {
        pub first: u32,
        pub photons: u32,
    }
}

pub struct Reduce {
    halve: Kernel,
    halvings: Vec<Dispatch>,
    last: Kernel,
    /// For each tile.
    lasts: Vec<Dispatch>,
    pub photons: Photons,
    ways: u32,
    texels: u64,
}

impl Reduce {
    /// `hits` holds a tile of photons: a photon a row.
    pub fn new(
        resources: &Resources<'_>,
        hits: &wgpu::Texture,
        rays: &Rays<'_>,
    ) -> Result<Self, GpuError> {
        let (rows, transfers) = (hits.height(), rays.transfers);
        let mut narrower = vec![hits.clone()];
        let mut groups = Vec::new();
        let mut texels = 0;
        while let Some(wide) = narrower.last().filter(|wide| wide.width() > 1).cloned() {
            let size = [wide.width().div_ceil(2), rows];
            let half = resources.image(INFO.name, size, hits.format());
            let binds = [Bind::Texels(&wide), Bind::Store(&half)];
            groups.push((Group::new(resources.gpu, INFO.name, &binds), size));
            texels += kit::pixels(&half);
            narrower.push(half);
        }
        let halving = |(group, size): &(Group, [u32; 2])| {
            let [x, y] = size.map(|side| side.div_ceil(WORKGROUP));
            Dispatch::new(resources, INFO.name, &[group], [x, y, 1])
        };
        let photons = Photons::new(resources, INFO.name, transfers.count);
        let tiles = (0..rays.tiles()).map(|tile| {
            let tile = TileUniforms { first: tile * rows, photons: transfers.count };
            let tile = resources.uniform(INFO.name, &tile);
            let column = &narrower[narrower.len() - 1];
            let binds = [
                Bind::Texels(column),
                Bind::Uniform(&tile),
                Bind::Read(&transfers.buffer),
                Bind::Write(&photons.buffer),
            ];
            Group::new(resources.gpu, INFO.name, &binds)
        });
        let tiles: Vec<Group> = tiles.collect();
        let kernel = |last: i32, group: &Group| {
            let defs = [("LAST", last)];
            Kernel::new(resources, INFO.name, (INFO.name, &defs[..]), &[group])
        };
        let dispatch = |group: &Group| {
            Dispatch::new(resources, INFO.name, &[group], [rows.div_ceil(LAST_WORKGROUP), 1, 1])
        };
        Ok(Self {
            halve: kernel(0, &groups[0].0)?,
            halvings: groups.iter().map(halving).collect(),
            last: kernel(1, &tiles[0])?,
            lasts: tiles.iter().map(dispatch).collect(),
            photons,
            ways: rays.walking.ways,
            texels,
        })
    }
}

impl Stage for Reduce {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let last = &self.lasts[scope.turn() as usize % self.lasts.len()];
        scope.compute(|pass| {
            for halving in &self.halvings {
                self.halve.run(pass, halving);
            }
            self.last.run(pass, last);
        });
    }

    fn turns(&self) -> u32 {
        self.lasts.len() as u32 * self.ways
    }

    fn work(&self) -> Work {
        let (photons, turns) = (u64::from(self.photons.count), u64::from(self.turns()));
        Work {
            photons,
            texel_fetches: turns * 2 * self.texels,
            bytes_written: turns * self.texels * 4 + Photons::bytes(photons),
            ..Work::default()
        }
    }

    /// A hit hides its right neighbour; all turns write to the same textures.
    fn least_work(&self) -> Work {
        let photons = u64::from(self.photons.count);
        Work {
            texel_fetches: u64::from(self.turns()) * self.texels,
            bytes_written: self.texels * 4,
            photons,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![screen_ray::output(&self.photons)]
    }
}
