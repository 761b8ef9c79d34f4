// defs: WATER=0
// Photons that have met a mirror or glass go on from there: SPT §2.3. Those that have met anything else, or nothing, have ended.
#import fathom::frame::{frame}
#import fathom::layers::{surface_near, texel_of}
#import fathom::optics
#import fathom::photon::{Photon, ON_ITS_WAY}
#import fathom::transfer::{AGAIN, ENDED, INSIDE, Transfer, is_on_its_way}

struct Bounce {
    size_px: vec2<f32>,
    // Photons of this turn: the first, and how many there are in the map.
    first: u32,
    rows: u32,
    photons: u32,
    layers: u32,
    // 1 behind the last way.
    last: u32,
}

@group(1) @binding(0) var<uniform> turn: Bounce;
@group(1) @binding(1) var<storage, read_write> transfers: array<Transfer>;
@group(1) @binding(2) var<storage, read_write> photons: array<Photon>;
@group(1) @binding(3) var depths: texture_2d_array<f32>;
@group(1) @binding(4) var normals: texture_2d_array<f32>;

// Normal and optics of the surface on which a photon has landed.
fn met(photon: Photon) -> vec4<f32> {
    let clip = frame.camera_view_projection * vec4(photon.hit_m, 1.0);
    let ndc = clamp(clip.xy / clip.w, vec2(-1.0), vec2(1.0));
    return surface_near(depths, normals, turn.layers, texel_of(ndc, turn.size_px), clip.w);
}

// The photon behind a mirror or glass.
fn onward(ray: Transfer, photon: Photon, surface: vec4<f32>) -> Transfer {
    let normal = surface.xyz;
    // There is no water in glass.
    let path_m = select(photon.distance_m, ray.path_m, ray.state == INSIDE);
    if optics::is_mirror(surface.w) {
        return Transfer(photon.hit_m, AGAIN, reflect(ray.direction, normal), path_m);
    }
    let from_outside = dot(ray.direction, normal) < 0.0;
    let glass = optics::refractive_index(surface.w);
    let eta = select(glass / frame.refractive_index, frame.refractive_index / glass, from_outside);
    let direction = optics::refracted(ray.direction, normal, eta);
    let inside = dot(direction, normal) < 0.0;
    return Transfer(photon.hit_m, select(AGAIN, INSIDE, inside), direction, path_m);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let row = id.x + id.y * groups.x * 64u;
    let index = turn.first + row;
    if row >= turn.rows || index >= turn.photons {
        return;
    }
    let ray = transfers[index];
    if !is_on_its_way(ray) {
        return;
    }
    let photon = photons[index];
    let surface = met(photon);
    if photon.residual_m < 0.0 || optics::ends(surface.w) {
        transfers[index].state = ENDED;
        return;
    }
    if turn.last == 1u {
        transfers[index].state = ENDED;
        photons[index].residual_m = ON_ITS_WAY;
        return;
    }
    transfers[index] = onward(ray, photon, surface);
}
