// defs: FRESNEL=0, WATER=0
// The transfer map: where each photon of the light's grid enters the water, and its refracted direction. SPT §2: "single
// refractions, for instance at a water surface". Beside it each photon's share of the flux that one in the middle of the light carries.
#import fathom::dispatch::{invocation_index}
#import fathom::uniforms::{frame}
#import fathom::photon::{angular_weight, in_mask, meet_water, photon_ray, transmittance}
#import fathom::transfer::{FIRST, NEVER, Transfer}
#import fathom::water

struct Map {
    // Photons along the light's screen, to the right and upwards.
    grid: vec2<u32>,
    // Place of a photon within its cell.
    offset: vec2<f32>,
}

@group(1) @binding(0) var<uniform> settings: Map;
@group(1) @binding(1) var shadow_mask: texture_2d<f32>;
@group(1) @binding(2) var<storage, read_write> transfers: array<Transfer>;
@group(1) @binding(3) var<storage, read_write> weights: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = invocation_index(id, groups);
    if index >= settings.grid.x * settings.grid.y {
        return;
    }
    let photon = vec2(index % settings.grid.x, index / settings.grid.x);
    let at = (vec2<f32>(photon) + settings.offset) / vec2<f32>(settings.grid) * 2.0 - 1.0;
    let ray = photon_ray(at);
    let entry = meet_water(ray);
    // Photons that geometry above the water stops are dropped.
    let alive = entry.entered && in_mask(shadow_mask, entry.position_m);
    let refracted = refract(ray.direction, entry.normal, 1.0 / frame.refractive_index);
    transfers[index] = Transfer(entry.position_m, select(NEVER, FIRST, alive), refracted, 0.0);
    var weight = angular_weight(entry.position_m);
#if FRESNEL == 1
    weight *= transmittance(ray.direction, refracted);
#endif
    weights[index] = weight;
}
