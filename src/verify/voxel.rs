//! Stages of the family `voxel`: against separating axes and samples in f64, and bit by bit against twins on the CPU.

mod contact;
mod cubes;
mod packing;
mod pyramid;
mod raster;
pub mod subjects;

use super::Case;

pub fn cases() -> Vec<Case> {
    [packing::cases(), raster::cases(), contact::cases(), pyramid::cases(), cubes::cases()]
        .into_iter()
        .flatten()
        .collect()
}
