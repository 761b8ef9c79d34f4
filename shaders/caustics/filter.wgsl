// Multi-tap low-pass with a kernel rotated per pixel: UW §3.5. Taps on another surface than the pixel's do not count: UW has no such
// test, and light then spreads over silhouettes.
#import fathom::host::{GuidedUniforms}
#import fathom::disc::{pixel_rotation, rotated_tap}
#import fathom::uniforms::{view_depth_m}
#import fathom::surface_plane::{beyond_plane_m, depth_texel, plane_at}

@group(1) @binding(0) var<storage, read> settings: GuidedUniforms;
@group(1) @binding(1) var source: texture_2d<f32>;
@group(1) @binding(2) var depth: texture_depth_2d;

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let own_px = vec2<f32>(textureDimensions(source));
    let last = vec2<i32>(own_px) - 1;
    let plane = plane_at(depth, depth_texel(depth, pixel.xy, own_px));
    let max_off_m = settings.depth_share * view_depth_m(plane.z);
    let rotation = pixel_rotation(vec2<u32>(pixel.xy));
    var sum = 0.0;
    var counted = 0.0;
    for (var i = 0u; i < settings.taps; i++) {
        let tap = rotated_tap(pixel.xy, rotation, i, settings.taps, settings.radius_px);
        let texel = clamp(vec2<i32>(floor(tap)), vec2(0), last);
        let seen = depth_texel(depth, vec2<f32>(texel) + 0.5, own_px);
        if abs(beyond_plane_m(plane, depth, seen)) <= max_off_m {
            sum += textureLoad(source, texel, 0).x;
            counted += 1.0;
        }
    }
    if counted == 0.0 {
        return vec4(textureLoad(source, vec2<i32>(pixel.xy), 0).x);
    }
    return vec4(sum / counted);
}
