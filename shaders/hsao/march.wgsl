// Horizon-split ambient occlusion: Dimitrov, Bavoil and Sainz, I3D 2008; distance attenuation as in Bavoil and Sainz, ShaderX7,
// 2009; rejection of samples of other layers, VAO §6.
// defs: HARD=0, COUNT=0, COUNTERS=1
//
// A slice is the half-plane through the shaded point that holds the eye and one direction of the picture; it is seen as a
// line. Directions in it are angles θ from the one to the eye, dω = sin θ dθ dψ, and their cosine with the normal is
// toward · cos θ + aside · sin θ. VAO Eq. 1 is A = 1/π ∫∫ ρ cos dω, cut at the horizon: what lies below is integrated in
// closed form (part 1), what lies above is sampled with rays (part 2).
#import fathom::uniforms::{frame, view_depth_m}
#if COUNT == 1
#import fathom::counters::{count}
#endif
#import fathom::math::{TAU}
#import fathom::random::{GOLDEN, pcg, unit}
#import fathom::screen
#import fathom::sphere::{PLASTIC, tangent_frame}

struct March {
    // Pixels of the occlusion buffer.
    size_px: vec2<f32>,
    r_max_m: f32,
    // Difference of depth beyond which samples belong to another layer of surfaces.
    layer_m: f32,
    directions: u32,
    // Samples of depth along each direction.
    steps: u32,
    // Above the horizon, shared among the directions.
    rays: u32,
    ray_steps: u32,
    // Draws other numbers at every pixel; 0 leaves them as they are.
    seed: u32,
}

@group(1) @binding(0) var<storage, read> settings: March;
@group(1) @binding(1) var depth: texture_depth_2d;
@group(1) @binding(2) var normals: texture_2d<f32>;
#if COUNT == 1
var<private> taken: u32 = 0u;
#endif

// Fraction of the golden ratio: a sequence of low discrepancy (Roberts 2018).
const GOLDEN_FRACTION: f32 = 0.61803398875;
// Smallest cosine between the normal and the direction to the eye: interpolated normals may point away.
const MIN_FACING: f32 = 0.02;
// The search spans at most this sine of the angle at the eye.
const MAX_REACH: f32 = 0.95;
// Along a slice points lie at least this share of their distance beside it: the centres of near texels may lie aside.
const MIN_ALONG: f32 = 0.1;
// Ends of searches stay this far from the camera's plane, share of the point's view depth.
const MIN_W: f32 = 0.1;

struct Point {
    texel: vec2<i32>,
    position_m: vec3<f32>,
    normal: vec3<f32>,
    to_eye: vec3<f32>,
    eye_m: f32,
    clip: vec4<f32>,
    // Clip-space vector of to_eye.
    eye_clip: vec4<f32>,
}

struct Slice {
    direction: vec3<f32>,
    // Clip-space vector of the direction.
    clip: vec4<f32>,
    across: vec3<f32>,
    // Brings points beside the slice into it, parallel to the tangent plane.
    into: vec3<f32>,
    toward: f32,
    aside: f32,
    // The slice's line in the picture: unit vector and length, pixels.
    line: vec2<f32>,
    length_px: f32,
}

struct Horizon {
    // ∫ ρ cos dω / dψ below the horizon.
    occluded: f32,
    // cos θ of the horizon.
    cosine: f32,
}

fn view_px() -> vec2<f32> {
    return vec2<f32>(textureDimensions(depth));
}

fn sample_depth(texel: vec2<i32>) -> f32 {
#if COUNT == 1
    taken++;
#endif
    return textureLoad(depth, texel, 0);
}

// What is seen through the middle of a texel lies at corner + right · x + down · y, times its view depth, from the camera. One division
// and two products of vectors then give its place, where the inverse of the camera's matrix takes 16 products and three divisions.
struct Sight {
    corner: vec3<f32>,
    right: vec3<f32>,
    down: vec3<f32>,
}

var<private> sight: Sight;

// From the rows of the camera's matrix: right and up times the focal distances, and the direction of view.
fn sight_of_camera() -> Sight {
    let rows = transpose(frame.camera_view_projection);
    let right = rows[0].xyz / dot(rows[0].xyz, rows[0].xyz);
    let up = rows[1].xyz / dot(rows[1].xyz, rows[1].xyz);
    let texel = 2.0 / view_px();
    let first = vec2(0.5 * texel.x - 1.0, 1.0 - 0.5 * texel.y);
    return Sight(rows[3].xyz + first.x * right + first.y * up, texel.x * right, -texel.y * up);
}

// The surface in the middle of a texel.
fn surface_at(texel: vec2<i32>, z: f32) -> vec3<f32> {
    let ray = sight.corner + f32(texel.x) * sight.right + f32(texel.y) * sight.down;
    return frame.camera_position_m + view_depth_m(z) * ray;
}

fn pixel_at(clip: vec4<f32>) -> vec2<f32> {
    return screen::to_pixels(clip.xy / clip.w, view_px());
}

// ρ at a distance of `share` × r_max. VAO Eq. 1.
fn attenuation(share: f32) -> f32 {
#if HARD == 1
    return 1.0;
#else
    return 1.0 - share;
#endif
}

fn shaded_point(texel: vec2<i32>, z: f32) -> Point {
    let position = surface_at(texel, z);
    let away = frame.camera_position_m - position;
    let eye_m = length(away);
    let to_eye = away / eye_m;
    let stored = normalize(textureLoad(normals, texel, 0).xyz);
    let lift = max(MIN_FACING - dot(stored, to_eye), 0.0);
    let clip = frame.camera_view_projection * vec4(position, 1.0);
    let eye_clip = frame.camera_view_projection * vec4(to_eye, 0.0);
    return Point(texel, position, normalize(stored + lift * to_eye), to_eye, eye_m, clip, eye_clip);
}

fn slice_along(point: Point, direction: vec3<f32>) -> Slice {
    let across = cross(point.to_eye, direction);
    let off = dot(point.normal, across);
    let clip = frame.camera_view_projection * vec4(direction, 0.0);
    // The sphere of radius r_max is seen to end where a line from the eye touches it.
    let sine = min(settings.r_max_m / point.eye_m, MAX_REACH);
    let rim = (sine * point.eye_clip + sqrt(1.0 - sine * sine) * clip) * sine * point.eye_m;
    let min_change = (MIN_W - 1.0) * point.clip.w;
    let shorten = select(1.0, min_change / rim.w, rim.w < min_change);
    let start = vec2<f32>(point.texel) + 0.5;
    let delta = pixel_at(point.clip + shorten * rim) - start;
    let room = select(start, view_px() - start, delta > vec2(0.0)) / max(abs(delta), vec2(1e-6));
    let length_px = length(delta);
    return Slice(
        direction, clip, across,
        (across - off * point.normal) / max(1.0 - off * off, 1e-4),
        dot(point.normal, point.to_eye), dot(point.normal, direction),
        delta / max(length_px, 1e-6), length_px * min(1.0, min(room.x, room.y)));
}

// ∫ of (toward · cos θ + aside · sin θ) sin θ from 0 to θ, given cos θ.
fn integral(slice: Slice, cosine: f32) -> f32 {
    let c = clamp(cosine, -1.0, 1.0);
    let square = 1.0 - c * c;
    return 0.5 * (slice.toward * square + slice.aside * (acos(c) - c * sqrt(square)));
}

// cos θ of a surface point at `v` from the shaded one, brought into the slice parallel to the tangent plane: points of that
// plane then lie on the slice's own tangent, and a plane does not occlude itself. −1, below any horizon, for points that lie
// beside the slice rather than along it.
fn cosine_of(point: Point, slice: Slice, v: vec3<f32>) -> f32 {
    let beside = dot(v, slice.across);
    let moved = v - slice.into * beside;
    if dot(moved, slice.direction) < MIN_ALONG * abs(beside) {
        return -1.0;
    }
    return dot(moved, point.to_eye) / max(length(moved), 1e-12);
}

// Part 1: samples of depth along the slice's line raise the horizon, each new stretch weighted by its sample's distance.
// Their spacing grows with the distance, as near occluders weigh most: on scenes bunny_dry and sponza, errors fall by 5 to
// 10 % against even spacing.
fn find_horizon(point: Point, slice: Slice, jitter: f32) -> Horizon {
    var horizon = Horizon(0.0, -slice.aside / length(vec2(slice.toward, slice.aside)));
    if slice.length_px <= 1.0 {
        return horizon;
    }
    var below = integral(slice, horizon.cosine);
    var height = 0.0;
    let start = vec2<f32>(point.texel) + 0.5;
    let last = vec2<i32>(view_px()) - 1;
    for (var k = 0u; k < settings.steps; k++) {
        let share = (f32(k) + jitter) / f32(settings.steps);
        let position_px = start + slice.line * (1.0 + share * share * (slice.length_px - 1.0));
        let texel = clamp(vec2<i32>(position_px), vec2(0), last);
        let z = sample_depth(texel);
        let v = surface_at(texel, z) - point.position_m;
        let distance_m = length(v);
        let rise = dot(v, point.to_eye);
        // Background, out of reach, or a layer nearer to the eye: VAO §6.
        if z >= 1.0 || distance_m > settings.r_max_m || rise - height > settings.layer_m {
            continue;
        }
        height = rise;
        let found = cosine_of(point, slice, v);
        if found > horizon.cosine {
            let now = integral(slice, found);
            horizon.occluded += attenuation(distance_m / settings.r_max_m) * (below - now);
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
        let slice = slice_along(point, basis[0] * cos(angle) + basis[1] * sin(angle));
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
    let texel = screen::texel_behind(pixel.xy, settings.size_px, view_px());
    let z = textureLoad(depth, texel, 0);
    if z >= 1.0 {
        return vec4(1.0);
    }
    let own = vec2<u32>(pixel.xy);
    sight = sight_of_camera();
    let occluded = occlusion(shaded_point(texel, z), pcg(own.x + 65536u * own.y + settings.seed * GOLDEN));
#if COUNT == 1
    let slot = own.x & 63u;
    count(0u, slot, taken);
    count(1u, slot, 1u);
#endif
    return vec4(1.0 - saturate(occluded));
}
