// Multi-tap low-pass with a kernel rotated per pixel: UW §3.5.
#import fathom::disc::{low_pass}

struct Filter {
    taps: u32,
    radius_px: f32,
}

@group(0) @binding(0) var<storage, read> settings: Filter;
@group(0) @binding(1) var source: texture_2d<f32>;

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    return low_pass(source, pixel.xy, settings.taps, settings.radius_px);
}
