// defs: MAP=0
// The picture: what the camera sees, its pool lit by the illumination map, all of it by the sky. SPT §1.1, Fig. 2.
// MAP 1: the illumination map of the floor in its place.
#import fathom::uniforms::{frame, world_at}
#import fathom::pool::{NONE, Pool, face_at, place}
#import fathom::screen
#import fathom::shading::{PI, WATER_TINT, ambient, direct, display, fog, lambert, sky, water_path_m}

struct Compose {
    size_px: vec2<f32>,
    exposure: f32,
}

@group(1) @binding(0) var<uniform> settings: Compose;
@group(1) @binding(1) var<uniform> pool: Pool;
@group(1) @binding(2) var albedo_texels: texture_2d<f32>;
@group(1) @binding(3) var normal_texels: texture_2d<f32>;
@group(1) @binding(4) var depths: texture_depth_2d;
// The illumination map, W/m².
@group(1) @binding(5) var map: texture_2d<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

#if MAP == 1
// The floor's texels as they are, on white.
@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = vec2<i32>(pixel.xy / settings.size_px * f32(pool.texels));
    let irradiance = textureLoad(map, texel, 0).x;
    return display(vec3(irradiance / PI), settings.exposure);
}
#else
// A texel of a face; beyond its border the texel at the border.
fn texel_at(face: u32, texel: vec2<i32>) -> f32 {
    let side = i32(pool.texels);
    let within = clamp(texel, vec2(0), vec2(side - 1));
    return textureLoad(map, within + vec2(i32(face) * side, 0), 0).x;
}

// Irradiance of the photons at a visible place, W/m², bilinear within its face.
fn photons(p_m: vec3<f32>, normal: vec3<f32>) -> f32 {
    let face = face_at(pool, p_m, normal);
    if face == NONE {
        return 0.0;
    }
    let at = place(pool, face, p_m) * f32(pool.texels) - 0.5;
    let base = floor(at);
    let f = at - base;
    let first = vec2<i32>(base);
    let upper = mix(texel_at(face, first), texel_at(face, first + vec2(1, 0)), f.x);
    let lower = mix(texel_at(face, first + vec2(0, 1)), texel_at(face, first + vec2(1, 1)), f.x);
    return mix(upper, lower, f.y);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = vec2<i32>(pixel.xy);
    let z = textureLoad(depths, texel, 0);
    let p_m = world_at(pixel.xy / settings.size_px, z);
    if z >= 1.0 {
        let under_water = frame.camera_position_m.y < 0.0;
        let beyond = fog(vec3(0.0), frame.z_far_m);
        let behind = select(sky(normalize(p_m - frame.camera_position_m)), beyond, under_water);
        return display(behind, settings.exposure);
    }
    let normal = textureLoad(normal_texels, texel, 0).xyz;
    let irradiance = ambient(-p_m.y, normal) + direct(p_m, normal) + photons(p_m, normal) * WATER_TINT;
    let radiance = lambert(textureLoad(albedo_texels, texel, 0).xyz, irradiance);
    return display(fog(radiance, water_path_m(p_m)), settings.exposure);
}
#endif
