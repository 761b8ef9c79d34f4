//! `voxel/overlap`: every voxel that a triangle touches, by separating axes, a triangle an invocation.
//!
//! Akenine-Möller, *Fast 3D Triangle-Box Overlap Testing*, 2001; Schwarz and Seidel, *Fast Parallel Surface and Solid
//! Voxelization on GPUs*, 2010, §3 (conservative) and §4.1 (thin).

use super::clear::Cleared;
use super::triangles::{Contact, Triangles};
use super::{Part, bit_volumes};
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::stages::geometry::Geometry;
use crate::stages::kit::Resources;
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "voxel/overlap",
    about: "every voxel that a triangle touches, conservative or thin, by separating axes",
    source: "Schwarz and Seidel 2010, §3 and §4.1",
};

pub struct Overlap {
    triangles: Triangles,
    bytes_read: u64,
}

impl Overlap {
    /// `thin`: a 6-separating surface in place of all that is touched.
    pub fn new(
        resources: &Resources<'_>,
        geometry: &Geometry,
        parts: &[Part],
        thin: bool,
    ) -> Result<Self, GpuError> {
        let contact = if thin { Contact::Thin } else { Contact::Conservative };
        Ok(Self {
            triangles: Triangles::new(resources, INFO.name, geometry, parts, contact)?,
            bytes_read: geometry.bytes(),
        })
    }

    /// What must be cleared before each frame.
    pub fn cleared(&self) -> Vec<Cleared> {
        self.triangles.cleared()
    }
}

impl Stage for Overlap {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.triangles.encode(scope);
    }

    fn work(&self) -> Work {
        Work {
            triangles: self.triangles.triangles(),
            bytes_read: self.bytes_read,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        bit_volumes(self.triangles.volumes())
    }
}
