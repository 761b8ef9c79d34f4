//! `shadow/depth`: scene depth from the light. UW §3 step 2a.

use crate::geometry::{self, Geometry};
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "shadow/depth",
    about: "scene depth from the light, for the image-space estimator",
    source: "UW §3 step 2a",
};

/// `size` texels per side.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    geometry: &Geometry,
    size: u32,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let groups = [&shared.group];
    let drawn = geometry::scene_stage(resources, &INFO, &groups, geometry, (&[], 4), [size; 2])?;
    let depth = drawn.output.1.clone();
    let meaning =
        "depth of the scene along the light, 0 near plane to 1 far plane; row 0 is ndc y = +1";
    let column = Column::new("depth", "1", "normalised device depth of the light");
    Ok(drawn.with_output(depth).dump_as("depth", meaning, vec![column]))
}
