//! `refraction/compose`: the picture, through glass by its exit rays. SPT §4.

use super::Exits;
use crate::gbuffer::GbufferTextures;
use crate::prelude::*;
use crate::screen_picture;

pub const INFO: StageInfo = StageInfo {
    name: "refraction/compose",
    about: "the picture: the environment, what stands in it, and what is seen of it through glass",
    source: "SPT §4",
};

pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GbufferTextures,
    exits: &Exits,
    exposure: f64,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let rays: [&dyn Bind; 2] = [&exits.positions, &exits.directions];
    let of_pixel = Work { texel_fetches: 2, ..Work::default() };
    screen_picture::new(resources, shared, &INFO, (gbuffer, &rays), exposure, of_pixel)
}
