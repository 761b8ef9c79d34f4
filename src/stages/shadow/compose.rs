//! `shadow/compose`: the picture, lit where rays to the light meet nothing. SPT §5.

use crate::StageInfo;
use crate::frame::Shared;
use crate::gbuffer::GbufferTextures;
use crate::kit::{Bind, Resources};
use crate::photon::Photons;
use crate::screen_picture::Picture;
use fathom_gpu::GpuError;
use fathom_record::Work;

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
