// defs: AT_ISOSURFACE=0, BEER=0, ISOSURFACE=0, REJECTION=1, SLICED=0, SPHERE=0
// Direct volume rendering with ambient occlusion over the hemisphere down the gradient. VAO §5.2.2, Eq. 3.
#import fathom::media::{Targets, composite}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> Targets {
    return composite(pixel.xy);
}
