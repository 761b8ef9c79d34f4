//! `shadow/compose`: the picture, lit where rays to the light meet nothing. SPT §5.

use crate::gpu::GpuError;
use crate::record::Work;
use crate::stages::StageInfo;
use crate::stages::frame::Shared;
use crate::stages::gbuffer::GbufferTextures;
use crate::stages::kit::{Bind, Resources};
use crate::stages::photon::Photons;
use crate::stages::screen_picture::Picture;

pub const INFO: StageInfo = StageInfo {
    name: "shadow/compose",
    about: "the picture: what the camera sees, lit where its ray to the light meets nothing",
    source: "SPT §5",
};

/// `photons` are the ends of the rays of `transfer/shadow`.
pub fn picture(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GbufferTextures,
    photons: &Photons,
    exposure: f64,
) -> Result<Picture, GpuError> {
    let rays = vec![Bind::Read(&photons.buffer)];
    let of_pixel = Work { bytes_read: Photons::bytes(1), ..Work::default() };
    Picture::new(resources, shared, &INFO, (gbuffer, rays), exposure, of_pixel)
}
