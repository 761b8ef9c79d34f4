// What every stage of a frame shares: cameras, light, water. Host twin: src/stages/uniforms.rs.
#define_import_path fathom::uniforms

#import fathom::host::{FrameUniforms}
#import fathom::math::{perspective_divide}

@group(0) @binding(0) var<uniform> frame: FrameUniforms;
// What the surface is made from. Models: (n, ∂n/∂u, ∂n/∂v) of tile-periodic Perlin noise, texel centres at (i + 0.5) / size.
// A list of waves: a texel for each, (kx, kz, amplitude, phase).
@group(0) @binding(1) var water_texels: texture_2d<f32>;

// World point at a place of the picture, 0…1 from its upper left corner, and a device depth.
fn world_at(uv: vec2<f32>, z: f32) -> vec3<f32> {
    return perspective_divide(frame.camera_inverse * vec4(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, z, 1.0));
}

// Focal lengths of the camera, in halves of the picture's width and height: lengths of the projection's first rows.
fn focal_lengths() -> vec2<f32> {
    let rows = transpose(frame.camera_view_projection);
    return vec2(length(rows[0].xyz), length(rows[1].xyz));
}

// Distance along the view direction at a device depth, metres.
fn view_depth_m(z: f32) -> f32 {
    return frame.z_near_m * frame.z_far_m / (frame.z_far_m - z * (frame.z_far_m - frame.z_near_m));
}
