//! What `water/reflection` and `water/refraction` share: the scene lit without photons.

use crate::geometry::{self, Geometry};
use crate::prelude::*;

/// The stage `info`. It leaves radiance.
pub fn new(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    shared: &Shared,
    geometry: &Geometry,
    size_px: [u32; 2],
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let groups = [&shared.group, &Bindings::new(&[&geometry.materials])];
    let targets = (&[wgpu::TextureFormat::Rgba16Float][..], 8 + 4);
    let drawn = geometry::scene_stage(resources, info, &groups, geometry, targets, size_px)?;
    let radiance = drawn.0[0].clone();
    let mut columns = Column::many(["red", "green", "blue"], "W/(m² sr)", "radiance");
    columns.push(Column::new("covered", "1", "1 where geometry was drawn"));
    Ok(drawn.with_output(radiance).dump_as("radiance", info.about, columns))
}
