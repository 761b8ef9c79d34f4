// Multi-tap low-pass with a kernel rotated per pixel: UW §3.5.
#import fathom::host::{FilterUniforms}
#import fathom::disc::{low_pass}

@group(0) @binding(0) var<storage, read> settings: FilterUniforms;
@group(0) @binding(1) var source: texture_2d<f32>;

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    return low_pass(source, pixel.xy, settings.taps, settings.radius_px);
}
