//! A rectangular pool and its illumination map: what the stages `planar/*` share. SPT §1.1.

use crate::prelude::*;

/// The floor, and the walls at −x, +x, −z and +z: they stand side by side in the map.
pub const FACES: u32 = 5;

shader_struct! {
    /// `Pool` in `shaders/shared/pool.wgsl`.
    pub struct PoolUniforms {
        pub floor_depth_m: f32,
        pub top_m: f32,
        pub texels: u32,
    }
}

/// The pool below the water's rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pool {
    /// Depth of the floor under the resting water.
    pub floor_depth_m: f64,
    /// Height of the walls' upper border in the map above the resting water: no photon enters higher.
    pub top_m: f64,
    /// Texels per side of a face.
    pub texels: u32,
}

impl Pool {
    /// Texels of the map.
    pub fn map_px(&self) -> [u32; 2] {
        [self.texels.saturating_mul(FACES), self.texels]
    }

    pub fn uniform(&self, resources: &Resources<'_>) -> Buffer {
        let settings = PoolUniforms {
            floor_depth_m: self.floor_depth_m as f32,
            top_m: self.top_m as f32,
            texels: self.texels,
        };
        resources.uniform("pool", &settings)
    }
}
