// defs: TEST=1, WATER=0
// Photons that have met a mirror or glass go on from there: SPT §2.3. Those that have met anything else, or nothing, have ended.
#import fathom::dispatch::{invocation_index}
#import fathom::uniforms::{frame}
#import fathom::layers::{NO_SURFACE}
#import fathom::optics
#import fathom::photon::{Photon, STILL_BOUNCING, has_landed}
#import fathom::screen_ray::{Walk, smoothed, surface_hit}
#import fathom::surface_texel::{Surface}
#import fathom::transfer::{AGAIN, ENDED, INSIDE, Transfer, is_travelling}

struct Bounce {
    // Photons of this turn: the first, and how many.
    first: u32,
    rows: u32,
    // 1 behind the last way.
    last: u32,
}

@group(1) @binding(0) var<uniform> bounce: Bounce;
@group(1) @binding(1) var<storage, read_write> transfers: array<Transfer>;
@group(1) @binding(2) var<storage, read_write> photons: array<Photon>;
@group(1) @binding(3) var<uniform> walk: Walk;
@group(1) @binding(4) var depths: texture_2d_array<f32>;
@group(1) @binding(5) var surfaces: texture_2d_array<u32>;

// The photon behind a mirror or glass: the geometric normal says from which side it comes, the shading normal how it is bent. Exact
// reference: src/reference/specular.rs.
fn onward(ray: Transfer, photon: Photon, surface: Surface) -> Transfer {
    let normal = smoothed(walk, depths, surfaces, photon.hit_m, surface);
    // There is no water in glass.
    let path_m = select(photon.distance_m, ray.path_m, ray.state == INSIDE);
    if optics::is_mirror(surface.optics) {
        return Transfer(photon.hit_m, AGAIN, reflect(ray.direction, normal), path_m);
    }
    let from_outside = dot(ray.direction, surface.geometric_normal) < 0.0;
    let glass = optics::refractive_index(surface.optics);
    let eta = select(glass / frame.refractive_index, frame.refractive_index / glass, from_outside);
    let direction = optics::refracted(ray.direction, normal, eta);
    let passed = dot(ray.direction, normal) * dot(direction, normal) > 0.0;
    return Transfer(photon.hit_m, select(AGAIN, INSIDE, from_outside == passed), direction, path_m);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let row = invocation_index(id, groups);
    let index = bounce.first + row;
    if row >= bounce.rows || index >= walk.photons {
        return;
    }
    let ray = transfers[index];
    if !is_travelling(ray) {
        return;
    }
    let photon = photons[index];
    var surface = NO_SURFACE;
    if has_landed(photon) {
        surface = surface_hit(walk, depths, surfaces, ray, photon.distance_m - ray.path_m);
    }
    if !optics::passes(surface.optics) {
        transfers[index].state = ENDED;
        return;
    }
    if bounce.last == 1u {
        transfers[index].state = ENDED;
        photons[index].fate = STILL_BOUNCING;
        return;
    }
    transfers[index] = onward(ray, photon, surface);
}
