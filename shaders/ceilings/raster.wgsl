// defs: COLUMNS=128, ROWS=256, UNORM=0
// The simplest draws: a triangle over the whole target, and a grid of triangles of a pixel each; and fragments that load and compute.
#import fathom::ceilings::{loads_2d, loads_3d, multiply_adds}

@vertex
fn whole(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(vec2<f32>(vec2<u32>(index & 1u, index >> 1u)) * 4.0 - 1.0, 0.5, 1.0);
}

// A cell of the grid is two pixels wide and one high, and two triangles.
@vertex
fn grid(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<u32>(index % (#{COLUMNS}u + 1u), index / (#{COLUMNS}u + 1u));
    let share = vec2<f32>(corner) / vec2<f32>(#{COLUMNS}.0, #{ROWS}.0);
    return vec4<f32>(share * 2.0 - 1.0, 0.5, 1.0);
}

// One, in the format's own steps.
@fragment
fn fragment() -> @location(0) vec4<f32> {
#if UNORM == 1
    return vec4<f32>(1.0 / 255.0);
#else
    return vec4<f32>(1.0);
#endif
}

@fragment
fn load_2d(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(loads_2d(vec2<u32>(at.xy)));
}

@fragment
fn load_3d(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4<f32>(loads_3d(vec2<u32>(at.xy)));
}

@fragment
fn multiply_add() -> @location(0) vec4<f32> {
    return vec4<f32>(multiply_adds());
}
