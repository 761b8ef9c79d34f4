// defs: COLUMNS=128, ROWS=256, UNORM=0
// The simplest draws: a triangle over the whole target, and a grid of triangles of a pixel each.

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
fn one() -> @location(0) vec4<f32> {
#if UNORM == 1
    return vec4<f32>(1.0 / 255.0);
#else
    return vec4<f32>(1.0);
#endif
}
