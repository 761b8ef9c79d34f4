// A full-screen triangle whose run time is proportional to `work.iterations`.
#import fathom::busy_work::logistic

struct Work {
    iterations: u32,
}

@group(0) @binding(0) var<uniform> work: Work;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32(index & 1u), f32(index >> 1u));
    return vec4<f32>(corner * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let value = logistic(pixel.x + 0.37 * pixel.y, work.iterations);
    return vec4<f32>(value, value, value, 1.0);
}
