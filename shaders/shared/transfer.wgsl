// Photons between their last specular surface and their end: a texel of SPT's transfer map, and what is stored of the end.
// Host twin: src/stages/shared/screen_ray.rs.
#define_import_path fathom::transfer

#import fathom::host::{Photon, Transfer}
#import fathom::photon::{MISSED, OUTSIDE}

// States of a ray.
// It never got here.
const NEVER: f32 = 0.0;
// On its first way: surfaces are hit from both sides.
const FIRST: f32 = 1.0;
// Inside glass: glass is hit from within.
const INSIDE: f32 = 2.0;
// It has left a mirror or glass: glass is hit from outside.
const AGAIN: f32 = 3.0;
// It has ended, and its end is stored.
const ENDED: f32 = 4.0;

fn is_on_its_way(ray: Transfer) -> bool {
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
    return Photon(ray.position_m, 0u, ray.position_m + at_m * ray.direction, ray.path_m + at_m);
}
