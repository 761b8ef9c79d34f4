// defs: DRY=0, SHAFTS=0
// The picture: what the camera sees, lit by the sprites and by the sky, with shafts of light over it. DRY 1 gives the radiance of what is
// seen without the water before it.
#import fathom::picture::{background, display, lambert, normal_at, picture, seen_at}
#import fathom::shading::{WATER_TINT, ambient, direct, fog, shafts, water_path_m}

// W/m².
@group(1) @binding(4) var irradiance_texels: texture_2d<f32>;
// W.
@group(1) @binding(5) var shaft_texels: texture_2d<f32>;

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let seen = seen_at(pixel.xy);
    let position_m = seen.position_m;
    var radiance = vec3(0.0);
    if seen.z < 1.0 {
        let normal = normal_at(seen.texel);
        let photons = textureLoad(irradiance_texels, seen.texel, 0).x;
        radiance = lambert(seen.texel, ambient(-position_m.y, normal) + direct(position_m, normal) + photons * WATER_TINT);
    }
#if DRY == 1
    return vec4(radiance, select(0.0, 1.0, seen.z < 1.0));
#else
    if seen.z < 1.0 {
        radiance = fog(radiance, water_path_m(position_m));
    } else {
        radiance = background(position_m);
    }
#if SHAFTS == 1
    radiance += shafts(textureLoad(shaft_texels, seen.texel, 0).x, picture.scale);
#endif
    return display(radiance);
#endif
}
