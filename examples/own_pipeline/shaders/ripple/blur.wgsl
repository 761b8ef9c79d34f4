// The mean of the square around each pixel; beyond the border its nearest texels repeat.
#import fathom::host::{BlurUniforms}

@group(0) @binding(0) var<storage, read> settings: BlurUniforms;
@group(0) @binding(1) var source: texture_2d<f32>;

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let last = vec2<i32>(textureDimensions(source)) - 1;
    let radius = i32(settings.radius_px);
    var sum = vec4(0.0);
    for (var y = -radius; y <= radius; y++) {
        for (var x = -radius; x <= radius; x++) {
            let place = clamp(vec2<i32>(pixel.xy) + vec2(x, y), vec2(0), last);
            sum += textureLoad(source, place, 0);
        }
    }
    let side = f32(2 * radius + 1);
    return sum / (side * side);
}
