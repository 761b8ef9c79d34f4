// defs: WATER=0
// The picture: what the camera sees, lit where its ray to the light meets nothing, and by the sky.
#import fathom::uniforms::{frame, world_at}
#import fathom::photon::{MISSED, Photon}
#import fathom::screen
#import fathom::shading::{PI, SKY_SHARE, display, lambert, sky, to_light}

struct Compose {
    size_px: vec2<f32>,
    exposure: f32,
}

@group(1) @binding(0) var<uniform> settings: Compose;
@group(1) @binding(1) var albedo_texels: texture_2d<f32>;
@group(1) @binding(2) var normal_texels: texture_2d<f32>;
@group(1) @binding(3) var depths: texture_depth_2d;
@group(1) @binding(4) var<storage, read> photons: array<Photon>;

// Whether something lies between a place and the light, the place's own triangle included.
fn shadowed(photon: Photon, place: vec3<f32>) -> bool {
    if photon.residual_m < 0.0 {
        return photon.residual_m == MISSED;
    }
    return frame.light_is_point == 0u || photon.distance_m < distance(place, frame.light_position_m);
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = vec2<i32>(pixel.xy);
    let z = textureLoad(depths, texel, 0);
    let place = world_at(pixel.xy / settings.size_px, z);
    if z >= 1.0 {
        return display(sky(normalize(place - frame.camera_position_m)), settings.exposure);
    }
    let normal = textureLoad(normal_texels, texel, 0).xyz;
    var irradiance = SKY_SHARE * frame.light_irradiance * (0.6 + 0.4 * normal.y);
    let photon = photons[u32(texel.x) + u32(texel.y) * u32(settings.size_px.x)];
    if !shadowed(photon, place) {
        irradiance += frame.light_irradiance * saturate(dot(normal, to_light(place)));
    }
    return display(lambert(textureLoad(albedo_texels, texel, 0).xyz, vec3(irradiance)), settings.exposure);
}
