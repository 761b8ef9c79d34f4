// Photons from the light to the water, and what they carry into it: UW §3.3. Where they land: fathom::estimator.
#define_import_path fathom::photon

#import fathom::math::{perspective_divide}
#import fathom::screen::{to_pixels}
#import fathom::shading::{to_light}
#import fathom::uniforms::{frame}
#import fathom::water

struct Photon {
    entry_m: vec3<f32>,
    // A tag, one of those below, or of a photon that has landed `landed_fate`.
    fate: u32,
    hit_m: vec3<f32>,
    // From entry to hit.
    distance_m: f32,
}

// Fates of photons that have not landed: the upper bit tells them from a residual. The host reads them in src/stages/shared/photon.rs.
// It never enters the water.
const MISSED: u32 = 0x80000001u;
// It left the light's frustum, or meets nothing.
const OUTSIDE: u32 = 0x80000002u;
// It is still between mirrors or glass after its last bounce.
const STILL_BOUNCING: u32 = 0x80000003u;

// Fate of a photon that lands so far from what the light sees there: the bits of its residual.
fn landed_fate(residual_m: f32) -> u32 {
    return bitcast<u32>(residual_m);
}

fn has_landed(photon: Photon) -> bool {
    return photon.fate < MISSED;
}

// Maximum number of steps of safeguarded Newton. Host twin: src/stages/shared/entry.rs.
const REFINEMENTS: i32 = 8;
// A step less than this, relative to the distance along the ray, is the last: Newton's method squares the error, and 32-bit floats end there.
const LAST_STEP: f32 = 1e-6;
// Components of a direction below this count as this: what is divided by them stays finite.
const MIN_COMPONENT: f32 = 1e-9;

struct Ray {
    origin_m: vec3<f32>,
    direction: vec3<f32>,
}

// Ray of a photon at a place of the grid, from the light's near plane on.
fn photon_ray(ndc: vec2<f32>) -> Ray {
    let near = perspective_divide(frame.photon_grid * vec4(ndc, 0.0, 1.0));
    let far = perspective_divide(frame.photon_grid * vec4(ndc, 1.0, 1.0));
    return Ray(near, normalize(far - near));
}

struct Entry {
    position_m: vec3<f32>,
    normal: vec3<f32>,
    // Whether the ray enters the water's rectangle from above.
    entered: bool,
}

// Where the ray enters the water first. Steep rays meet the waves once, between the planes of crest and trough.
fn meet_water(ray: Ray) -> Entry {
    if length(ray.direction.xz) > frame.water_newton_slant * abs(ray.direction.y) {
        return first_entry(ray);
    }
    let rest = -ray.origin_m.y / ray.direction.y;
    let room = abs(frame.water_bound_m / ray.direction.y);
    var entry = refined(ray, rest - room, rest + room, rest);
    entry.entered = water::inside(entry.position_m.xz);
    return entry;
}

// A place on a ray: its height above the water, the change of that along the ray, and the water's slope.
struct Above {
    t: f32,
    height_m: f32,
    rate: f32,
    slope: vec2<f32>,
}

fn above_water(ray: Ray, t: f32) -> Above {
    let p = ray.origin_m + t * ray.direction;
    let h = water::surface(p.xz);
    return Above(t, p.y - h.x, ray.direction.y - dot(h.yz, ray.direction.xz), h.yz);
}

// Where a step of a search is looked at: at its end, or between its ends where both lie on one side of the water, the upper (1) or the lower
// (−1), and the ray comes nearest to the water, by the changes at its ends: waves are smooth within a step.
fn nearest_of_step(ray: Ray, before: Above, after: Above, side: f32) -> Above {
    if side * after.height_m > 0.0 && side * before.rate < 0.0 && side * after.rate > 0.0 {
        return above_water(ray, mix(before.t, after.t, before.rate / (before.rate - after.rate)));
    }
    return after;
}

// Where a ray meets the water between a point on this side of it and one on the other.
fn entry_between(ray: Ray, before: Above, behind: Above, side: f32) -> Entry {
    let t = mix(before.t, behind.t, before.height_m / (before.height_m - behind.height_m));
    let is_down = side > 0.0;
    return refined(ray, select(behind.t, before.t, is_down), select(before.t, behind.t, is_down), t);
}

// Linear search between the planes of crest and trough within the water's rectangle.
fn first_entry(ray: Ray) -> Entry {
    let tiny = abs(ray.direction) < vec3(MIN_COMPONENT);
    let direction = select(ray.direction, vec3(MIN_COMPONENT), tiny);
    let half_size = vec3(frame.water_half_size_m.x, frame.water_bound_m, frame.water_half_size_m.y);
    let to_center = vec3(frame.water_center_m.x, 0.0, frame.water_center_m.y) - ray.origin_m;
    let reach = abs(half_size / direction);
    let near = to_center / direction - reach;
    let far = to_center / direction + reach;
    let begin = max(max(near.x, near.y), max(near.z, 0.0));
    let length_m = min(min(far.x, far.y), far.z) - begin;
    let steps = clamp(ceil(length_m * length(direction.xz) / frame.water_step_m), 1.0, frame.water_steps);
    let within = Ray(ray.origin_m + begin * direction, direction);
    var before = above_water(within, 0.0);
    for (var i = 1.0; i <= steps && length_m > 0.0; i += 1.0) {
        let after = above_water(within, i / steps * length_m);
        let behind = nearest_of_step(within, before, after, 1.0);
        if before.height_m > 0.0 && behind.height_m <= 0.0 {
            return entry_between(within, before, behind, 1.0);
        }
        before = after;
    }
    return Entry(ray.origin_m + to_center.y / direction.y * direction, vec3(0.0, 1.0, 0.0), false);
}

// Newton's method between a place above the water and one below, in either order, which both close in; a step that leaves them is halved
// instead.
fn refined(ray: Ray, above_t: f32, below_t: f32, first_t: f32) -> Entry {
    var low = above_t;
    var high = below_t;
    var t = first_t;
    var slope = vec2(0.0);
    for (var i = 0; i < REFINEMENTS; i++) {
        let point = above_water(ray, t);
        slope = point.slope;
        if point.height_m > 0.0 {
            low = t;
        } else {
            high = t;
        }
        var next = 0.5 * (low + high);
        if abs(point.rate) > MIN_COMPONENT {
            let newton = t - point.height_m / point.rate;
            next = select(next, newton, newton >= min(low, high) && newton <= max(low, high));
        }
        let last = abs(next - t) <= LAST_STEP * abs(t);
        t = next;
        if last {
            break;
        }
    }
    return Entry(ray.origin_m + t * ray.direction, water::normal(slope), true);
}

// Whether the light that enters the water here comes past what stands above it. Nothing is known beyond the light's frustum.
fn in_mask(mask: texture_2d<f32>, entry_m: vec3<f32>) -> bool {
    let ndc = perspective_divide(frame.light_view_projection * vec4(entry_m, 1.0)).xy;
    let size = vec2<f32>(textureDimensions(mask));
    let texel = vec2<i32>(to_pixels(ndc, size));
    return all(abs(ndc) < vec2(1.0)) && textureLoad(mask, texel, 0).x > 0.5;
}

// A photon's share of the light's energy relative to the middle of the frustum. A grid that is even in screen space is not
// even in solid angle: dΩ = cos³θ dA at unit distance from a point light. A directional light's photons are all alike.
fn angular_weight(entry_m: vec3<f32>) -> f32 {
    if frame.light_is_point == 0u {
        return 1.0;
    }
    let cosine = dot(-to_light(entry_m), frame.light_forward);
    return cosine * cosine * cosine;
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
    return transmittance(-to_light(photon.entry_m), refracted);
}
