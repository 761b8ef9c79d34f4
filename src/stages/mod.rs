//! Stages: the units that are timed. One file each, bearing the stem of its shader.
//!
//! A stage is made from the typed resources that earlier stages hand on, encodes its passes through the
//! [`StageScope`](crate::gpu::StageScope) it is given (which puts the timestamps there), and declares its work.

pub mod caustics;
pub mod compose;
pub mod frame;
pub mod geometry;
pub mod godrays;
pub mod kit;
pub mod lit_scene;
pub mod low_pass;
pub mod photon;
pub mod scene;
pub mod shadow;
pub mod splatting;
pub mod water;

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
    /// `count` elements of `stride_floats` 32-bit floats.
    Buffer {
        buffer: wgpu::Buffer,
        stride_floats: u32,
        count: u32,
    },
    Texture(wgpu::Texture),
}

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
    shadow::depth::INFO,
    shadow::mask::INFO,
    scene::gbuffer::INFO,
    water::reflection::INFO,
    water::refraction::INFO,
    caustics::trace::INFO,
    caustics::splat::INFO,
    caustics::filter::INFO,
    godrays::trace::INFO,
    godrays::lines::INFO,
    godrays::filter::INFO,
    compose::INFO,
];
