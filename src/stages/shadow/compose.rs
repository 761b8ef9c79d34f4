//! `shadow/compose`: the picture, lit where rays to the light meet nothing. SPT §5.

use crate::gbuffer::GbufferTextures;
use crate::photon::Photons;
use crate::prelude::*;
use crate::screen_picture;

pub const INFO: StageInfo = StageInfo {
    name: "shadow/compose",
    about: "the picture: what the camera sees, lit where its ray to the light meets nothing",
    source: "SPT §5",
};

/// `photons` are the ends of the rays of `transfer/shadow`.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GbufferTextures,
    photons: &Photons,
    exposure: f64,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let of_pixel = Work { bytes_read: Photons::bytes(1), ..Work::default() };
    screen_picture::new(resources, shared, &INFO, (gbuffer, &[photons]), exposure, of_pixel)
}
