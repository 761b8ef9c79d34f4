// Passes over the whole screen.
#define_import_path fathom::screen

// Corner of the one triangle that covers the clip square.
fn corner(index: u32) -> vec4<f32> {
    return vec4(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// The camera's depth at a pixel of a buffer of another size, nearest texel.
fn depth_at(depth: texture_depth_2d, pixel: vec2<f32>, size_px: vec2<f32>) -> f32 {
    let place = pixel / size_px * vec2<f32>(textureDimensions(depth));
    return textureLoad(depth, vec2<i32>(place), 0);
}
