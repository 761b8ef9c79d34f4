// defs: TEST=1, WATER=0
// Photons that have met a mirror or glass go on from there: SPT §2.3. Those that have met anything else, or nothing, have ended.
#import fathom::uniforms::{frame}
#import fathom::layers::{surface_near}
#import fathom::optics
#import fathom::photon::{Photon, ON_ITS_WAY}
#import fathom::screen_ray::{Walk, place_px, surface_hit}
#import fathom::transfer::{AGAIN, ENDED, INSIDE, Transfer, is_on_its_way}

struct Bounce {
    // Photons of this turn: the first, and how many.
    first: u32,
    rows: u32,
    // 1 behind the last way.
    last: u32,
}

@group(1) @binding(0) var<uniform> turn: Bounce;
@group(1) @binding(1) var<storage, read_write> transfers: array<Transfer>;
@group(1) @binding(2) var<storage, read_write> photons: array<Photon>;
@group(1) @binding(3) var<uniform> walk: Walk;
@group(1) @binding(4) var depths: texture_2d_array<f32>;
@group(1) @binding(5) var surfaces: texture_2d_array<u32>;

// Pixels around a hit show the surface that was hit where their normals are within 60 degrees of its.
const ALIKE: f32 = 0.5;

// The surface that was hit, its normal interpolated between the four pixels around the hit, those that show it.
fn smoothed(hit_m: vec3<f32>, met: vec4<f32>) -> vec4<f32> {
    let clip = frame.camera_view_projection * vec4(hit_m, 1.0);
    let place = place_px(walk, clip) - 0.5;
    let corner = floor(place);
    let share = place - corner;
    var sum = vec3(0.0);
    for (var i = 0u; i < 4u; i++) {
        let offset = vec2(f32(i & 1u), f32(i >> 1u));
        let texel = vec2<i32>(clamp(corner + offset, vec2(0.0), walk.size_px - 1.0));
        let shown = surface_near(depths, surfaces, walk.layers, texel, clip.w);
        let weight = mix(1.0 - share, share, offset);
        if shown.w == met.w && dot(shown.xyz, met.xyz) > ALIKE {
            sum += weight.x * weight.y * shown.xyz;
        }
    }
    return vec4(normalize(select(met.xyz, sum, dot(sum, sum) > 0.0)), met.w);
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
    if row >= turn.rows || index >= walk.photons {
        return;
    }
    let ray = transfers[index];
    if !is_on_its_way(ray) {
        return;
    }
    let photon = photons[index];
    var surface = vec4(0.0);
    if photon.residual_m >= 0.0 {
        surface = surface_hit(walk, depths, surfaces, ray, photon.distance_m - ray.path_m);
    }
    if !optics::passes(surface.w) {
        transfers[index].state = ENDED;
        return;
    }
    if turn.last == 1u {
        transfers[index].state = ENDED;
        photons[index].residual_m = ON_ITS_WAY;
        return;
    }
    transfers[index] = onward(ray, photon, smoothed(photon.hit_m, surface));
}
