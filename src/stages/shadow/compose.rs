//! `shadow/compose`: the picture, lit where rays to the light meet nothing. SPT §5.

use crate::gbuffer::GBuffer;
use crate::photon::Photons;
use crate::picture::Picture;
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "shadow/compose",
    about: "the picture: what the camera sees, lit where its ray to the light meets nothing",
    source: "SPT §5",
};

/// `photons` are the ends of the rays of `transfer/shadow`.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GBuffer,
    photons: &Photons,
    exposure: f64,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let picture = Picture::new(gbuffer, exposure, 0.0);
    let mut stage = picture.stage(resources, shared, &INFO, &[], &[photons], [3, 1])?.image();
    stage.work.bytes_read = Photons::bytes(photons.count.into());
    Ok(stage)
}
