//! Stages: the units that are timed. Each has a file with the same stem as its shader.
//!
//! A stage is made from the typed resources of earlier stages. It encodes its passes through the
//! [`StageScope`](crate::gpu::StageScope), which writes the timestamps, and declares its work.

pub mod ao;
pub mod bilateral;
pub mod caustics;
pub mod compose;
pub mod counters;
mod entry;
pub mod frame;
pub mod gbuffer;
pub mod geometry;
pub mod godrays;
pub mod hsao;
pub mod kit;
pub mod ldi;
pub mod lit_scene;
pub mod low_pass;
pub mod marching;
pub mod photon;
pub mod photons;
pub mod planar;
pub mod pool;
pub mod post;
pub mod ray_cast;
pub mod rays;
pub mod refraction;
pub mod scalar;
pub mod scalar_field;
pub mod scene;
pub mod screen_picture;
pub mod screen_ray;
pub mod shadow;
pub mod shafts;
pub mod slices;
pub mod splatting;
pub mod sprites;
pub mod transfer;
pub mod voxel;
pub mod voxels;
pub mod water;

pub use crate::gpu::{Column, Output, OutputData, ReadRow, Stage, StageInfo};

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
    ao::glass::INFO,
    hsao::march::INFO,
    hsao::filter::INFO,
    water::reflection::INFO,
    water::refraction::INFO,
    caustics::trace::INFO,
    caustics::splat::INFO,
    caustics::mesh::INFO,
    caustics::filter::INFO,
    photons::query::INFO,
    godrays::trace::INFO,
    godrays::lines::INFO,
    godrays::filter::INFO,
    compose::INFO,
    transfer::map::INFO,
    transfer::shadow::INFO,
    ldi::peel::INFO,
    ldi::lists::INFO,
    ldi::sort::INFO,
    rays::rasterize::INFO,
    rays::reduce::INFO,
    rays::march::INFO,
    rays::group::INFO,
    transfer::bounce::INFO,
    sprites::draw::INFO,
    shafts::lines::INFO,
    shafts::blur::INFO,
    sprites::compose::INFO,
    shadow::compose::INFO,
    refraction::surface::INFO,
    refraction::trace::INFO,
    refraction::two_interface::INFO,
    refraction::compose::INFO,
    planar::points::INFO,
    planar::compose::INFO,
    post::luminance::INFO,
    scalar::isosurface::INFO,
    scalar::direct::INFO,
    scalar::positional::INFO,
];
