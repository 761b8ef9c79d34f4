// Photons from given starts through the water to the scene: UW §3.3.
// defs: CONSERVING=0, FRESNEL=0, WATER=0
#import fathom::dispatch
#import fathom::estimator::{Trace, follow}
#import fathom::uniforms::{frame}
#import fathom::photon::{
    MISSED, Photon, Ray, angular_weight, in_frustum, in_mask, light_direction, meet_water, transmittance
}
#import fathom::water

struct Start {
    position_m: vec3<f32>,
    // 1: the direction is given; 0: the light's own ray runs through the start.
    aimed: u32,
    direction: vec3<f32>,
}

struct Answer {
    photon: Photon,
    // After refraction, unit length; 0 for a photon that never enters the water.
    direction: vec3<f32>,
    // Share of a photon's flux that enters the water.
    weight: f32,
}

@group(1) @binding(0) var<uniform> settings: Trace;
@group(1) @binding(1) var shadow_depth: texture_depth_2d;
@group(1) @binding(2) var shadow_mask: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> starts: array<Start>;
@group(1) @binding(4) var<storage, read_write> answers: array<Answer>;
@group(1) @binding(5) var texels: sampler;

// Whether something above the water stops the light before it comes here. The mask tells nothing of other directions, or of
// places that the light's frustum leaves out.
fn shaded(entry_m: vec3<f32>) -> bool {
    return settings.masked != 0u && in_frustum(entry_m) && !in_mask(shadow_mask, entry_m);
}

fn traced(start: Start) -> Answer {
    let aimed = start.aimed != 0u;
    var ray = Ray(start.position_m, start.direction);
    if !aimed {
        ray.direction = light_direction(start.position_m);
    }
    let met = meet_water(ray);
    let entry = met.position_m;
    let behind = dot(entry - ray.origin_m, ray.direction) < 0.0;
    if behind || !met.entered || (!aimed && shaded(entry)) {
        return Answer(Photon(entry, MISSED, entry, 0.0), vec3(0.0), 0.0);
    }
    let refracted = refract(ray.direction, met.normal, 1.0 / frame.refractive_index);
    var weight = 1.0;
#if FRESNEL == 1
    weight *= transmittance(ray.direction, refracted);
#endif
#if CONSERVING == 1
    if !aimed {
        weight *= angular_weight(entry);
    }
#endif
    return Answer(follow(settings, shadow_depth, texels, entry, refracted), refracted, weight);
}

@compute @workgroup_size(dispatch::GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = dispatch::place(id, groups);
    if index < arrayLength(&starts) {
        answers[index] = traced(starts[index]);
    }
}
