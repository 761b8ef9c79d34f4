// Photons from the light to the water, and what they carry into it: UW §3.3. Where they land: fathom::estimator.
#define_import_path fathom::photon

#import fathom::frame::{frame}
#import fathom::water

struct Photon {
    entry_m: vec3<f32>,
    // Distance between where it lands and what the light sees there; −1: never enters the water; −2: left the light frustum or meets nothing;
    // −3: still between mirrors or glass after the most bounces.
    residual_m: f32,
    hit_m: vec3<f32>,
    // From entry to hit.
    distance_m: f32,
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
