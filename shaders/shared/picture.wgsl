// What stages that compose a picture share: the G-buffer, and what a radiance is shown as. Host twin: src/stages/shared/picture.rs.
#define_import_path fathom::picture

#import fathom::uniforms::{frame, world_at}
#import fathom::shading::{fog, sky}
#import fathom::shading

struct Picture {
    size_px: vec2<f32>,
    exposure: f32,
    // What a unit of the stage's own light comes to: see the stage.
    scale: f32,
}

@group(1) @binding(0) var<uniform> picture: Picture;
@group(1) @binding(1) var albedo_texels: texture_2d<f32>;
@group(1) @binding(2) var normal_texels: texture_2d<f32>;
@group(1) @binding(3) var depths: texture_depth_2d;

// What the camera sees at a pixel.
struct Seen {
    texel: vec2<i32>,
    // Device depth; 1 where there is nothing.
    z: f32,
    position_m: vec3<f32>,
}

fn seen_at(pixel: vec2<f32>) -> Seen {
    let texel = vec2<i32>(pixel);
    let z = textureLoad(depths, texel, 0);
    return Seen(texel, z, world_at(pixel / picture.size_px, z));
}

fn normal_at(texel: vec2<i32>) -> vec3<f32> {
    return textureLoad(normal_texels, texel, 0).xyz;
}

// Radiance of what the camera sees in such light.
fn lambert(texel: vec2<i32>, irradiance: vec3<f32>) -> vec3<f32> {
    return shading::lambert(textureLoad(albedo_texels, texel, 0).xyz, irradiance);
}

// Radiance where the camera sees nothing, towards a place.
fn background(position_m: vec3<f32>) -> vec3<f32> {
    if frame.camera_under_water != 0u {
        return fog(vec3(0.0), frame.z_far_m);
    }
    return sky(normalize(position_m - frame.camera_position_m));
}

fn display(radiance: vec3<f32>) -> vec4<f32> {
    return shading::display(radiance, picture.exposure);
}
