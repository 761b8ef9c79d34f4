// Numbers and frames for sampling directions.
#define_import_path fathom::sampling

// The upper 24 bits as a number in [0, 1), exactly.
fn unit(v: u32) -> f32 {
    return f32(v >> 8u) / 16777216.0;
}

// Rotation that brings +z to n: Duff et al., JCGT 6(1), 2017.
fn tangent_frame(n: vec3<f32>) -> mat3x3<f32> {
    let side = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (side + n.z);
    let b = n.x * n.y * a;
    return mat3x3(
        vec3(1.0 + side * n.x * n.x * a, side * b, -side * n.x), vec3(b, side + n.y * n.y * a, -n.y), n);
}
