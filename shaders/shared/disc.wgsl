// Low-pass over a disc of taps, rotated by another angle in every pixel: UW §3.5.
#define_import_path fathom::disc

#import fathom::math::{TAU}
#import fathom::random::{pcg}

// 2π (1 − 1/φ): successive taps of a Vogel disc are this far apart.
const GOLDEN_ANGLE: f32 = 2.39996322972865332;

fn pixel_rotation(pixel: vec2<u32>) -> f32 {
    return TAU * f32(pcg(pixel.x + 65536u * pixel.y)) / 4294967296.0;
}

// Position of tap i of a disc, pixels; `rotation` is the pixel's own angle.
fn rotated_tap(position: vec2<f32>, rotation: f32, i: u32, taps: u32, radius_px: f32) -> vec2<f32> {
    let angle = f32(i) * GOLDEN_ANGLE + rotation;
    let r = radius_px * sqrt((f32(i) + 0.5) / f32(taps));
    return position + r * vec2(cos(angle), sin(angle));
}

fn low_pass(source: texture_2d<f32>, position: vec2<f32>, taps: u32, radius_px: f32) -> vec4<f32> {
    let last = vec2<i32>(textureDimensions(source)) - 1;
    let rotation = pixel_rotation(vec2<u32>(position));
    var sum = vec4(0.0);
    for (var i = 0u; i < taps; i++) {
        let texel = vec2<i32>(floor(rotated_tap(position, rotation, i, taps, radius_px)));
        sum += textureLoad(source, clamp(texel, vec2(0), last), 0);
    }
    return sum / f32(taps);
}
