// What the stages that cast view rays through a scalar field share: settings, rays, look. Host twin: src/stages/shared/ray_cast.rs.
#define_import_path fathom::ray_cast

#import fathom::uniforms::{frame}
#import fathom::math::{perspective_divide}
#import fathom::random::{pcg}
#import fathom::scalar_field::{through_box}
#import fathom::shading::{to_light}

struct March {
    size_px: vec2<f32>,
    // Values at which opacity begins and is full.
    window: vec2<f32>,
    low_color: vec3<f32>,
    // Share of the light that comes evenly from all sides.
    ambient: f32,
    high_color: vec3<f32>,
    // Step along view rays.
    view_step_m: f32,
    iso: f32,
    tolerance: f32,
    // V_thres: of the value on isosurfaces, of the windowed value in media.
    threshold: f32,
    rays: u32,
    samples: u32,
    r_max_m: f32,
    // r_max / N_samples.
    stratum_m: f32,
    // Level of the average pyramid whose cells are as long as a stratum.
    level: f32,
    // Of one voxel at the window's end.
    opacity: f32,
    // σ at the window's end, 1/m.
    density_per_m: f32,
}

@group(1) @binding(3) var<uniform> march: March;

// Transmittance below which nothing more shows in 8 bits: rays end there. A and the opacity of a view ray are less than those of whole rays
// by at most this.
const OPAQUE: f32 = 0.00390625;
// Behind the volume; tuned on scene engine.
const BACKGROUND_LOW: vec3<f32> = vec3<f32>(0.25, 0.28, 0.33);
const BACKGROUND_HIGH: vec3<f32> = vec3<f32>(0.70, 0.76, 0.85);

struct Ray {
    origin_m: vec3<f32>,
    // Where it enters the box or passes the near plane.
    near_m: f32,
    direction: vec3<f32>,
    // Where it leaves the box or passes the far plane; less than near_m where it misses.
    far_m: f32,
}

fn unproject(clip: vec3<f32>) -> vec3<f32> {
    return perspective_divide(frame.camera_inverse * vec4(clip, 1.0));
}

// The camera's ray through a pixel, cut to the box.
fn view_ray(pixel: vec2<f32>) -> Ray {
    let clip = vec2(pixel.x / march.size_px.x * 2.0 - 1.0, 1.0 - pixel.y / march.size_px.y * 2.0);
    let origin = frame.camera_position_m;
    let first = unproject(vec3(clip, 0.0)) - origin;
    let last = unproject(vec3(clip, 1.0)) - origin;
    let direction = normalize(first);
    let inside = through_box(origin, direction);
    return Ray(origin, max(inside.x, length(first)), direction, min(inside.y, length(last)));
}

fn along(ray: Ray, distance_m: f32) -> vec3<f32> {
    return ray.origin_m + distance_m * ray.direction;
}

// A seed of its own for each pixel.
fn seed_of(pixel: vec2<f32>) -> u32 {
    return pcg(u32(pixel.x) + pcg(u32(pixel.y)));
}

// Place of a value in the window, 0…1.
fn windowed(v: f32) -> f32 {
    return saturate((v - march.window.x) / (march.window.y - march.window.x));
}

// Light that a surface of this place in the window sends on, relative to white in full light. VAO §5.2.2: ambient
// occlusion stands in for all attenuation of the arriving light.
fn lit(windowed_value: f32, position_m: vec3<f32>, normal: vec3<f32>, visibility: f32) -> vec3<f32> {
    let facing = saturate(dot(normal, to_light(position_m)));
    return mix(march.low_color, march.high_color, windowed_value) * visibility * mix(facing, 1.0, march.ambient);
}

fn background(direction: vec3<f32>) -> vec3<f32> {
    return mix(BACKGROUND_LOW, BACKGROUND_HIGH, saturate(0.5 + 0.5 * direction.y));
}

fn display(radiance: vec3<f32>) -> vec4<f32> {
    return vec4(pow(saturate(radiance), vec3(1.0 / 2.2)), 1.0);
}
