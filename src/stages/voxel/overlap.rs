//! `voxel/overlap`: every voxel that a triangle touches, by separating axes, a triangle an invocation.
//!
//! Akenine-Möller, *Fast 3D Triangle-Box Overlap Testing*, 2001; Schwarz and Seidel, *Fast Parallel Surface and Solid
//! Voxelization on GPUs*, 2010, §3.

use super::VoxelPart;
use super::triangles::{self, Filled};
use crate::geometry::Geometry;
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/overlap",
    about: "every voxel that a triangle touches, by separating axes",
    source: "Schwarz and Seidel 2010, §3",
};

pub fn new(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[VoxelPart],
) -> Result<Stage<Filled>, GpuError> {
    triangles::new(resources, &INFO, geometry, parts, false)
}
