// Axes of a pass that draws the scene along one of the world's axes. VAO §4. AXIS: 0 x, 1 y, 2 z.
#define_import_path fathom::pass_axes

// Column and row of the pass, and depth.
fn swizzled(v: vec3<f32>) -> vec3<f32> {
#if AXIS == 0
    return v.yzx;
#else if AXIS == 1
    return v.xzy;
#else
    return v.xyz;
#endif
}
