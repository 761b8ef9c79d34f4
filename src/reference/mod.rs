//! Independent answers in f64 for what the GPU computes in f32.
//!
//! Nothing here is a transcription of a shader: where the GPU iterates on a depth map, this module
//! refracts exactly and casts rays; where the GPU approximates, this module has the closed form. It
//! imports nothing of the rest of the crate but [`scene`](fathom_scene).
//!
//! | module | answers |
//! |---|---|
//! | [`optics`] | refraction, Fresnel reflectance, phase function, transmittance |
//! | [`surface`] | where a ray enters the water |
//! | [`rays`] | nearest triangle along a ray, camera and light rays |
//! | [`specular`] | light behind mirrors and glass |
//! | [`photons`] | the photon grid and where each photon lands |
//! | [`pool`] | the inner faces of a rectangular pool, and photons counted on them texel by texel |
//! | [`photon_map`] | irradiance of what each pixel shows, by many photons |
//! | [`estimator`] | the estimators of photons' ends over an exact depth: first crossing, and the iteration of the paper |
//! | [`splat`] | point sizes, intensities, and a rasterizer of splats, as squares and within one surface |
//! | [`caustic_mesh`] | irradiance by refracted triangles, drawn exactly |
//! | [`godray`] | intensity at a point of a godray |
//! | [`filter`] | the rotated disc low-pass, plain and within one surface |
//! | [`plane`] | surfaces told apart by the camera's depth |
//! | [`march`] | ray marching through a volume |
//! | [`horizon`] | horizon-split ambient occlusion over a depth buffer, occlusion beside a wall |
//! | [`bilateral`] | the joint bilateral filter and up-scaling of ambient-occlusion buffers |
//! | [`occlusion`] | ambient occlusion by ray casting |
//! | [`openness`] | screen-space ambient occlusion of the composed underwater picture |
//! | [`media`] | transmittance and ambient occlusion in participating media |
//! | [`isosurface`] | hits, normals and ambient occlusion of a ball and a slab |
//! | [`deform`] | vertices and normals of moving geometry |
//! | [`voxel`] | which voxels a surface occupies: by separating axes, and by sampling |
//! | [`quantities`] | error statistics of photons read back from the GPU |
//! | [`kept`] | none itself: keeps answers on disk by their content |

pub mod bilateral;
pub mod caustic_mesh;
pub mod deform;
pub mod estimator;
pub mod filter;
pub mod godray;
mod hierarchy;
pub mod horizon;
pub mod image;
pub mod isosurface;
pub mod kept;
pub mod march;
pub mod media;
pub mod occlusion;
pub mod openness;
pub mod optics;
pub mod photon_map;
pub mod photons;
pub mod plane;
pub mod pool;
pub mod quantities;
pub mod rays;
pub mod specular;
pub mod splat;
pub mod surface;
pub mod voxel;

/// Halves an interval whose upper end is beyond a border and whose lower one is not, so many times.
fn bisected(
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
