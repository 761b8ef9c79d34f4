//! Smoke: fractal noise that thins out towards the border of the box.

use super::{FieldFn, FieldGenerator};
use crate::noise::fractal_noise;

pub const GENERATORS: &[FieldGenerator] = &[FieldGenerator {
    name: "smoke",
    about: "a cloud of smoke: Perlin noise with a falloff, VAO Fig. 7c",
    // VAO Fig. 7.
    cells: [200, 128, 200],
    build: smoke,
}];

/// Lumps along the longest side, octaves of the noise, density of smoke without it, and the factor on it.
const LUMPS: f64 = 5.0;
const OCTAVES: u32 = 5;
const DENSITY: f64 = 0.5;
const CONTRAST: f64 = 2.2;

/// `falloff(r) · clamp(density + contrast · noise)` with `falloff = 1 − r²`, r the distance
/// from the middle in the ellipsoid that touches the box's sides.
fn smoke() -> FieldFn {
    let half = 0.5 * GENERATORS[0].extent();
    Box::new(move |p| {
        let inside = 1.0 - (p / half).length_squared();
        if inside <= 0.0 {
            return 0.0;
        }
        let noise = fractal_noise(p * LUMPS, OCTAVES, 1);
        inside * (DENSITY + CONTRAST * noise).clamp(0.0, 1.0)
    })
}
