//! `voxel/overlap`: every voxel that a triangle touches, by separating axes, a triangle an invocation.
//!
//! Akenine-Möller, *Fast 3D Triangle-Box Overlap Testing*, 2001; Schwarz and Seidel, *Fast Parallel Surface and Solid
//! Voxelization on GPUs*, 2010, §3 (conservative) and §4.1 (thin).

use super::Part;
use super::triangles::{self, Contact, Filled};
use crate::geometry::Geometry;
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/overlap",
    about: "every voxel that a triangle touches, conservative or thin, by separating axes",
    source: "Schwarz and Seidel 2010, §3 and §4.1",
};

/// `thin`: a 6-separating surface in place of all that is touched.
pub fn new(
    resources: &Resources<'_>,
    geometry: &Geometry,
    parts: &[Part],
    thin: bool,
) -> Result<Stage<Filled>, GpuError> {
    let contact = if thin { Contact::Thin } else { Contact::Conservative };
    triangles::new(resources, &INFO, geometry, parts, contact)
}
