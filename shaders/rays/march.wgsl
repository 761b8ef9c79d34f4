// defs: SIDE=0, TEST=1, WATER=0
// An invocation for each photon walks its ray on the screen up to the first hit, or to the last that is kept: the single-shader form of
// SPT §2.1. SIDE above 0: a pixel of a target of so many a side, as in the paper, in place of an invocation of a compute shader.
#import fathom::host::{Photon, Transfer, WalkUniforms}
#import fathom::dispatch::{invocation_index}
#import fathom::screen_ray::{hit, segment}
#import fathom::transfer::{ENDED, NO_HIT, landed}

@group(1) @binding(0) var<uniform> walk: WalkUniforms;
@group(1) @binding(1) var<storage, read> transfers: array<Transfer>;
@group(1) @binding(2) var depths: texture_2d_array<f32>;
@group(1) @binding(3) var surfaces: texture_2d_array<u32>;
@group(1) @binding(4) var<storage, read_write> photons: array<Photon>;

// Leaves what the ray meets. The distance of the first hit.
fn march(photon: u32) -> f32 {
    if photon >= walk.photons {
        return NO_HIT;
    }
    let ray = transfers[photon];
    if ray.state == ENDED {
        return NO_HIT;
    }
    let seg = segment(walk, ray);
    var number = 0.0;
    var before_m = NO_HIT;
    var first_m = NO_HIT;
    for (var i = 0u; i < walk.max_hits; i++) {
        var at_m = NO_HIT;
        for (; number < seg.steps && at_m >= NO_HIT; number += 1.0) {
            let step_m = hit(walk, depths, surfaces, ray, seg, number).at_m;
            // Hits of adjacent steps are one intersection.
            at_m = select(NO_HIT, step_m, before_m >= NO_HIT);
            before_m = step_m;
        }
        first_m = min(first_m, at_m);
        photons[photon * walk.max_hits + i] = landed(ray, at_m);
    }
    return first_m;
}

#if SIDE == 0
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    _ = march(invocation_index(id, groups));
}
#else
@fragment
fn fragment(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(at.xy);
    return vec4(march(pixel.x + pixel.y * #{SIDE}u));
}
#endif
