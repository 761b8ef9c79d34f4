//! What stages of several families share.

pub mod bilateral;
pub mod counters;
pub(crate) mod entry;
pub mod flat_triangles;
pub mod gbuffer;
pub mod geometry;
pub mod lit_scene;
pub mod low_pass;
pub mod marching;
pub mod photon;
pub mod picture;
pub mod pool;
pub mod ray_cast;
pub mod scalar_field;
pub mod screen_ray;
pub mod slices;
pub mod splatting;
pub mod voxels;
