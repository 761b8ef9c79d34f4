// defs: SLICED=0, BEER=0, REJECTION=1, SPHERE=0
// Direct volume rendering with ambient occlusion over the hemisphere down the gradient. VAO §5.2.2, Eq. 3.
#import fathom::media::{Targets, composite}
#import fathom::screen

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> Targets {
    return composite(pixel.xy);
}
