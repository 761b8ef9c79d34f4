// defs: AT_ISOSURFACE=1, BEER=0, ISOSURFACE=1, LINEAR=1, OPACITY=0, REJECTION=1
// First isosurface on the view ray with ambient occlusion. VAO §5.2.1; marching as in §5.1.
//
// AT_ISOSURFACE 1: rays stop at values near the isosurface's; 0: at values from V_thres. LINEAR 1: ρ = 1 − d / r_max; 0: 1.
// OPACITY 1: rays begin at the surface and gather opacity up to their stop (Eq. 7). REJECTION 1: samples of falling value do not count (Eq. 4).
#import fathom::obscurance::{is_occluder, obscurance}
#import fathom::ray_cast::{march, Ray, windowed, view_ray, along, seed_of, lit, background, display}
#import fathom::scalar_field::{field, value, outward, through_box, look_ups}
#import fathom::sphere::{shift_of, shifted_point, cosine_direction, tangent_frame}

struct Targets {
    @location(0) image: vec4<f32>,
    // Visibility, 1 where there is a surface, its distance, look-ups.
    @location(1) result: vec4<f32>,
    @location(2) normal: vec4<f32>,
}

// Halvings of the step that holds the crossing, before the last secant.
const HALVINGS: u32 = 6u;

// Distance of the first point with at least the isosurface's value, none: −1. A ray that begins within ends there.
fn first_crossing(ray: Ray) -> f32 {
    var before = ray.near_m;
    if ray.far_m <= before {
        return -1.0;
    }
    if value(along(ray, before), 0.0) >= march.iso {
        return before;
    }
    let steps = u32(ceil((ray.far_m - ray.near_m) / march.view_step_m));
    for (var k = 1u; k <= steps; k++) {
        let d = min(ray.near_m + f32(k) * march.view_step_m, ray.far_m);
        if value(along(ray, d), 0.0) >= march.iso {
            return crossing(ray.origin_m, ray.direction, before, d, march.iso);
        }
        before = d;
    }
    return -1.0;
}

// Distance between two along a ray, outside and inside, at which V crosses a level: bisection, then a secant through the ends of what is
// left.
fn crossing(origin_m: vec3<f32>, direction: vec3<f32>, outside_m: f32, inside_m: f32, level: f32) -> f32 {
    var low = outside_m;
    var high = inside_m;
    for (var i = 0u; i < HALVINGS; i++) {
        let middle = 0.5 * (low + high);
        if value(origin_m + middle * direction, 0.0) >= level {
            high = middle;
        } else {
            low = middle;
        }
    }
    let below = value(origin_m + low * direction, 0.0);
    let above = value(origin_m + high * direction, 0.0);
    return mix(low, high, saturate((level - below) / max(above - below, 1e-6)));
}

// Value of the surface that rays end at.
fn level() -> f32 {
#if AT_ISOSURFACE == 1
    return march.iso;
#else
    return march.threshold;
#endif
}

#if OPACITY == 1
fn obscurity(position_m: vec3<f32>, normal: vec3<f32>, direction: vec3<f32>, jitter: f32, first: f32) -> f32 {
    return obscurance(position_m, direction, jitter, first, 0.0);
}
#else
// ρ of the nearest occluder along a ray; 0 where there is none, and for rays that do not leave the guard (VAO §5.1).
fn obscurity(position_m: vec3<f32>, normal: vec3<f32>, direction: vec3<f32>, jitter: f32, first: f32) -> f32 {
    let reach = min(march.r_max_m, through_box(position_m, direction).y);
    // VAO Eq. 2 with h of half a cell's diagonal.
    let start = field.guard_m / max(dot(direction, normal), 1e-6);
    if start >= reach {
        return 0.0;
    }
    var before = start;
    // The last stratum may be a shorter one, and ends at the ray's end.
    for (var k = 0u; before < reach; k++) {
        let d = min(start + f32(k) * march.stratum_m, reach);
        let v = value(position_m + d * direction, 0.0);
        if is_occluder(v) {
#if LINEAR == 1
            // A sample lies up to a stratum behind the surface that it finds.
            var met = d;
            if d > before && v >= level() {
                met = crossing(position_m, direction, before, d, level());
            }
            return 1.0 - met / march.r_max_m;
#else
            return 1.0;
#endif
        }
        before = d;
    }
    return 0.0;
}
#endif

// A of VAO Eq. 1 by cosine-distributed rays.
fn occlusion(position_m: vec3<f32>, normal: vec3<f32>, seed: u32) -> f32 {
    let shift = shift_of(seed);
    let basis = tangent_frame(normal);
#if OPACITY == 1
    let first = windowed(value(position_m, 0.0));
#else
    let first = 0.0;
#endif
    var sum = 0.0;
    for (var j = 0u; j < march.rays; j++) {
        let point = shifted_point(j, march.rays, shift);
        sum += obscurity(position_m, normal, basis * cosine_direction(point.xy), point.z, first);
    }
    return sum / f32(march.rays);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> Targets {
    let ray = view_ray(pixel.xy);
    let d = first_crossing(ray);
    if d < 0.0 {
        let image = display(background(ray.direction));
        return Targets(image, vec4(1.0, 0.0, 0.0, f32(look_ups)), vec4(0.0));
    }
    let p = along(ray, d);
    let normal = outward(p, -ray.direction);
    let visibility = 1.0 - occlusion(p, normal, seed_of(pixel.xy));
    let image = display(lit(windowed(march.iso), p, normal, visibility));
    return Targets(image, vec4(visibility, 1.0, d, f32(look_ups)), vec4(normal, 1.0));
}
