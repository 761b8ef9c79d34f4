// Photon rays in the camera's screen space against layered depths: Krüger, Bürger and Westermann (SPT) §2.
// Host twin: src/stages/shared/screen_ray.rs.
//
// A ray is cut to the scene's bounds and to the camera's frustum. What is left is walked in steps of a pixel, as a line would be
// rasterized. Each step is tested against all layers at its pixel.
//
// Defs: TEST 0 takes the paper's tolerance, TEST 1 asks whether the ray passes through a layer's tangent plane, TEST 2 takes the
// tolerance and asks in addition whether the ray is inside a closed object, between two consecutive layers: SPT §5. TEST 3 and 4 are of rays
// that have entered glass: SPT §4. TEST 3 compares them with the depths of two layers, in one texel, and TEST 4 with those of all layers.
#define_import_path fathom::screen_ray

#import fathom::host::{Transfer, WalkUniforms}
#import fathom::clip::{cut, cut_to_sides}
#import fathom::screen::{to_pixels}
#import fathom::uniforms::{frame, view_depth_m, world_at}
#import fathom::layers::{NO_SURFACE, surface_at, surface_near}
#import fathom::optics
#import fathom::surface_texel::{Surface}
#import fathom::transfer::{AGAIN, FIRST, INSIDE, NO_HIT, is_travelling}

// The part of a ray that is walked.
struct Segment {
    // Clip coordinates of its ends.
    near: vec4<f32>,
    far: vec4<f32>,
    // Distances of its ends along the ray.
    from_m: f32,
    to_m: f32,
    // 0 where nothing of the ray is in view.
    steps: f32,
}

// The plane of a triangle stands for its surface up to so many footprints of a pixel: at a slope of 83 degrees the surface within a pixel
// is as long. What is farther counts where the pixel beyond it shows the same plane: see `continues`. Without that, rays end in the air
// before silhouettes. Tuned on scenes tank, port and storage.
const MAX_FOOTPRINTS: f32 = 8.0;
// How far a step reaches beyond its pixel, in pixels: beside an edge the ray may pass one face while the pixel shows the other. Tuned on
// the same scenes.
const OVERLAP: f32 = 0.5;
// Rays are followed so much farther than the far plane, and surfaces this near to it may be cut away by rounding: within a pixel, a level
// floor reaches from before the far plane to far behind it.
const BEYOND_FAR: f32 = 1.1;
// Footprints within which a ray does not meet the plane that it starts on: corners are moved by up to 1/32 of a pixel.
const OWN_PLANE: f32 = 0.25;
// Cosine of the angle between two normals of one plane: 8 degrees.
const SAME_PLANE: f32 = 0.99;
const NOTHING: Segment = Segment(vec4<f32>(0.0), vec4<f32>(0.0), 0.0, 0.0, 0.0);

fn to_pixel(walk: WalkUniforms, clip: vec4<f32>) -> vec2<f32> {
    return to_pixels(clip.xy / clip.w, walk.size_px);
}

fn texel_at(walk: WalkUniforms, pixel: vec2<f32>) -> vec2<i32> {
    return vec2<i32>(clamp(floor(pixel), vec2(0.0), walk.size_px - 1.0));
}

// Distance at which a ray leaves the scene's box; 0 where it is outside and goes on.
fn leaves_m(walk: WalkUniforms, ray: Transfer) -> f32 {
    let still = abs(ray.direction) < vec3(1e-12);
    let bound = select(walk.low_m, walk.high_m, ray.direction > vec3(0.0));
    let exits = select((bound - ray.position_m) / ray.direction, vec3(NO_HIT), still);
    return max(min(exits.x, min(exits.y, exits.z)), 0.0);
}

fn segment(walk: WalkUniforms, ray: Transfer) -> Segment {
    let end_m = leaves_m(walk, ray);
    if !is_travelling(ray) || end_m <= walk.start_m {
        return NOTHING;
    }
    let a = frame.camera_view_projection * vec4(ray.position_m + walk.start_m * ray.direction, 1.0);
    let b = frame.camera_view_projection * vec4(ray.position_m + end_m * ray.direction, 1.0);
    let far_m = BEYOND_FAR * frame.z_far_m;
    let part = cut(cut_to_sides(a, b), far_m - a.w, far_m - b.w);
    if part.x >= part.y {
        return NOTHING;
    }
    let near = mix(a, b, part.x);
    let far = mix(a, b, part.y);
    let along = abs(to_pixel(walk, far) - to_pixel(walk, near));
    let steps = clamp(ceil(max(along.x, along.y)), f32(walk.min_steps), f32(walk.max_steps));
    return Segment(near, far, mix(walk.start_m, end_m, part.x), mix(walk.start_m, end_m, part.y), steps);
}

// How far along a segment in the world a place is that lies this far along it on the screen.
fn share_at(seg: Segment, on_screen: f32) -> f32 {
    let s = clamp(on_screen, 0.0, 1.0);
    let far = s * seg.near.w;
    return far / (far + (1.0 - s) * seg.far.w);
}

fn distance_at(seg: Segment, on_screen: f32) -> f32 {
    return mix(seg.from_m, seg.to_m, share_at(seg, on_screen));
}

// How far along a segment on the screen a place is that lies this far along its ray.
fn screen_at(seg: Segment, at_m: f32) -> f32 {
    let share = clamp((at_m - seg.from_m) / (seg.to_m - seg.from_m), 0.0, 1.0);
    let far = share * seg.far.w;
    return far / (far + (1.0 - share) * seg.near.w);
}

// A pixel's height at a depth.
fn footprint_at(walk: WalkUniforms, view_m: f32) -> f32 {
    let row = vec3(frame.camera_view_projection[0].y, frame.camera_view_projection[1].y, frame.camera_view_projection[2].y);
    return 2.0 * view_m / (length(row) * walk.size_px.y);
}

// Whether a ray can hit a surface at a distance. Normals of glass point out of it. Other surfaces are hit from both sides, but for
// the one that a ray has left: about the start a curved mirror is crossed from behind, and a sheet is in its own plane.
fn can_hit(ray: Transfer, surface: Surface, at_m: f32, footprint_m: f32) -> bool {
    if ray.state == FIRST {
        return true;
    }
    let from_outside = dot(ray.direction, surface.geometric_normal) < 0.0;
    if optics::is_glass(surface.optics) {
        return from_outside == (ray.state != INSIDE);
    }
    return at_m > select(MAX_FOOTPRINTS, OWN_PLANE, from_outside) * footprint_m;
}

struct Hit {
    // Distance along the ray, or NO_HIT.
    at_m: f32,
    surface: Surface,
}

const NONE_HIT: Hit = Hit(NO_HIT, NO_SURFACE);

// Whether a plane is among the layers at a texel.
struct PlaneInLayers {
    is_shown: bool,
    // It may be there unseen: before the near plane, about or behind the far plane, or behind the last layer.
    may_be_hidden: bool,
}

fn find_plane(
    walk: WalkUniforms, depths: texture_2d_array<f32>, surfaces: texture_2d_array<u32>, pixel: vec2<f32>, on_plane_m: vec3<f32>,
    normal: vec3<f32>, footprint_m: f32
) -> PlaneInLayers {
    let texel = texel_at(walk, pixel);
    let uv = (vec2<f32>(texel) + 0.5) / walk.size_px;
    let to_far = world_at(uv, 1.0) - frame.camera_position_m;
    let from_camera_m = on_plane_m - frame.camera_position_m;
    let expected_m = frame.z_far_m * dot(from_camera_m, normal) / dot(to_far, normal);
    var last_m = 0.0;
    for (var layer = 0u; layer < walk.layers; layer++) {
        let z = textureLoad(depths, texel, layer, 0).x;
        if z >= 1.0 {
            last_m = frame.z_far_m / BEYOND_FAR;
            break;
        }
        last_m = view_depth_m(z);
        let surface = surface_at(surfaces, texel, layer);
        let off_m = dot(from_camera_m, surface.geometric_normal) - surface.plane_m;
        if dot(surface.geometric_normal, normal) > SAME_PLANE && abs(off_m) < footprint_m {
            return PlaneInLayers(true, false);
        }
    }
    return PlaneInLayers(false, expected_m < frame.z_near_m || expected_m > last_m);
}

// Whether the plane that a texel shows goes on to a place on it, some pixels away: the next pixel beyond the place shows it too, or where
// it may be hidden there, the one on the other side.
fn continues(
    walk: WalkUniforms, depths: texture_2d_array<f32>, surfaces: texture_2d_array<u32>, texel: vec2<i32>, on_plane_m: vec3<f32>,
    normal: vec3<f32>, footprint_m: f32
) -> bool {
    let middle = vec2<f32>(texel) + 0.5;
    let aside = to_pixel(walk, frame.camera_view_projection * vec4(on_plane_m, 1.0)) - middle;
    let pixel = aside / max(abs(aside.x), abs(aside.y));
    let twice = max(abs(aside.x), abs(aside.y)) > 0.5;
    let beyond = find_plane(walk, depths, surfaces, middle + select(pixel, 2.0 * aside, twice), on_plane_m, normal, footprint_m);
    if !beyond.may_be_hidden {
        return beyond.is_shown;
    }
    let before = find_plane(walk, depths, surfaces, middle - pixel, on_plane_m, normal, footprint_m);
    return before.is_shown || before.may_be_hidden;
}

#if TEST > 2
// Whether a place is in glass.
fn is_inside(walk: WalkUniforms, depths: texture_2d_array<f32>, texel: vec2<i32>, view_m: f32) -> bool {
#if TEST == 3
    let pair = textureLoad(depths, texel, 0, 0).xy;
    return view_m >= view_depth_m(pair.x) && view_m <= view_depth_m(pair.y);
#else
    var before = 0u;
    for (var layer = 0u; layer < walk.layers; layer++) {
        before += select(0u, 1u, view_depth_m(textureLoad(depths, texel, layer, 0).x) < view_m);
    }
    return (before & 1u) == 1u;
#endif
}
#endif

// The pixel at a share of a segment on the screen.
fn pixel_on(walk: WalkUniforms, seg: Segment, on_screen: f32) -> vec2<f32> {
    let start = to_pixel(walk, seg.near);
    let path = to_pixel(walk, seg.far) - start;
    return start + on_screen * path;
}

// The surface that step `number` hits.
#if TEST > 2
fn hit(
    walk: WalkUniforms, depths: texture_2d_array<f32>, surfaces: texture_2d_array<u32>, ray: Transfer, seg: Segment, number: f32
) -> Hit {
    let middle = (number + 0.5) / seg.steps;
    let texel = texel_at(walk, pixel_on(walk, seg, middle));
    // "The point in the interior of the object is considered the exit point": that of the step before.
    if number == 0.0 || is_inside(walk, depths, texel, mix(seg.near.w, seg.far.w, share_at(seg, middle))) {
        return NONE_HIT;
    }
    return Hit(distance_at(seg, (number - 0.5) / seg.steps), NO_SURFACE);
}
#else if TEST == 1
fn hit(
    walk: WalkUniforms, depths: texture_2d_array<f32>, surfaces: texture_2d_array<u32>, ray: Transfer, seg: Segment, number: f32
) -> Hit {
    let pixel = pixel_on(walk, seg, (number + 0.5) / seg.steps);
    let from_m = distance_at(seg, (number - OVERLAP) / seg.steps);
    let to_m = distance_at(seg, (number + 1.0 + OVERLAP) / seg.steps);
    var shown = texel_at(walk, pixel);
    // A plane that leaves the view within a pixel that shows nothing may show in one of the other three about the place.
    let is_empty = textureLoad(depths, shown, 0, 0).x >= 1.0;
    for (var i = 0u; i < 4u && is_empty; i++) {
        let other = texel_at(walk, pixel - 0.5 + vec2(f32(i & 1u), f32(i >> 1u)));
        shown = select(shown, other, textureLoad(depths, other, 0, 0).x < 1.0);
    }
    let uv = (vec2<f32>(shown) + 0.5) / walk.size_px;
    var first = NONE_HIT;
    for (var layer = 0u; layer < walk.layers; layer++) {
        let z = textureLoad(depths, shown, layer, 0).x;
        if z >= 1.0 {
            break;
        }
        let surface_m = world_at(uv, z);
        let surface = surface_at(surfaces, shown, layer);
        let normal = surface.geometric_normal;
        let start_m = dot(ray.position_m - frame.camera_position_m, normal) - surface.plane_m;
        let rise = dot(ray.direction, normal);
        let before = start_m + from_m * rise;
        let behind = start_m + to_m * rise;
        if before * behind > 0.0 || before == behind {
            continue;
        }
        let at_m = mix(from_m, to_m, before / (before - behind));
        let footprint_m = footprint_at(walk, view_depth_m(z));
        if at_m >= first.at_m || !can_hit(ray, surface, at_m, footprint_m) {
            continue;
        }
        let hit_m = ray.position_m + at_m * ray.direction;
        let is_near = distance(hit_m, surface_m) <= MAX_FOOTPRINTS * footprint_m && !is_empty;
        if is_near || continues(walk, depths, surfaces, shown, hit_m, normal, footprint_m) {
            first = Hit(at_m, surface);
        }
    }
    return first;
}
#else
fn hit(
    walk: WalkUniforms, depths: texture_2d_array<f32>, surfaces: texture_2d_array<u32>, ray: Transfer, seg: Segment, number: f32
) -> Hit {
    let middle = (number + 0.5) / seg.steps;
    let texel = texel_at(walk, pixel_on(walk, seg, middle));
    let share = share_at(seg, middle);
    let at_m = mix(seg.from_m, seg.to_m, share);
    let view_m = mix(seg.near.w, seg.far.w, share);
    // Metres along the pixel's line of sight for each metre of view depth.
    let stretch = distance(ray.position_m + at_m * ray.direction, frame.camera_position_m) / view_m;
    var before_m = 0.0;
    for (var layer = 0u; layer < walk.layers; layer++) {
        let z = textureLoad(depths, texel, layer, 0).x;
        if z >= 1.0 {
            break;
        }
        let layer_m = view_depth_m(z);
#if TEST == 2
        if (layer & 1u) == 1u && before_m < view_m && view_m < layer_m {
            return Hit(at_m, surface_at(surfaces, texel, layer));
        }
        before_m = layer_m;
#endif
        if abs(layer_m - view_m) * stretch <= walk.tolerance_m {
            let surface = surface_at(surfaces, texel, layer);
            if can_hit(ray, surface, at_m, footprint_at(walk, view_m)) {
                return Hit(at_m, surface);
            }
        }
    }
    return NONE_HIT;
}
#endif

// The surface on which a ray has ended at a distance: of the steps that reach so far, the one that hits nearest to it. A pixel that
// shows the place may show another surface there, beside a silhouette.
fn surface_hit(
    walk: WalkUniforms, depths: texture_2d_array<f32>, surfaces: texture_2d_array<u32>, ray: Transfer, at_m: f32
) -> Surface {
    let seg = segment(walk, ray);
    let middle = floor(screen_at(seg, at_m) * seg.steps);
    var off_m = NO_HIT;
    var surface = NO_SURFACE;
    for (var number = max(middle - 1.0, 0.0); number < min(middle + 2.0, seg.steps); number += 1.0) {
        let found = hit(walk, depths, surfaces, ray, seg, number);
        if abs(found.at_m - at_m) < off_m {
            off_m = abs(found.at_m - at_m);
            surface = found.surface;
        }
    }
    return surface;
}

// Pixels around a place show its surface where their normals are within 60 degrees of its.
const ALIKE: f32 = 0.5;
// Cosine of the angle between a face's plane and its vertices' normals from which on the face is flat: its neighbours are other faces.
const FLAT: f32 = 1.0 - 1e-6;

fn is_flat(surface: Surface) -> bool {
    return dot(surface.shading_normal, surface.geometric_normal) > FLAT;
}

// Smallest determinant of two directions, over the product of their squared lengths, with which a place is resolved along both.
const MIN_DETERMINANT: f32 = 1e-3;

// Shading normal at a place of a surface, interpolated between those of the four pixels around it that show the surface; three give the
// fourth. On a curved surface the mean of their places is not the place, above all where it is seen edge-on: the change of place and normal from
// pixel to pixel leads on from there.
fn smoothed(
    walk: WalkUniforms, depths: texture_2d_array<f32>, surfaces: texture_2d_array<u32>, place_m: vec3<f32>, surface: Surface
) -> vec3<f32> {
    if is_flat(surface) {
        return surface.shading_normal;
    }
    let clip = frame.camera_view_projection * vec4(place_m, 1.0);
    let texels = to_pixel(walk, clip) - 0.5;
    let corner = floor(texels);
    let share = texels - corner;
    // Of each a place from the camera, and a normal.
    var mean = mat2x3<f32>();
    var right = mat2x3<f32>();
    var down = mat2x3<f32>();
    var fourth = mat2x3<f32>();
    var missing = 0u;
    var count = 0u;
    for (var i = 0u; i < 5u && (i < 4u || count == 3u); i++) {
        let pixel = select(i, missing, i == 4u);
        let offset = vec2(f32(pixel & 1u), f32(pixel >> 1u));
        let odd = abs(offset.x - offset.y) * 2.0 - 1.0;
        let texel = vec2<i32>(clamp(corner + offset, vec2(0.0), walk.size_px - 1.0));
        let shown = surface_near(depths, surfaces, walk.layers, texel, clip.w);
        let weight = mix(1.0 - share, share, offset);
        let is_alike = dot(shown.shading_normal, surface.shading_normal) > ALIKE && !is_flat(shown);
        var seen = -odd * fourth;
        if i < 4u {
            if shown.optics != surface.optics || !is_alike {
                missing = i;
                continue;
            }
            let sight = world_at((vec2<f32>(texel) + 0.5) / walk.size_px, 1.0) - frame.camera_position_m;
            seen = mat2x3(sight * (shown.plane_m / dot(sight, shown.geometric_normal)), shown.shading_normal);
        }
        mean += weight.x * weight.y * seen;
        right += (offset.x - 0.5) * seen;
        down += (offset.y - 0.5) * seen;
        fourth += odd * seen;
        count++;
    }
    let off_m = place_m - frame.camera_position_m - mean[0];
    let squares = vec2(dot(right[0], right[0]), dot(down[0], down[0]));
    let both = dot(right[0], down[0]);
    let det = squares.x * squares.y - both * both;
    if count < 4u || det <= MIN_DETERMINANT * squares.x * squares.y {
        return normalize(select(surface.shading_normal, mean[1], dot(mean[1], mean[1]) > 0.0));
    }
    let along = vec2(dot(right[0], off_m), dot(down[0], off_m));
    let pixels = (squares.yx * along - both * along.yx) / det;
    return normalize(mean[1] + pixels.x * right[1] + pixels.y * down[1]);
}
