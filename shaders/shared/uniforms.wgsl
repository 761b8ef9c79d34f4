// What every stage of a frame shares: cameras, light, water. Host twin: src/stages/uniforms.rs.
#define_import_path fathom::uniforms

#import fathom::math::{perspective_divide}

struct Frame {
    camera_view_projection: mat4x4<f32>,
    camera_inverse: mat4x4<f32>,
    // The camera mirrored about the resting water y = 0.
    mirror_view_projection: mat4x4<f32>,
    light_view_projection: mat4x4<f32>,
    light_inverse: mat4x4<f32>,
    // From places of the photon grid, −1 … 1 along each side, and a depth to the world.
    photon_grid: mat4x4<f32>,
    camera_position_m: vec3<f32>,
    z_near_m: f32,
    // Direction of travel at the middle of the light frustum.
    light_forward: vec3<f32>,
    z_far_m: f32,
    light_position_m: vec3<f32>,
    // 1 for a point light, 0 for a directional one.
    light_is_point: u32,
    // Irradiance at normal incidence in the middle of the view, W/m².
    light_irradiance: f32,
    // Depth difference, in the light's depth range 0…1, that counts as an edge.
    light_depth_jump: f32,
    refractive_index: f32,
    attenuation_per_m: f32,
    water_center_m: vec2<f32>,
    water_half_size_m: vec2<f32>,
    water_amplitude_m: f32,
    // 2π / wavelength, 1/m.
    wavenumber_per_m: f32,
    // ω t, radians.
    phase: f32,
    noise_share: f32,
    noise_tile_m: f32,
    // Scroll of the noise along x, in tiles.
    noise_scroll: f32,
    // 0 circular, 1 directional; given water is compiled in.
    water_model: u32,
    // 1 where the camera is below the resting water.
    camera_under_water: u32,
    // How far the surface is from y = 0 at most.
    water_bound_m: f32,
    // Horizontal length of a step of the search for a ray's entry, and most steps.
    water_step_m: f32,
    water_steps: f32,
    // Tangent of the angle to the vertical up to which Newton's method finds a ray's entry.
    water_newton_slant: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
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
