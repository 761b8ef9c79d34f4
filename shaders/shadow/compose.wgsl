// defs: WATER=0
// The picture: what the camera sees, lit where its ray to the light meets nothing, and by the sky.
#import fathom::uniforms::{frame}
#import fathom::photon::{MISSED, Photon, has_landed}
#import fathom::picture::{display, lambert, normal_at, seen_at, picture}
#import fathom::shading::{SKY_SHARE, sky, to_light}

@group(1) @binding(4) var<storage, read> photons: array<Photon>;

// Whether something lies between a place and the light, the place's own triangle included.
fn shadowed(photon: Photon, position_m: vec3<f32>) -> bool {
    if !has_landed(photon) {
        return photon.fate == MISSED;
    }
    return frame.light_is_point == 0u || photon.distance_m < distance(position_m, frame.light_position_m);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let seen = seen_at(pixel.xy);
    if seen.z >= 1.0 {
        return display(sky(normalize(seen.position_m - frame.camera_position_m)));
    }
    let normal = normal_at(seen.texel);
    var irradiance = SKY_SHARE * frame.light_irradiance * (0.6 + 0.4 * normal.y);
    let photon = photons[u32(seen.texel.x) + u32(seen.texel.y) * u32(picture.size_px.x)];
    if !shadowed(photon, seen.position_m) {
        irradiance += frame.light_irradiance * saturate(dot(normal, to_light(seen.position_m)));
    }
    return display(lambert(seen.texel, vec3(irradiance)));
}
