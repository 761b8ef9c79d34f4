// defs: DRY=0, SHAFTS=0
// The picture: what the camera sees, lit by the sprites and by the sky, with shafts of light over it. DRY 1 gives the radiance of what is
// seen without the water before it.
#import fathom::uniforms::{frame, world_at}
#import fathom::screen
#import fathom::shading::{SHAFT_TINT, WATER_TINT, ambient, direct, display, fog, lambert, sky, water_path_m}

struct Compose {
    size_px: vec2<f32>,
    exposure: f32,
    // Radiance of a shaft for each W in its pixel, 1/(m² sr).
    shaft_scale: f32,
}

@group(1) @binding(0) var<uniform> settings: Compose;
@group(1) @binding(1) var albedo_texels: texture_2d<f32>;
@group(1) @binding(2) var normal_texels: texture_2d<f32>;
@group(1) @binding(3) var depths: texture_depth_2d;
// W/m².
@group(1) @binding(4) var irradiance_texels: texture_2d<f32>;
#if SHAFTS == 1
// W.
@group(1) @binding(5) var shaft_texels: texture_2d<f32>;

fn shafts(texel: vec2<i32>) -> vec3<f32> {
    return settings.shaft_scale * textureLoad(shaft_texels, texel, 0).x * SHAFT_TINT;
}
#else
fn shafts(texel: vec2<i32>) -> vec3<f32> {
    return vec3(0.0);
}
#endif

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = vec2<i32>(pixel.xy);
    let z = textureLoad(depths, texel, 0);
#if DRY == 1
    if z >= 1.0 {
        return vec4(0.0);
    }
#endif
    let place = world_at(pixel.xy / settings.size_px, z);
    if z >= 1.0 {
        let under_water = frame.camera_position_m.y < 0.0;
        let beyond = fog(vec3(0.0), frame.z_far_m);
        let behind = select(sky(normalize(place - frame.camera_position_m)), beyond, under_water);
        return display(behind + shafts(texel), settings.exposure);
    }
    let normal = textureLoad(normal_texels, texel, 0).xyz;
    let photons = textureLoad(irradiance_texels, texel, 0).x;
    let irradiance = ambient(-place.y, normal) + direct(place, normal) + photons * WATER_TINT;
    let radiance = lambert(textureLoad(albedo_texels, texel, 0).xyz, irradiance);
#if DRY == 1
    return vec4(radiance, 1.0);
#else
    return display(fog(radiance, water_path_m(place)) + shafts(texel), settings.exposure);
#endif
}
