// Participating media along view rays, with ambient occlusion at each contributing sample. VAO §5.2.2 to §5.2.4.
//
// V of the equations is the windowed value. BEER 1: it is a density (Eq. 5); 0: an opacity (Eq. 7). SLICED 1: a pass takes a slice of the
// steps along the view ray. SPHERE 1: positional ambient occlusion (Eq. 8); 0: over the hemisphere down the gradient (Eq. 3).
#define_import_path fathom::media

#import fathom::obscurance::{obscurance}
#import fathom::ray_cast::{march, windowed, view_ray, along, seed_of, lit, background, display, OPAQUE}
#import fathom::scalar_field::{field, value, outward, look_ups}
#import fathom::slice::{Slice}
#import fathom::sphere::{shift_of, shifted_point, cosine_direction, sphere_direction, tangent_frame}

#if SLICED == 1
// What a pixel's steps have left so far.
struct State {
    radiance: vec3<f32>,
    through: f32,
    visible: f32,
    far: f32,
    counted: u32,
}

@group(1) @binding(4) var<storage, read> slice: Slice;
@group(1) @binding(5) var<storage, read_write> states: array<State>;
#endif

struct Targets {
    @location(0) image: vec4<f32>,
    // Visibility and distance, weighted by contribution; opacity; look-ups.
    @location(1) result: vec4<f32>,
}

// −ln τ of a metre at a windowed value, 1/m: Beer's law, or σ̂ of VAO §5.2.3.
fn attenuation(v: f32) -> f32 {
#if BEER == 1
    return march.density_per_m * v;
#else
    // Opacity 1 is taken as one that lets a millionth through a voxel.
    return -log(max(1.0 - march.opacity * v, 1e-6)) / field.voxel_m;
#endif
}

// A at a point: the mean of γ over directions, cosine-distributed for Eq. 3, so that no factor is left to apply.
fn occlusion(position_m: vec3<f32>, normal: vec3<f32>, seed: u32) -> f32 {
    let shift = shift_of(seed);
    let first = windowed(value(position_m, march.level));
#if SPHERE == 0
    let basis = tangent_frame(normal);
#endif
    var sum = 0.0;
    for (var j = 0u; j < march.rays; j++) {
        let point = shifted_point(j, march.rays, shift);
#if SPHERE == 1
        let direction = sphere_direction(point.xy);
#else
        let direction = basis * cosine_direction(point.xy);
#endif
        sum += obscurance(position_m, direction, point.z, first, march.level);
    }
    return sum / f32(march.rays);
}

// Light of a sample towards the viewer.
fn scattered(v: f32, position_m: vec3<f32>, normal: vec3<f32>, visibility: f32) -> vec3<f32> {
#if SPHERE == 1
    // A particle has no side that faces the light: Eq. 8 alone shades it.
    return mix(march.low_color, march.high_color, v) * visibility;
#else
    return lit(v, position_m, normal, visibility);
#endif
}

// Front-to-back compositing along a pixel's view ray, in equal steps of at most view_step_m, each sampled in its middle.
fn composite(pixel: vec2<f32>) -> Targets {
    let ray = view_ray(pixel);
    let whole = max(ray.far_m - ray.near_m, 0.0);
    let steps = u32(ceil(whole / march.view_step_m));
    let step_m = whole / max(f32(steps), 1.0);
    let seed = seed_of(pixel);
    var through = 1.0;
    var radiance = vec3(0.0);
    var visible = 0.0;
    var far = 0.0;
    var first = 0u;
    var end = steps;
#if SLICED == 1
    let index = u32(pixel.y) * u32(march.size_px.x) + u32(pixel.x);
    if slice.first > 0u {
        let before = states[index];
        radiance = before.radiance;
        through = before.through;
        visible = before.visible;
        far = before.far;
        look_ups = before.counted;
    }
    first = slice.first;
    end = min(steps, slice.end);
#endif
    for (var k = first; k < end && through > OPAQUE; k++) {
        let d = ray.near_m + (f32(k) + 0.5) * step_m;
        let p = along(ray, d);
        let v = windowed(value(p, 0.0));
        let weight = through * (1.0 - exp(-attenuation(v) * step_m));
        if weight <= 0.0 {
            continue;
        }
#if SPHERE == 1
        let normal = -ray.direction;
#else
        let normal = outward(p, -ray.direction);
#endif
        let visibility = 1.0 - occlusion(p, normal, seed + k);
        radiance += weight * scattered(v, p, normal, visibility);
        visible += weight * visibility;
        far += weight * d;
        through -= weight;
    }
#if SLICED == 1
    states[index] = State(radiance, through, visible, far, look_ups);
#endif
    let opacity = 1.0 - through;
    let image = display(radiance + through * background(ray.direction));
    if opacity <= 0.0 {
        return Targets(image, vec4(1.0, 0.0, 0.0, f32(look_ups)));
    }
    return Targets(image, vec4(visible / opacity, opacity, far / opacity, f32(look_ups)));
}
