//! A rectangular pool and its illumination map: what the stages `planar/*` share. SPT §1.1.

use crate::prelude::*;

/// The floor, and the walls at −x, +x, −z and +z: they stand side by side in the map.
pub const FACES: u32 = 5;

shader_struct! {
    /// The pool below the water's rectangle.
    pub struct Pool {
        /// Depth of the floor under the resting water, metres.
        pub floor_depth_m: f32,
        /// Height of the walls' upper border in the map above the resting water: no photon enters higher.
        pub top_m: f32,
        /// Texels per side of a face.
        pub texels: u32,
    }
}

impl Pool {
    /// Texels of the map.
    pub fn map_px(&self) -> [u32; 2] {
        [self.texels.saturating_mul(FACES), self.texels]
    }
}
