// Photons from the light's grid through the water to the scene: UW §3.3 with the image-space estimator of
// Shah and Konttinen (UW reference [7]).
#define_import_path fathom::photon

#import fathom::frame::{frame}
#import fathom::random::{pcg}
#import fathom::water

struct Photon {
    entry_m: vec3<f32>,
    // |p_e − p_proj| in the last iteration; −1: never enters the water; −2: left the light frustum or meets nothing;
    // −3: still between mirrors or glass after the most bounces.
    residual_m: f32,
    hit_m: vec3<f32>,
    // From entry to hit.
    distance_m: f32,
}

struct Trace {
    // Cells per side of the grid.
    grid: u32,
    // Photons per side of a cell, where the loop bound is a run-time value.
    side: u32,
    iterations: u32,
    // 1: photons are tested against the water mask.
    masked: u32,
    // Place of a photon within its share of the cell, 0…1; the middle is 0.5.
    offset: vec2<f32>,
    // First estimate d0 of the distance from the surface.
    start_m: f32,
    // Residual up to which a photon counts as converged; only the host asks.
    tolerance_m: f32,
    // Share of its part of the cell in which a photon is strewn; 0: the grid is regular.
    jitter: f32,
}

const MISSED: f32 = -1.0;
const OUTSIDE: f32 = -2.0;
const ON_ITS_WAY: f32 = -3.0;
// Newton steps for the ray against the height field. Each squares the error, which starts at the wave's amplitude times
// the ray's slope: the third step is below f32 resolution, so its slope serves for the normal.
const SURFACE_STEPS: i32 = 3;

struct Ray {
    origin_m: vec3<f32>,
    direction: vec3<f32>,
}

fn divide(v: vec4<f32>) -> vec3<f32> {
    return v.xyz / v.w;
}

// Ray through a point of the light's canonical screen space, from the near plane on.
fn light_ray(ndc: vec2<f32>) -> Ray {
    let near = divide(frame.light_inverse * vec4(ndc, 0.0, 1.0));
    let far = divide(frame.light_inverse * vec4(ndc, 1.0, 1.0));
    return Ray(near, normalize(far - near));
}

struct Entry {
    position_m: vec3<f32>,
    normal: vec3<f32>,
}

// Where the ray meets the water.
fn meet_water(ray: Ray) -> Entry {
    var t = -ray.origin_m.y / ray.direction.y;
    var h = vec3(0.0);
    for (var i = 0; i < SURFACE_STEPS; i++) {
        let p = ray.origin_m + t * ray.direction;
        h = water::surface(p.xz);
        t += (h.x - p.y) / (ray.direction.y - dot(h.yz, ray.direction.xz));
    }
    return Entry(ray.origin_m + t * ray.direction, water::normal(h.yz));
}

// The scene point that the light sees along the line through p: (point, 1), or (…, 0) outside the frustum and where
// there is nothing to see.
// Depth is interpolated bilinearly, which is exact on planes; across an edge the nearest texel counts.
fn seen_from_light(depth: texture_depth_2d, texels: sampler, p: vec3<f32>) -> vec4<f32> {
    let ndc = divide(frame.light_view_projection * vec4(p, 1.0));
    if any(abs(ndc.xy) > vec2(1.0)) {
        return vec4(0.0);
    }
    let size = vec2<f32>(textureDimensions(depth));
    let place = (ndc.xy * vec2(0.5, -0.5) + 0.5) * size - 0.5;
    let base = floor(place);
    let f = place - base;
    // The corner where four texels meet: no rounding of the sampler's can choose others.
    let four = textureGather(depth, texels, (base + 1.0) / size);
    let a = four.w;
    let b = four.z;
    let c = four.x;
    let d = four.y;
    var z = mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
    if max(max(a, b), max(c, d)) - min(min(a, b), min(c, d)) > frame.light_depth_jump {
        z = select(select(a, b, f.x > 0.5), select(c, d, f.x > 0.5), f.y > 0.5);
    }
    if z >= 1.0 {
        return vec4(0.0);
    }
    return vec4(divide(frame.light_inverse * vec4(ndc.xy, z, 1.0)), 1.0);
}

fn in_mask(mask: texture_2d<f32>, ndc: vec2<f32>) -> bool {
    let size = vec2<f32>(textureDimensions(mask));
    let texel = vec2<i32>((ndc * vec2(0.5, -0.5) + 0.5) * size);
    return textureLoad(mask, texel, 0).x > 0.5;
}

// A photon's share of the light's energy relative to the middle of the frustum. A grid that is even in screen space is not
// even in solid angle: dΩ = cos³θ dA at unit distance from a point light. A directional light's photons are all alike.
fn angular_weight(entry_m: vec3<f32>) -> f32 {
    if frame.light_is_point == 0u {
        return 1.0;
    }
    let cosine = dot(normalize(entry_m - frame.light_position_m), frame.light_forward);
    return cosine * cosine * cosine;
}

// Direction in which the light reaches a point.
fn light_direction(p: vec3<f32>) -> vec3<f32> {
    if frame.light_is_point == 0u {
        return frame.light_forward;
    }
    return normalize(p - frame.light_position_m);
}

// Share of unpolarised light that passes from air into water (Fresnel), for unit directions before and behind the surface.
// By Snell's law the normal lies along incident − n · refracted.
fn transmittance(incident: vec3<f32>, refracted: vec3<f32>) -> f32 {
    let n = frame.refractive_index;
    let across = incident - n * refracted;
    let scale = length(across);
    // The index of air: there is no surface.
    if scale < 1e-4 {
        return 1.0;
    }
    let cos_i = abs(dot(incident, across)) / scale;
    let cos_t = abs(dot(refracted, across)) / scale;
    let s = (cos_i - n * cos_t) / (cos_i + n * cos_t);
    let p = (n * cos_i - cos_t) / (n * cos_i + cos_t);
    return 1.0 - 0.5 * (s * s + p * p);
}

// The share of a traced photon's energy that enters the water. Its own path gives the refracted direction.
fn entered(photon: Photon) -> f32 {
    if photon.distance_m <= 0.0 {
        return 1.0;
    }
    let refracted = (photon.hit_m - photon.entry_m) / photon.distance_m;
    return transmittance(light_direction(photon.entry_m), refracted);
}

// One photon of the grid, at a place in the light's canonical screen space.
fn trace(
    settings: Trace, depth: texture_depth_2d, texels: sampler, mask: texture_2d<f32>, ndc: vec2<f32>
) -> Photon {
    let ray = light_ray(ndc);
    let met = meet_water(ray);
    let entry = met.position_m;
    if !water::inside(entry.xz) || (settings.masked != 0u && !in_mask(mask, ndc)) {
        return Photon(entry, MISSED, entry, 0.0);
    }
    let refracted = refract(ray.direction, met.normal, 1.0 / frame.refractive_index);
    return follow(settings, depth, texels, entry, refracted);
}

// From the water's surface along the refracted direction.
fn follow(
    settings: Trace, depth: texture_depth_2d, texels: sampler, entry: vec3<f32>, refracted: vec3<f32>
) -> Photon {
    var d = settings.start_m;
    var residual = 0.0;
    for (var i = 0u; i < settings.iterations; i++) {
        let estimate = entry + d * refracted;
        let seen = seen_from_light(depth, texels, estimate);
        if seen.w == 0.0 {
            return Photon(entry, OUTSIDE, estimate, d);
        }
        residual = distance(estimate, seen.xyz);
        d = distance(entry, seen.xyz);
    }
    return Photon(entry, residual, entry + d * refracted, d);
}

// Two repeatable numbers in [0, 1) for a photon of the grid, of 16 bits each.
fn strewn(photon: vec2<u32>) -> vec2<f32> {
    let bits = pcg(pcg(photon.x) + photon.y);
    return vec2(f32(bits >> 16u), f32(bits & 0xffffu)) / 65536.0;
}

// Canonical place of sub-photon `sub` of cell `cell`.
fn place(settings: Trace, cell: vec2<u32>, sub: vec2<u32>, side: u32) -> vec2<f32> {
    let photon = cell * side + sub;
    var share = settings.offset;
    if settings.jitter > 0.0 {
        // What leaves the share on one side comes in on the other.
        share = fract(share + settings.jitter * (strewn(photon) - 0.5));
    }
    let index = vec2<f32>(photon) + share;
    return index / f32(settings.grid * side) * 2.0 - 1.0;
}
