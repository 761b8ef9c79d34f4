// Clip square, pixels and texels.
#define_import_path fathom::screen

// Corner of the one triangle that covers the clip square.
fn corner(index: u32) -> vec4<f32> {
    return vec4(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// Position of a vertex that no rasterizer draws: outside the clip volume.
const NOT_DRAWN: vec4<f32> = vec4<f32>(2.0, 2.0, 2.0, 1.0);

// Pixel coordinates of a point of the clip square, −1 … 1 to the right and upwards. Row 0 is at the top.
fn to_pixels(ndc: vec2<f32>, size_px: vec2<f32>) -> vec2<f32> {
    return (ndc * vec2(0.5, -0.5) + 0.5) * size_px;
}

// The camera's depth at a pixel of a buffer of another size, nearest texel.
fn depth_at(depth: texture_depth_2d, pixel: vec2<f32>, size_px: vec2<f32>) -> f32 {
    return textureLoad(depth, texel_behind(pixel, size_px, vec2<f32>(textureDimensions(depth))), 0);
}

// Texel of a buffer of `size_px` pixels behind a pixel of one of `own_px` pixels. Middles of pixels often fall on borders
// of texels: the nudge sends all of them the same way, whatever the rounding.
fn texel_behind(pixel: vec2<f32>, own_px: vec2<f32>, size_px: vec2<f32>) -> vec2<i32> {
    return clamp(vec2<i32>(pixel * (size_px / own_px) + 1e-3), vec2(0), vec2<i32>(size_px) - 1);
}
