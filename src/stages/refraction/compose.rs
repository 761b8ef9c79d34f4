//! `refraction/compose`: the picture, through glass by its exit rays. SPT §4.

use super::Exits;
use crate::StageInfo;
use crate::frame::Shared;
use crate::gbuffer::GbufferTextures;
use crate::kit::{Bind, Resources};
use crate::screen_picture::Picture;
use fathom_gpu::GpuError;
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "refraction/compose",
    about: "the picture: the environment, what stands in it, and what is seen of it through glass",
    source: "SPT §4",
};

pub fn picture(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GbufferTextures,
    exits: &Exits,
    exposure: f64,
) -> Result<Picture, GpuError> {
    let rays = vec![Bind::Texels(&exits.positions), Bind::Texels(&exits.directions)];
    let of_pixel = Work { texel_fetches: 2, ..Work::default() };
    Picture::new(resources, shared, &INFO, (gbuffer, rays), exposure, of_pixel)
}
