// A Gaussian of constant width on the screen, rows first and then columns: SPT §3.2.
#import fathom::host::{ShaftBlurUniforms}

@group(0) @binding(0) var<storage, read> settings: ShaftBlurUniforms;
@group(0) @binding(1) var source: texture_2d<f32>;

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let last = vec2<i32>(textureDimensions(source)) - 1;
    let texel = vec2<i32>(pixel.xy);
    var sum = 0.0;
    var weights = 0.0;
    for (var k = -settings.reach; k <= settings.reach; k++) {
        let weight = exp(settings.falloff * f32(k * k));
        // Beyond the border the outermost texel goes on.
        sum += weight * textureLoad(source, clamp(texel + k * settings.along, vec2(0), last), 0).x;
        weights += weight;
    }
    return vec4(sum / weights);
}
