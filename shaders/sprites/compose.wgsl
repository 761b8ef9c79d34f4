// defs: DRY=0, SHAFTS=0
// The picture: what the camera sees, lit by the sprites and by the sky, with shafts of light over it. DRY 1 gives the radiance of what is
// seen without the water before it.
#import fathom::frame::{frame, world_at}
#import fathom::screen
#import fathom::seen::{albedo_texels, depths, normal_texels}
#import fathom::shading::{SHAFT_TINT, WATER_TINT, ambient, beyond, direct, display, fog, lambert, water_path_m}

struct Compose {
    size_px: vec2<f32>,
    exposure: f32,
    // Radiance of a shaft for each W in its pixel, 1/(m² sr).
    shaft_scale: f32,
}

@group(1) @binding(0) var<uniform> settings: Compose;
// W/m².
@group(1) @binding(4) var irradiance_texels: texture_2d<f32>;
// W. Bound with SHAFTS alone.
@group(1) @binding(5) var shaft_texels: texture_2d<f32>;

fn shafts(texel: vec2<i32>) -> vec3<f32> {
#if SHAFTS == 1
    return settings.shaft_scale * textureLoad(shaft_texels, texel, 0).x * SHAFT_TINT;
#else
    return vec3(0.0);
#endif
}

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
        return display(beyond(normalize(place - frame.camera_position_m)) + shafts(texel), settings.exposure);
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
