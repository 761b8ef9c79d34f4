//! `transfer/map`: where each photon of the light's grid enters the water, and its refracted direction. SPT §2.

use glam::{UVec2, Vec2};

use crate::prelude::*;
use crate::screen_ray::{Transfer, Transfers};

pub const INFO: StageInfo = StageInfo {
    name: "transfer/map",
    about: "position and direction of each photon behind the water's surface",
    source: "SPT §2",
};

shader_struct! {
    pub struct MapUniforms {
        /// Photons along the light's screen, to the right and upwards.
        pub grid: UVec2,
        /// Place of a photon within its cell.
        pub offset: Vec2,
    }
}

/// What becomes of the light's photons at the water.
pub struct TransferMap {
    pub transfers: Transfers,
    /// Of each photon: its share of the flux that one in the middle of the light's frustum carries.
    pub weights: Buffer,
}

/// `mask` is where the light sees the water first.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    mask: &wgpu::Texture,
    settings: &MapUniforms,
) -> Result<Stage<TransferMap>, GpuError> {
    let count = settings.grid.x * settings.grid.y;
    let transfers = Transfers::new(resources, INFO.name, count);
    let uniforms = resources.uniform(INFO.name, settings);
    let weights = resources.storage(INFO.name, u64::from(count) * 4);
    let groups = [&shared.group, &Bindings::new(&[&uniforms, mask, &transfers, &weights])];
    let defs = [shared.water_def(), shared.fresnel_def()];
    let workgroups = kit::linear_workgroups(count.into());
    let dispatch = Dispatch::new(resources, (INFO.name, &defs), &groups, workgroups)?;
    let photons = u64::from(count);
    let bytes_written = photons * (size_of::<Transfer>() as u64 + 4);
    let work = Work { photons, bytes_written, ..Work::default() };
    let stage = Dispatch::stage([dispatch], &INFO, work).dump(transfers.output());
    Ok(stage.with_output(TransferMap { transfers, weights }))
}
