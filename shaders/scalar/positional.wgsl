// defs: AT_ISOSURFACE=0, BEER=0, ISOSURFACE=0, REJECTION=1, SLICED=0, SPHERE=1
// Participating media with positional ambient occlusion. VAO §5.2.4, Eq. 8.
#import fathom::media::{Targets, composite}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> Targets {
    return composite(pixel.xy);
}
