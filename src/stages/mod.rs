//! Stages: the units that are timed. One file each, bearing the stem of its shader.
//!
//! A stage is made from the typed resources that earlier stages hand on, encodes its passes through the
//! [`StageScope`](crate::gpu::StageScope) it is given (which puts the timestamps there), and declares its work.

pub mod ao;
pub mod bilateral;
pub mod caustics;
pub mod compose;
pub mod frame;
pub mod geometry;
pub mod godrays;
pub mod hsao;
pub mod kit;
pub mod lit_scene;
pub mod low_pass;
pub mod marching;
pub mod photon;
pub mod photons;
pub mod ray_cast;
pub mod scalar;
pub mod scalar_field;
pub mod scene;
pub mod shadow;
pub mod splatting;
pub mod voxel;
pub mod voxels;
pub mod water;

use glam::DVec3;

use crate::gpu::Encode;
use crate::record::Work;

/// A timed unit of a pipeline.
pub trait Stage: Encode {
    /// Work of one frame, from the algorithm.
    fn work(&self) -> Work;
    /// What the stage leaves behind, for read-back and analysis.
    fn outputs(&self) -> Vec<Output>;
}

/// One output of a stage, described for analysis elsewhere.
pub struct Output {
    /// File stem of a dump.
    pub name: String,
    pub meaning: String,
    /// One per channel of a texture or float of a buffer's element.
    pub columns: Vec<Column>,
    pub data: OutputData,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Column {
    pub name: &'static str,
    pub unit: &'static str,
    pub meaning: &'static str,
}

pub enum OutputData {
    /// `count` elements of `stride_floats` 32-bit floats; `row` makes an element's columns of them.
    Buffer {
        buffer: wgpu::Buffer,
        stride_floats: u32,
        count: u32,
        row: Row,
    },
    Texture(wgpu::Texture),
    /// One level of a 3-D texture, whose cell (i, j, k) has its centre at
    /// `origin_m + spacing_m · (i + ½, j + ½, k + ½)`.
    Volume {
        texture: wgpu::Texture,
        level: u32,
        /// The corner of smallest coordinates, metres.
        origin_m: DVec3,
        /// Edges of a cell of this level, metres.
        spacing_m: DVec3,
    },
}

/// Makes the columns of an output from the floats of one element.
pub type Row = Box<dyn Fn(&[f32]) -> Vec<f32>>;

/// What `fathom list stages` says of a stage.
pub struct StageInfo {
    pub name: &'static str,
    pub about: &'static str,
    /// Paper and section.
    pub source: &'static str,
}

/// Every stage, in frame order. Adding a stage adds one line.
pub const REGISTRY: &[StageInfo] = &[
    frame::INFO,
    scene::deform::INFO,
    voxel::clear::INFO,
    voxel::slicemap::INFO_X,
    voxel::slicemap::INFO_Y,
    voxel::slicemap::INFO_Z,
    voxel::combine::INFO,
    voxel::slice::INFO,
    voxel::overlap::INFO,
    voxel::alpha::INFO,
    voxel::unpack::INFO,
    voxel::mips::INFO,
    voxel::view::INFO,
    shadow::depth::INFO,
    shadow::mask::INFO,
    scene::gbuffer::INFO,
    ao::march::INFO,
    ao::query::INFO,
    ao::bilateral::INFO,
    ao::compose::INFO,
    hsao::march::INFO,
    hsao::filter::INFO,
    water::reflection::INFO,
    water::refraction::INFO,
    caustics::trace::INFO,
    caustics::splat::INFO,
    caustics::filter::INFO,
    photons::query::INFO,
    godrays::trace::INFO,
    godrays::lines::INFO,
    godrays::filter::INFO,
    compose::INFO,
    scalar::isosurface::INFO,
    scalar::direct::INFO,
    scalar::positional::INFO,
];

#[cfg(test)]
mod tests;
