// Scene depth from the light, UW §3 step 2a.
#import fathom::uniforms::{frame}

@vertex
fn vertex(@location(0) position_m: vec3<f32>) -> @builtin(position) vec4<f32> {
    return frame.light_view_projection * vec4(position_m, 1.0);
}
