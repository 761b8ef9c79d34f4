// Horizon-split ambient occlusion: Dimitrov, Bavoil and Sainz, I3D 2008; distance attenuation as in Bavoil and Sainz, ShaderX7,
// 2009; rejection of samples of other layers, VAO §6.
// defs: HARD=0, COUNT=0, COUNTERS=1
//
// VAO Eq. 1 is A = 1/π ∫∫ ρ cos dω, cut at the horizon of each slice: what lies below is integrated in closed form (part 1), what lies
// above is sampled with rays (part 2).
#import fathom::host::{HorizonUniforms}
#import fathom::horizon::{GOLDEN_FRACTION, Point, Slice, attenuation, cosine_of, depth, integral, pixel_at, sample_along, sample_depth, shaded_point, slice_along, surface_at, tangent_cosine, view_px}
#import fathom::uniforms::{frame, view_depth_m}
#if COUNT == 1
#import fathom::counters::{count}
#import fathom::horizon::{taken}
#endif
#import fathom::math::{TAU}
#import fathom::random::{GOLDEN, pcg, unit}
#import fathom::screen
#import fathom::sphere::{PLASTIC, tangent_frame}

@group(1) @binding(0) var<storage, read> settings: HorizonUniforms;

struct Horizon {
    // ∫ ρ cos dω / dψ below the horizon.
    occluded: f32,
    // cos θ of the horizon.
    cosine: f32,
}

// Part 1: samples of depth along the slice's line raise the horizon, each new stretch weighted by its sample's distance.
fn find_horizon(point: Point, slice: Slice, jitter: f32) -> Horizon {
    var horizon = Horizon(0.0, tangent_cosine(slice));
    if slice.length_px <= 1.0 {
        return horizon;
    }
    var below = integral(slice, horizon.cosine);
    var height = 0.0;
    for (var k = 0u; k < settings.steps; k++) {
        let seen = sample_along(point, slice, f32(k) + jitter, settings.steps, settings.r_max_m);
        let rise = dot(seen.v, point.to_eye);
        // A layer nearer to the eye does not count: VAO §6.
        if !seen.counts || rise - height > settings.layer_m {
            continue;
        }
        height = rise;
        let found = cosine_of(point, slice, seen.v);
        if found > horizon.cosine {
            let now = integral(slice, found);
            horizon.occluded += attenuation(seen.distance_m / settings.r_max_m) * (below - now);
            horizon.cosine = found;
            below = now;
        }
    }
    return horizon;
}

// Part 2: one ray above the horizon, at cos θ = x, marched until it goes behind a surface that is not deeper than a layer.
// Returns ρ times its cosine with the normal, 0 without a hit.
fn march(point: Point, slice: Slice, x: f32, jitter: f32) -> f32 {
    let sine = sqrt(max(1.0 - x * x, 0.0));
    let step_clip = settings.r_max_m * (x * point.eye_clip + sine * slice.clip);
    for (var k = 0u; k < settings.ray_steps; k++) {
        let share = (f32(k) + jitter) / f32(settings.ray_steps);
        let clip = point.clip + share * step_clip;
        if clip.w <= frame.z_near_m {
            break;
        }
        let position_px = pixel_at(clip);
        if any(position_px < vec2(0.0)) || any(position_px >= view_px()) {
            break;
        }
        let texel = vec2<i32>(position_px);
        let z = sample_depth(texel);
        let behind_m = clip.w - view_depth_m(z);
        // Background has no depth: rays that pass the far plane would meet it there.
        if z >= 1.0 || behind_m <= 0.0 || behind_m > settings.layer_m || all(texel == point.texel) {
            continue;
        }
        // The texel's surface hides the ray where it rises above it, as seen from the shaded point.
        if cosine_of(point, slice, surface_at(texel, z) - point.position_m) > x {
            return attenuation(share) * (slice.toward * x + slice.aside * sine);
        }
    }
    return 0.0;
}

// A of VAO Eq. 1: each direction stands for 2π / directions of the angle ψ.
fn occlusion(point: Point, seed: u32) -> f32 {
    let first = pcg(seed);
    let second = pcg(first);
    let third = pcg(second);
    let rotation = unit(seed);
    let basis = tangent_frame(point.to_eye);
    var horizons = 0.0;
    var marched = 0.0;
    var ray = 0u;
    for (var i = 0u; i < settings.directions; i++) {
        let angle = TAU * (f32(i) / f32(settings.directions) + rotation);
        let slice = slice_along(point, basis[0] * cos(angle) + basis[1] * sin(angle), settings.r_max_m);
        let horizon = find_horizon(point, slice, fract(unit(first) + f32(i) * GOLDEN_FRACTION));
        horizons += horizon.occluded;
        // This direction's part of the rays, in strata of cos θ.
        let from_ray = ray;
        let to_ray = (i + 1u) * settings.rays / settings.directions;
        for (; ray < to_ray; ray++) {
            let shift = fract(vec2(unit(second), unit(third)) + f32(ray) * PLASTIC);
            let stratum = (f32(ray - from_ray) + shift.x) / f32(to_ray - from_ray);
            let open = 1.0 - horizon.cosine;
            marched += open * march(point, slice, horizon.cosine + open * stratum, shift.y);
        }
    }
    return 2.0 * (horizons / f32(settings.directions) + marched / f32(max(settings.rays, 1u)));
}

// Visibility 1 − A; 1 where nothing was drawn.
@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = screen::texel_behind(pixel.xy, vec2<f32>(settings.size_px), view_px());
    let z = textureLoad(depth, texel, 0);
    if z >= 1.0 {
        return vec4(1.0);
    }
    let own = vec2<u32>(pixel.xy);
    let occluded = occlusion(shaded_point(texel, z), pcg(own.x + 65536u * own.y + settings.seed * GOLDEN));
#if COUNT == 1
    let slot = own.x & 63u;
    count(0u, slot, taken);
    count(1u, slot, 1u);
#endif
    return vec4(1.0 - saturate(occluded));
}
