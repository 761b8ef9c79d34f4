//! `photons/query`: photons from given starts through the water to the scene. UW §3.3.

use bytemuck::{Pod, Zeroable};
use encase::ShaderType;
use glam::Vec3;

use crate::photon::{Photon, TraceUniforms};
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "photons/query",
    about: "photons from given starts: water intersection, refraction, image-space estimator",
    source: "UW §3.3",
};

shader_struct! {
    /// `Start` in `shaders/photons/query.wgsl`.
    pub struct Start {
        pub position_m: Vec3,
        /// 1: the direction is given; 0: the light's own ray runs through the start.
        pub aimed: u32,
        /// Of unit length where it is given.
        pub direction: Vec3,
    }
}

shader_struct! {
    /// `Answer` in `shaders/photons/query.wgsl`.
    #[repr(C)]
    #[derive(Copy, Pod, Zeroable)]
    pub struct Answer {
        pub photon: Photon,
        /// After refraction, unit length; 0 for a photon that never enters the water.
        pub direction: Vec3,
        /// Share of a photon's flux that enters the water.
        pub weight: f32,
    }
}

/// `starts` holds one at least; `depth` and `mask` are the light's. Of the settings the grid plays no part. The stage leaves an
/// [`Answer`] for each start.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    (depth, mask): (&wgpu::Texture, &wgpu::Texture),
    starts: &[Start],
    settings: &TraceUniforms,
    conserving: bool,
) -> Result<Stage<Buffer>, GpuError> {
    let resources = &resources.sized_by("starts");
    let defs = [("CONSERVING", i32::from(conserving)), shared.fresnel_def(), shared.water_def()];
    let input = resources.structs("starts", starts, wgpu::BufferUsages::empty());
    let count = starts.len() as u64;
    let answers = resources.room_for::<Answer>(INFO.name, count);
    let uniforms = resources.uniform(INFO.name, settings);
    let texels = resources.nearest_sampler(INFO.name);
    let own = Group::new(&[&uniforms, depth, mask, &input, &answers, &texels]);
    let (groups, workgroups) = ([&shared.group, &own], kit::linear_workgroups(count));
    let dispatch = Dispatch::new(resources, (INFO.name, &defs), &groups, workgroups)?;
    let work = Work {
        photons: count,
        // Four depth texels a place.
        texel_fetches: count * 4 * u64::from(settings.lookups),
        bytes_read: count * Start::min_size().get(),
        bytes_written: count * Answer::min_size().get(),
        ..Work::default()
    };
    // The search ends where a photon has landed.
    let least = Work { texel_fetches: 0, ..work };
    let columns =
        vec![Column::new("weight", "1", "share of a photon's flux that enters the water")];
    let rows = (&*answers, size_of::<Answer>() / 4, count as u32);
    let meaning = "weight of each photon, in the order of the starts";
    let output = Output::rows("answers", meaning, columns, rows, |floats| vec![floats[11]]);
    let stage = Dispatch::stage([dispatch], &INFO, work).at_least(least);
    Ok(stage.output(output).leaving(answers))
}
