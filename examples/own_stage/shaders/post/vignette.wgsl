// Darkens the picture towards its corners: a blended triangle whose alpha grows with the distance from the middle.
#import fathom::screen

struct Vignette {
    size_px: vec2<f32>,
}

@group(0) @binding(0) var<uniform> settings: Vignette;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let from_middle = length(2.0 * pixel.xy / settings.size_px - 1.0);
    return vec4(0.0, 0.0, 0.0, 0.3 * from_middle * from_middle);
}
