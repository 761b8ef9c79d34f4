// Rings of ripples about the middle of the picture, added up.
#import fathom::host::{RippleUniforms}

@group(0) @binding(0) var<storage, read> settings: RippleUniforms;

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let from_middle = length(2.0 * pixel.xy / settings.size_px - 1.0);
    var height = 0.0;
    for (var ring = 1u; ring <= settings.rings; ring++) {
        height += cos(6.2831855 * from_middle * f32(ring) / settings.wavelength) / f32(settings.rings);
    }
    return vec4(vec3(0.5 + 0.5 * height), 1.0);
}
