// Joint bilateral filter and up-scaling of the ambient-occlusion buffer: VAO §6.
// defs: SQUARE=0
#import fathom::bilateral::{filtered}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4(filtered(pixel.xy));
}
