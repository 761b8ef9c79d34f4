// defs: SURFACE=1, TEST=1, WATER=0
// Lines of sight through glass, refracted several times: SPT §4. "Along any ray the n-th intersection point with the refracting object
// is found in the (n + 1)-th depth layer." A ray is walked pixel by pixel until it is behind the next layer or before the current one.
//
// Defs: SURFACE 0 compares depths texel by texel, as the paper does; SURFACE 1 holds the ray against the tangent planes of the layers.
#import fathom::uniforms::{frame, view_depth_m, world_at}
#import fathom::layers::{NO_SURFACE, surface_at}
#import fathom::optics
#import fathom::refraction::{Exit, NO_EXIT}
#import fathom::screen
#import fathom::screen_ray::{Segment, Walk, distance_at, place_px, segment, share_at}
#import fathom::surface_texel::{Surface}
#import fathom::transfer::{FIRST, Transfer}

struct Trace {
    // Surfaces that refract a ray.
    refractions: u32,
}

@group(1) @binding(0) var<uniform> walk: Walk;
@group(1) @binding(1) var<uniform> settings: Trace;
@group(1) @binding(2) var depths: texture_2d_array<f32>;
@group(1) @binding(3) var surfaces: texture_2d_array<u32>;

// A ray against the layers between which it runs, at a texel.
struct Against {
    // How far it is beyond them, more than 0 where it is out. At a texel without the layers, FAR.
    beyond_m: f32,
    // The one that it is nearer to. Its surface is looked up where the ray ends alone: comparing depths needs none.
    layer: u32,
    texel: vec2<i32>,
}

const FAR: f32 = 1e30;

// Metres by which a place is behind a layer, where `sign` is 1, or before it, where it is −1.
fn past(place_m: vec3<f32>, view_m: f32, texel: vec2<i32>, z: f32, layer: u32, sign: f32) -> f32 {
#if SURFACE == 0
    return sign * (view_m - view_depth_m(z));
#else
    let normal = surface_at(surfaces, texel, layer).geometric_normal;
    let at_m = world_at((vec2<f32>(texel) + 0.5) / walk.size_px, z);
    let away = select(-1.0, 1.0, dot(at_m - frame.camera_position_m, normal) > 0.0);
    return sign * away * dot(place_m - at_m, normal);
#endif
}

fn against(ray: Transfer, at_m: f32, view_m: f32, texel: vec2<i32>, next: u32) -> Against {
    let z = textureLoad(depths, texel, next - 1u, 0).x;
    let z_next = textureLoad(depths, texel, next, 0).x;
    if z >= 1.0 || z_next >= 1.0 {
        return Against(FAR, next, texel);
    }
    let place_m = ray.position_m + at_m * ray.direction;
    let before_m = past(place_m, view_m, texel, z, next - 1u, -1.0);
    let behind_m = past(place_m, view_m, texel, z_next, next, 1.0);
    if before_m > behind_m {
        return Against(before_m, next - 1u, texel);
    }
    return Against(behind_m, next, texel);
}

// Where a ray ends that has started on layer `next` − 1.
struct End {
    at_m: f32,
    // Without a normal where the ray ends nowhere.
    surface: Surface,
}

fn end_of(ray: Transfer, next: u32) -> End {
    let seg = segment(walk, ray);
    let start = place_px(walk, seg.near);
    let end = place_px(walk, seg.far);
    var at_m = 0.0;
    var found = against(ray, 0.0, seg.near.w, vec2<i32>(clamp(floor(start), vec2(0.0), walk.size_px - 1.0)), next);
    for (var number = 0.0; number < seg.steps; number += 1.0) {
        let middle = (number + 0.5) / seg.steps;
        let texel = vec2<i32>(clamp(floor(mix(start, end, middle)), vec2(0.0), walk.size_px - 1.0));
        let here_m = distance_at(seg, middle);
        let here = against(ray, here_m, mix(seg.near.w, seg.far.w, share_at(seg, middle)), texel, next);
        if here.beyond_m >= FAR {
            // It has come out beside the object: at the silhouette.
            break;
        }
        let is_out = here.beyond_m > 0.0 && number > 0.0;
        let before_m = min(found.beyond_m, 0.0);
        at_m = select(here_m, mix(at_m, here_m, before_m / (before_m - here.beyond_m)), is_out);
        found = here;
        if is_out {
            break;
        }
    }
    if found.beyond_m >= FAR {
        return End(at_m, NO_SURFACE);
    }
    return End(at_m, surface_at(surfaces, found.texel, found.layer));
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> Exit {
    let texel = vec2<i32>(pixel.xy);
    let z = textureLoad(depths, texel, 0, 0).x;
    if z >= 1.0 {
        return NO_EXIT;
    }
    var surface = surface_at(surfaces, texel, 0u);
    let place_m = world_at(pixel.xy / walk.size_px, z);
    var ray = Transfer(place_m, FIRST, normalize(place_m - frame.camera_position_m), 0.0);
    var inside = false;
    for (var number = 0u; number < settings.refractions; number++) {
        if number > 0u {
            let end = end_of(ray, number);
            if all(end.surface.shading_normal == vec3(0.0)) {
                break;
            }
            ray.position_m += end.at_m * ray.direction;
            surface = end.surface;
        }
        let index = optics::refractive_index(surface.optics);
        let normal = surface.shading_normal;
        let before = ray.direction;
        ray.direction = optics::refracted(before, normal, select(1.0 / index, index, inside));
        let passed = dot(before, normal) * dot(ray.direction, normal) > 0.0;
        inside = inside != passed;
    }
    return Exit(vec4(ray.position_m, 1.0), vec4(ray.direction, select(0.0, 1.0, inside)));
}
