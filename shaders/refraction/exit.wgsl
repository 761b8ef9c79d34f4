// defs: TEST=3, WATER=0
// What becomes of lines of sight where they leave glass: SPT §4, "the normal at this point is fetched from the depth image". A ray that
// leaves nowhere in view goes on from where it has entered.
#import fathom::uniforms::{frame}
#import fathom::layers::{surface_near}
#import fathom::optics
#import fathom::photon::{Photon}
#import fathom::refraction::{Exit, NO_EXIT}
#import fathom::screen
#import fathom::screen_ray::{Walk, place_px, texel_at}
#import fathom::transfer::{NEVER, Transfer}

struct Sight {
    size_px: vec2<f32>,
    first: vec2<u32>,
    count: vec2<u32>,
}

@group(1) @binding(0) var<uniform> settings: Sight;
@group(1) @binding(1) var<uniform> walk: Walk;
@group(1) @binding(2) var depths: texture_2d_array<f32>;
@group(1) @binding(3) var surfaces: texture_2d_array<u32>;
@group(1) @binding(4) var<storage, read> transfers: array<Transfer>;
@group(1) @binding(5) var<storage, read> photons: array<Photon>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> Exit {
    let at = vec2<u32>(pixel.xy) - settings.first;
    if any(vec2<u32>(pixel.xy) < settings.first) || any(at >= settings.count) {
        return NO_EXIT;
    }
    let index = at.x + at.y * settings.count.x;
    let ray = transfers[index];
    if ray.state == NEVER {
        return NO_EXIT;
    }
    let entry_m = distance(ray.position_m, frame.camera_position_m);
    let end = photons[index];
    if end.residual_m < 0.0 {
        return Exit(vec4(ray.position_m, entry_m), vec4(ray.direction, 1.0));
    }
    let clip = frame.camera_view_projection * vec4(end.hit_m, 1.0);
    let texel = texel_at(walk, place_px(walk, clip));
    let surface = surface_near(depths, surfaces, walk.layers, texel, clip.w);
    let normal = surface.shading_normal;
    let behind = optics::refracted(ray.direction, normal, optics::refractive_index(surface.optics));
    let passed = dot(ray.direction, normal) * dot(behind, normal) > 0.0;
    return Exit(vec4(end.hit_m, entry_m), vec4(behind, select(1.0, 0.0, passed)));
}
