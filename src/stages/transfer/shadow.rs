//! `transfer/shadow`: a ray from each pixel's surface back to the light. SPT §5.

use glam::UVec2;

use crate::prelude::*;
use crate::screen_ray::{Layers, Transfer, Transfers};

pub const INFO: StageInfo = StageInfo {
    name: "transfer/shadow",
    about: "a ray from each pixel's surface back to the light",
    source: "SPT §5",
};

/// Sides of a workgroup, as in the shader.
const WORKGROUP: u32 = 8;

shader_struct! {
    pub struct ShadowUniforms {
        pub size_px: UVec2,
        pub receivers_only: u32,
    }
}

/// From the nearest layer, of receivers alone where that is asked; the stage leaves a pixel an entry, row by row.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    layers: &Layers,
    receivers_only: bool,
) -> Result<Stage<Transfers>, GpuError> {
    let size = layers.size_px();
    let transfers = Transfers::new(resources, INFO.name, size[0].saturating_mul(size[1]));
    let settings = ShadowUniforms { size_px: size.into(), receivers_only: receivers_only.into() };
    let uniforms = resources.uniform(INFO.name, &settings);
    let own = Bindings::new(&[&uniforms, &layers.depths, &layers.surfaces, &transfers]);
    let (groups, workgroups) = ([&shared.group, &own], kit::square_workgroups(size, WORKGROUP));
    let dispatch = Dispatch::new(resources, INFO.name, &groups, workgroups)?;
    let rays = u64::from(transfers.count);
    let bytes_written = rays * size_of::<Transfer>() as u64;
    let work = Work { texel_fetches: 2 * rays, bytes_written, ..Work::default() };
    // The background has no texels but its depth.
    let min_work = Work { texel_fetches: rays, ..work };
    let stage = Dispatch::stage([dispatch], &INFO, work).with_min_work(min_work);
    Ok(stage.dump(transfers.output()).with_output(transfers))
}
