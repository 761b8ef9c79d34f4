// Photons between their last specular surface and their end: a texel of SPT's transfer map, and what is stored of the end.
// Host twin: src/stages/shared/screen_ray.rs.
#define_import_path fathom::transfer

#import fathom::photon::{MISSED, OUTSIDE, Photon, landed_fate}

// Where a photon leaves its last specular surface, and in which direction: a texel of SPT's transfer map.
struct Transfer {
    position_m: vec3<f32>,
    // One of those below.
    state: u32,
    // Unit.
    direction: vec3<f32>,
    // Length of its path under water so far.
    path_m: f32,
}

// It never got here.
const NEVER: u32 = 0u;
// On its first segment: surfaces are hit from both sides.
const FIRST: u32 = 1u;
// Inside glass: glass is hit from within.
const INSIDE: u32 = 2u;
// It has left a mirror or glass: glass is hit from outside.
const AGAIN: u32 = 3u;
// It has ended, and its end is stored.
const ENDED: u32 = 4u;

// Whether it is still on its way.
fn is_travelling(ray: Transfer) -> bool {
    return ray.state != NEVER && ray.state != ENDED;
}

// Distance of a ray that hits nothing.
const NO_HIT: f32 = 1e30;

// What is stored of a photon whose ray ends here.
fn landed(ray: Transfer, at_m: f32) -> Photon {
    if ray.state == NEVER {
        return Photon(ray.position_m, MISSED, ray.position_m, 0.0);
    }
    if at_m >= NO_HIT {
        return Photon(ray.position_m, OUTSIDE, ray.position_m, 0.0);
    }
    return Photon(ray.position_m, landed_fate(0.0), ray.position_m + at_m * ray.direction, ray.path_m + at_m);
}
