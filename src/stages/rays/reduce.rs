//! `rays/reduce`: the first hit of each row, in steps that halve the width. SPT §2.1. Where more are kept, rows are read whole.

use crate::photon::Photons;
use crate::prelude::*;
use crate::screen_ray::{self, RayInputs};

pub const INFO: StageInfo = StageInfo {
    name: "rays/reduce",
    about: "first hit of each photon's row, by halving the rows",
    source: "SPT §2.1",
};

/// Sides of a workgroup, as in the shader.
const WORKGROUP: u32 = 8;
const LAST_WORKGROUP: u32 = 64;

shader_struct! {
    pub struct TileUniforms {
        /// The photon of row 0.
        pub first: u32,
        pub photons: u32,
        /// Most intersections of a ray that are kept.
        pub max_hits: u32,
    }
}

/// `hits` holds a tile of photons: a photon a row.
pub fn new(
    resources: &Resources<'_>,
    hits: &wgpu::Texture,
    rays: &RayInputs<'_>,
) -> Result<Stage<Photons>, GpuError> {
    let (rows, transfers, max_hits) = (hits.height(), rays.transfers, rays.walking.max_hits);
    let dispatch = |last: i32, group: &Bindings, workgroups| {
        Dispatch::new(resources, (INFO.name, &[("LAST", last)]), &[group], workgroups)
    };
    let mut wide = hits.clone();
    let mut halvings = Vec::new();
    let mut texels = 0;
    while max_hits == 1 && wide.width() > 1 {
        let size = [wide.width().div_ceil(2), rows];
        let half = resources.image(INFO.name, size, hits.format());
        let workgroups = kit::square_workgroups(size, WORKGROUP);
        halvings.push(dispatch(0, &Bindings::new(&[&wide, &half]), workgroups)?);
        texels += kit::pixels(&half);
        wide = half;
    }
    let photons = Photons::of_rays(resources, INFO.name, transfers.count, max_hits);
    let last = |tile| {
        let tile = TileUniforms { first: tile * rows, photons: transfers.count, max_hits };
        let tile = resources.uniform(INFO.name, &tile);
        let group = Bindings::new(&[&wide, &tile, transfers, &photons]);
        dispatch(1, &group, [rows.div_ceil(LAST_WORKGROUP), 1, 1])
    };
    let lasts = (0..rays.tiles()).map(last).collect::<Result<Vec<_>, _>>()?;
    let iterations = lasts.len() as u32 * rays.walking.path_segments;
    let read = if max_hits == 1 { 2 * texels } else { kit::pixels(&wide) };
    let work = Work {
        photons: transfers.count.into(),
        texel_fetches: u64::from(iterations) * read,
        bytes_written: u64::from(iterations) * texels * 4 + Photons::bytes(photons.count.into()),
        ..Work::default()
    };
    // A hit hides its right neighbour; all turns write to the same textures.
    let min_work =
        Work { texel_fetches: work.texel_fetches / 2, bytes_written: texels * 4, ..work };
    let stage = Stage::new(&INFO, work, move |scope| {
        let last = &lasts[scope.iteration() as usize % lasts.len()];
        scope.compute(|pass| halvings.iter().chain([last]).for_each(|step| step.run(pass)));
    });
    let output = screen_ray::output(&photons);
    let stage = stage
        .with_min_work(min_work)
        .with_iterations(iterations)
        .with_spent_inputs(rays.walking.path_segments > 1);
    Ok(stage.dump(output).with_output(photons))
}
