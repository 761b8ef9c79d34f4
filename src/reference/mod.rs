//! Independent answers in f64 for what the GPU computes in f32.
//!
//! Nothing here is a transcription of a shader: where the GPU iterates on a depth map, this module
//! refracts exactly and casts rays; where the GPU approximates, this module has the closed form. It
//! imports nothing of the rest of the crate but [`scene`](fathom_scene).

pub mod cache;
pub mod deform;
pub mod godray;
pub mod image;
pub mod isosurface;
pub mod media;
pub mod occlusion;
pub mod optics;
pub mod photon_map;
pub mod photons;
pub mod picture;
pub mod pool;
pub mod quantities;
pub mod rays;
pub mod slices;
pub mod specular;
pub mod splat;
pub mod surface;
pub mod voxel;

/// Halves an interval whose upper end is beyond a border and whose lower one is not, so many times.
pub fn bisected(
    [mut low, mut high]: [f64; 2],
    halvings: u32,
    beyond: impl Fn(f64) -> bool,
) -> [f64; 2] {
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        *if beyond(middle) { &mut high } else { &mut low } = middle;
    }
    [low, high]
}
