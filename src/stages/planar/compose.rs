//! `planar/compose`: the picture, its pool lit by the illumination map, or the map of the floor. SPT §1.1, Fig. 2.

use serde::{Deserialize, Serialize};

use crate::gbuffer::GbufferTextures;
use crate::pool::Pool;
use crate::prelude::*;
use crate::screen_picture::ComposeUniforms;

pub const INFO: StageInfo = StageInfo {
    name: "planar/compose",
    about: "the picture: what the camera sees, lit by the illumination map and sky",
    source: "SPT §1.1, Fig. 2",
};

/// What the picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shown {
    /// The lit scene.
    Image,
    /// The illumination map of the floor, texel by texel, on white. SPT Fig. 2, right.
    FloorMap,
}

fathom_base::choices!(Shown);

/// Albedo, normal and depth of a pixel, and four texels of the map.
const FETCHES: u64 = 7;

/// `map` is the illumination map of the pool.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GbufferTextures,
    (map, pool): (&wgpu::Texture, &Pool),
    exposure: f64,
    shown: Shown,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let GbufferTextures { albedo, normal, depth } = gbuffer;
    let size_px = kit::size_px(depth);
    let settings = resources.uniform(INFO.name, &ComposeUniforms::new(size_px, exposure));
    let pool = pool.uniform(resources);
    let own = Group::new(&[&settings, &pool, albedo, normal, depth, map]);
    let groups = [&shared.group, &own];
    let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
    let defs = [("MAP", i32::from(shown == Shown::FloorMap))];
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let pass = Pass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
    // The background has no texels but its depth.
    let (work, least) = (pass.work(FETCHES, 4), pass.work(1, 4));
    Ok(pass.stage(&INFO, work).at_least(least).image())
}
