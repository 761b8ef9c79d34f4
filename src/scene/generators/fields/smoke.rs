//! Smoke: fractal noise that thins out towards the border of the box.

use super::super::{Args, SEED, param};
use super::{Field, FieldGenerator};
use crate::noise::fractal_noise;

pub const GENERATORS: &[FieldGenerator] = &[FieldGenerator {
    name: "smoke",
    about: "a cloud of smoke: Perlin noise with a falloff, VAO Fig. 7c",
    params: &[
        param("lumps", 5.0, 0.5, 64.0, "lumps along the longest side"),
        param("octaves", 5.0, 1.0, 8.0, "octaves of the noise"),
        param("density", 0.5, 0.0, 1.0, "density of smoke without noise"),
        param("contrast", 2.2, 0.0, 10.0, "factor on the noise"),
        SEED,
    ],
    // VAO Fig. 7.
    cells: [200, 128, 200],
    build: smoke,
}];

/// `falloff(r) · clamp(density + contrast · noise)` with `falloff = 1 − r²`, r the distance
/// from the middle in the ellipsoid that touches the box's sides.
fn smoke(a: &Args) -> Field {
    let (lumps, octaves) = (a.get("lumps"), a.count("octaves") as u32);
    let (density, contrast) = (a.get("density"), a.get("contrast"));
    let seed = a.get("seed") as u32;
    let half = 0.5 * GENERATORS[0].extent();
    Box::new(move |p| {
        let inside = 1.0 - (p / half).length_squared();
        if inside <= 0.0 {
            return 0.0;
        }
        let noise = fractal_noise(p * lumps, octaves, seed);
        inside * (density + contrast * noise).clamp(0.0, 1.0)
    })
}
