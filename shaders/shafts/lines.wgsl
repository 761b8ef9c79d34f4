// defs: WATER=0
// A line from start to hit for each photon, attenuated along the path to each point and from there to the viewer, added up: SPT §3.2.
#import fathom::uniforms::{frame}
#import fathom::photon::{Photon, has_landed}
#import fathom::screen::{NOT_DRAWN}
#import fathom::shading::{water_path_m}

struct Shafts {
    // Flux of a photon, W.
    photon_w: f32,
    photons: u32,
}

@group(1) @binding(0) var<uniform> settings: Shafts;
@group(1) @binding(1) var<storage, read> photons: array<Photon>;
@group(1) @binding(2) var scene_depth: texture_depth_2d;
// Of each photon, as `transfer/map` gives them.
@group(1) @binding(3) var<storage, read> weights: array<f32>;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    // Length of the path from the water's surface.
    @location(0) path_m: f32,
    @location(1) @interpolate(flat) weight: f32,
    @location(2) position_m: vec3<f32>,
}

@vertex
fn vertex(@builtin(vertex_index) end: u32, @builtin(instance_index) index: u32) -> Varying {
    let photon = photons[index];
    if !has_landed(photon) || photon.distance_m <= 0.0 {
        return Varying(NOT_DRAWN, 0.0, 0.0, vec3(0.0));
    }
    let position_m = select(photon.entry_m, photon.hit_m, end == 1u);
    // Behind a mirror or glass a part of the path lies before the start.
    let before_m = max(photon.distance_m - distance(photon.entry_m, photon.hit_m), 0.0);
    let path_m = select(before_m, photon.distance_m, end == 1u);
    return Varying(frame.camera_view_projection * vec4(position_m, 1.0), path_m, weights[index], position_m);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    if in.clip.z > textureLoad(scene_depth, vec2<i32>(in.clip.xy), 0) {
        discard;
    }
    return vec4(settings.photon_w * in.weight * exp(-frame.attenuation_per_m * (in.path_m + water_path_m(in.position_m))));
}
