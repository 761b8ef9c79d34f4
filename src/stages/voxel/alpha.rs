//! `voxel/alpha`: the largest alpha of the triangles that touch each voxel, and bits where it is not 0. VAO Fig. 6.

use super::clear::Cleared;
use super::triangles::{Contact, Triangles};
use super::{Part, bit_volumes};
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::scene::Grid;
use crate::stages::geometry::Geometry;
use crate::stages::kit::Resources;
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "voxel/alpha",
    about: "largest alpha of the triangles that touch each voxel, by atomic maximum",
    source: "VAO Fig. 6",
};

/// Bytes of the alphas: a word a voxel.
pub fn alphas_bytes(grid: &Grid) -> u64 {
    grid.count() * 4
}

pub struct Alpha {
    triangles: Triangles,
    bytes_read: u64,
}

impl Alpha {
    pub fn new(
        resources: &Resources<'_>,
        geometry: &Geometry,
        parts: &[Part],
    ) -> Result<Self, GpuError> {
        let triangles = Triangles::new(resources, INFO.name, geometry, parts, Contact::Alpha)?;
        Ok(Self { triangles, bytes_read: geometry.bytes() })
    }

    /// What must be cleared before each frame.
    pub fn cleared(&self) -> Vec<Cleared> {
        self.triangles.cleared()
    }

    /// Each volume's alphas, 0 … 255 in a word a voxel.
    pub fn alphas(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.triangles.alphas()
    }
}

impl Stage for Alpha {
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
