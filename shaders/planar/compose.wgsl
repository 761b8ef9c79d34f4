// defs: MAP=0
// The picture: what the camera sees, its pool lit by the illumination map, all of it by the sky. SPT §1.1, Fig. 2.
// MAP 1: the illumination map of the floor in its place.
#import fathom::math::{PI}
#import fathom::picture::{background, display, lambert, normal_at, seen_at, picture}
#import fathom::pool::{NONE, Pool, face_at, face_uv}
#import fathom::shading::{WATER_TINT, ambient, direct, fog, water_path_m}

@group(1) @binding(4) var<uniform> pool: Pool;
// The illumination map, W/m².
@group(1) @binding(5) var map: texture_2d<f32>;

#if MAP == 1
// The floor's texels as they are, on white.
@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = vec2<i32>(pixel.xy / picture.size_px * f32(pool.texels));
    let irradiance = textureLoad(map, texel, 0).x;
    return display(vec3(irradiance / PI));
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
    let at = face_uv(pool, face, p_m) * f32(pool.texels) - 0.5;
    let base = floor(at);
    let f = at - base;
    let first = vec2<i32>(base);
    let upper = mix(texel_at(face, first), texel_at(face, first + vec2(1, 0)), f.x);
    let lower = mix(texel_at(face, first + vec2(0, 1)), texel_at(face, first + vec2(1, 1)), f.x);
    return mix(upper, lower, f.y);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let seen = seen_at(pixel.xy);
    let p_m = seen.position_m;
    if seen.z >= 1.0 {
        return display(background(p_m));
    }
    let normal = normal_at(seen.texel);
    let irradiance = ambient(-p_m.y, normal) + direct(p_m, normal) + photons(p_m, normal) * WATER_TINT;
    return display(fog(lambert(seen.texel, irradiance), water_path_m(p_m)));
}
#endif
