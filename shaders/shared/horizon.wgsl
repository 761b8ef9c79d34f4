// Slices of the hemisphere over a point that the camera sees: half-planes through the point that hold the eye and one direction of the
// picture. What stages that search horizons in the depth buffer share.
//
// A slice is seen as a line. Directions in it are angles θ from the one to the eye, dω = sin θ dθ dψ, and their cosine with the normal is
// toward · cos θ + aside · sin θ.
//
// Defs: HARD 1: ρ = 1; 0: ρ = 1 − d / r_max. COUNT 1 counts samples of depth.
#define_import_path fathom::horizon

#import fathom::uniforms::{frame, view_depth_m}
#import fathom::screen

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

// The surface that a texel shows; 1 is the far plane's depth.
fn shaded_point(texel: vec2<i32>, z: f32) -> Point {
    sight = sight_of_camera();
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

// What a sample of depth shows.
struct Seen {
    // From the shaded point.
    v: vec3<f32>,
    distance_m: f32,
    // Neither background nor out of reach.
    counts: bool,
}

// Sample `k` of so many along a slice. Their spacing grows with the distance, as near occluders weigh most: with HSAO errors fall by 5 to
// 10 % against even spacing on scenes bunny_dry and sponza.
fn sample_along(point: Point, slice: Slice, k: f32, steps: u32, r_max_m: f32) -> Seen {
    let start = vec2<f32>(point.texel) + 0.5;
    let last = vec2<i32>(view_px()) - 1;
    let share = k / f32(steps);
    let position_px = start + slice.line * (1.0 + share * share * (slice.length_px - 1.0));
    let texel = clamp(vec2<i32>(position_px), vec2(0), last);
    let z = sample_depth(texel);
    let v = surface_at(texel, z) - point.position_m;
    let distance_m = length(v);
    return Seen(v, distance_m, z < 1.0 && distance_m <= r_max_m);
}

// cos θ of the tangent plane: what lies below is behind the surface.
fn tangent_cosine(slice: Slice) -> f32 {
    return -slice.aside / length(vec2(slice.toward, slice.aside));
}

fn slice_along(point: Point, direction: vec3<f32>, r_max_m: f32) -> Slice {
    let across = cross(point.to_eye, direction);
    let off = dot(point.normal, across);
    let clip = frame.camera_view_projection * vec4(direction, 0.0);
    // The sphere of radius r_max is seen to end where a line from the eye touches it.
    let sine = min(r_max_m / point.eye_m, MAX_REACH);
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
