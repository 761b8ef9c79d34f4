//! `planar/compose`: the picture, its pool lit by the illumination map, or the map of the floor. SPT §1.1, Fig. 2.

use serde::{Deserialize, Serialize};

use crate::gbuffer::GBuffer;
use crate::picture::Picture;
use crate::pool::Pool;
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "planar/compose",
    about: "the picture: what the camera sees, lit by the illumination map and sky",
    source: "SPT §1.1, Fig. 2",
};

/// What the picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlanarView {
    /// The lit scene.
    Image,
    /// The illumination map of the floor, texel by texel, on white. SPT Fig. 2, right.
    FloorMap,
}

fathom_base::choices!(PlanarView);

/// `map` is the illumination map of the pool.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    gbuffer: &GBuffer,
    map: &wgpu::Texture,
    pool: &Pool,
    exposure: f64,
    shown: PlanarView,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let pool = resources.uniform("pool", pool);
    let defs = [("MAP", i32::from(shown == PlanarView::FloorMap))];
    let picture = Picture::new(gbuffer, exposure, 0.0);
    // Albedo, normal and depth of a pixel, and four texels of the map.
    Ok(picture.stage(resources, shared, &INFO, &defs, &[&pool, map], [7, 1])?.image())
}
