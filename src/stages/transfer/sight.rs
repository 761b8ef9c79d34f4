//! `transfer/sight`: lines of sight behind the first surface of glass. SPT §4.

use crate::prelude::*;
use crate::screen_ray::{Layers, SightUniforms, Transfer, Transfers};

pub const INFO: StageInfo = StageInfo {
    name: "transfer/sight",
    about: "lines of sight behind the first surface of glass, and the depths of two layers in one texel",
    source: "SPT §4",
};

/// Sides of a workgroup, as in the shader.
const WORKGROUP: u32 = 8;

/// Through a rectangle of pixels, a ray each; with them the layers that a ray is held against: the first two in one.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    layers: &Layers,
    sight: &SightUniforms,
) -> Result<Stage<(Transfers, Layers)>, GpuError> {
    let size = layers.size_px();
    let transfers = Transfers::new(resources, INFO.name, sight.count.element_product());
    let pairs = resources.image(INFO.name, size, wgpu::TextureFormat::Rg32Float);
    let uniforms = resources.uniform(INFO.name, sight);
    let own = Bindings::new(&[&uniforms, &layers.depths, &layers.surfaces, &transfers, &pairs]);
    let (groups, workgroups) = ([&shared.group, &own], kit::square_workgroups(size, WORKGROUP));
    let dispatch = Dispatch::new(resources, INFO.name, &groups, workgroups)?;
    let (rays, pixels) = (u64::from(transfers.count), kit::pixels(&pairs));
    let bytes_written = rays * size_of::<Transfer>() as u64 + pixels * 8;
    let work = Work { texel_fetches: 2 * pixels + rays, bytes_written, ..Work::default() };
    let stage = Dispatch::stage([dispatch], &INFO, work).dump(transfers.output());
    Ok(stage.with_output((transfers, Layers { depths: pairs, surfaces: layers.surfaces.clone() })))
}
