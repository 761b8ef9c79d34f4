//! `voxel/alpha`: the largest alpha of the triangles that touch each voxel, and bits where it is not 0. VAO Fig. 6.

use super::VoxelPart;
use super::triangles::{self, Filled};
use crate::geometry::Geometry;
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/alpha",
    about: "largest alpha of the triangles that touch each voxel, by atomic maximum",
    source: "VAO Fig. 6",
};

pub fn new(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[VoxelPart],
) -> Result<Stage<Filled>, GpuError> {
    triangles::new(resources, &INFO, geometry, parts, true)
}
