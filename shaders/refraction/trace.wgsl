// defs: ENDS=0, TEST=1, WATER=0
// Lines of sight through glass, refracted several times: SPT §4.
//
// Defs: ENDS 1 takes the ends of rays that `rays/*` have found, as in the paper. ENDS 0 walks each ray pixel by pixel: the surfaces of all
// layers are planes, each by itself, and of those that it passes it takes the nearest, since solids that are not convex are not met in the
// order of the layers. It is exact but where a ray leaves through a face that no pixel's middle shows, or where faces meet whose texels show
// others: with solids 30 pixels wide up to 1 % of the exits, none of index 1.
#import fathom::uniforms::{frame, world_at}
#import fathom::layers::{NO_SURFACE, surface_at, surface_near}
#import fathom::optics
#import fathom::photon::{Photon, has_landed}
#import fathom::refraction::{Exit, NO_EXIT}
#import fathom::screen_ray::{Segment, Walk, distance_at, to_pixel, segment, smoothed, texel_at}
#import fathom::surface_texel::{Surface}
#import fathom::transfer::{FIRST, NO_HIT, Transfer}

struct Trace {
    // Surfaces that refract a ray.
    refractions: u32,
    // ENDS 1: the rectangle of pixels that have lines.
    first: vec2<u32>,
    count: vec2<u32>,
}

@group(1) @binding(0) var<uniform> walk: Walk;
@group(1) @binding(1) var<uniform> settings: Trace;
@group(1) @binding(2) var depths: texture_2d_array<f32>;
@group(1) @binding(3) var surfaces: texture_2d_array<u32>;
#if ENDS == 1
@group(1) @binding(4) var<storage, read> ends: array<Photon>;
#endif

// Where a ray ends that has started on a surface.
struct End {
    // NO_HIT where it ends nowhere.
    at_m: f32,
    surface: Surface,
    // What the texel of the surface shows in its middle.
    position_m: vec3<f32>,
}

const NOWHERE: End = End(NO_HIT, NO_SURFACE, vec3<f32>(0.0));

#if ENDS == 1
// "The normal at this point is fetched from the depth image."
fn end_of(ray: Transfer, inside: bool, pixel: vec2<u32>) -> End {
    let at = pixel - settings.first;
    let end = ends[at.x + at.y * settings.count.x];
    if !has_landed(end) {
        return NOWHERE;
    }
    let clip = frame.camera_view_projection * vec4(end.hit_m, 1.0);
    let surface = surface_near(depths, surfaces, walk.layers, texel_at(walk, to_pixel(walk, clip)), clip.w);
    return End(end.distance_m, surface, vec3(0.0));
}
#else
// Where a ray passes the plane of a layer; nowhere where it cannot, from within glass or from outside.
fn passes(ray: Transfer, inside: bool, texel: vec2<i32>, layer: u32) -> End {
    let surface = surface_at(surfaces, texel, layer);
    let position_m = world_at((vec2<f32>(texel) + 0.5) / walk.size_px, textureLoad(depths, texel, layer, 0).x);
    let rate = dot(ray.direction, surface.geometric_normal);
    let at_m = (surface.plane_m - dot(ray.position_m - frame.camera_position_m, surface.geometric_normal)) / rate;
    return End(select(NO_HIT, at_m, rate != 0.0 && (rate > 0.0) == inside), surface, position_m);
}

// A ray against all layers of a texel.
struct Column {
    // What it passes first behind a distance, and last before its middle.
    next: End,
    last: End,
    // Whether it is in glass in its middle.
    inside: bool,
}

fn column(ray: Transfer, inside: bool, texel: vec2<i32>, from_m: f32, middle_m: f32) -> Column {
    var found = Column(NOWHERE, End(-NO_HIT, NO_SURFACE, vec3(0.0)), false);
    let middle = ray.position_m + middle_m * ray.direction;
    var solids = 0;
    for (var layer = 0u; layer < walk.layers && textureLoad(depths, texel, layer, 0).x < 1.0; layer++) {
        let end = passes(ray, inside, texel, layer);
        let normal = end.surface.geometric_normal;
        let is_back = dot(normal, end.position_m - frame.camera_position_m) > 0.0;
        // The camera is in glass.
        solids += select(0, 1, layer == 0u && is_back);
        let is_behind = (dot(middle - frame.camera_position_m, normal) > end.surface.plane_m) == is_back;
        solids += select(0, select(1, -1, is_back), is_behind);
        if end.at_m >= from_m && end.at_m < found.next.at_m {
            found.next = end;
        }
        if end.at_m <= middle_m && end.at_m > found.last.at_m {
            found.last = end;
        }
    }
    found.inside = solids > 0;
    return found;
}

// The texel that a step shows decides, so that a ray at an edge may pass a surface that another texel shows.
fn roughly(ray: Transfer, inside: bool) -> End {
    let seg = segment(walk, ray);
    let start = to_pixel(walk, seg.near);
    let end = to_pixel(walk, seg.far);
    var before = NOWHERE;
    var before_m = 0.0;
    for (var number = 0.0; number < seg.steps; number += 1.0) {
        let middle = (number + 0.5) / seg.steps;
        let middle_m = distance_at(seg, middle);
        let to_m = distance_at(seg, (number + 1.0) / seg.steps);
        let here = column(ray, inside, texel_at(walk, mix(start, end, middle)), distance_at(seg, number / seg.steps), middle_m);
        if here.next.at_m <= to_m {
            return here.next;
        }
        // It has passed a surface unseen, between two texels.
        if here.inside != inside && number > 0.0 {
            if here.last.at_m >= before_m {
                return here.last;
            }
            before.at_m = clamp(before.at_m, before_m, to_m);
            return before;
        }
        before = here.next;
        before_m = middle_m;
    }
    return before;
}

fn px_at(position_m: vec3<f32>) -> vec2<f32> {
    return to_pixel(walk, frame.camera_view_projection * vec4(position_m, 1.0));
}

// Texels around a place along each axis.
const AROUND: u32 = 2u;
// A plane is exact this near to its texel's middle, in pixels.
const EXACT_PX: f32 = 0.01;

// Of the surfaces around an end that meet there, the one that the ray passes: where they form a ridge the first, where a groove the last,
// and the other way round from outside.
fn end_of(ray: Transfer, inside: bool, pixel: vec2<u32>) -> End {
    var best = roughly(ray, inside);
    let end_px = px_at(ray.position_m + best.at_m * ray.direction);
    if best.at_m >= NO_HIT || distance(end_px, px_at(best.position_m)) < EXACT_PX {
        return best;
    }
    let corner = floor(end_px - 0.5);
    for (var i = 0u; i < AROUND * AROUND; i++) {
        let texel = texel_at(walk, corner + vec2(f32(i % AROUND), f32(i / AROUND)));
        for (var layer = 0u; layer < walk.layers && textureLoad(depths, texel, layer, 0).x < 1.0; layer++) {
            let other = passes(ray, inside, texel, layer);
            if other.at_m < 0.0 || other.at_m >= NO_HIT {
                continue;
            }
            let beyond = dot(other.position_m - best.position_m, best.surface.geometric_normal);
            let back = dot(best.position_m - other.position_m, other.surface.geometric_normal);
            if beyond * back > 0.0 && (other.at_m < best.at_m) == ((beyond < 0.0) == inside) {
                best = other;
            }
        }
    }
    return best;
}
#endif

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> Exit {
    let texel = vec2<i32>(pixel.xy);
    let z = textureLoad(depths, texel, 0, 0).x;
    if z >= 1.0 {
        return NO_EXIT;
    }
    var surface = surface_at(surfaces, texel, 0u);
    let position_m = world_at(pixel.xy / walk.size_px, z);
    let entry_m = distance(position_m, frame.camera_position_m);
    var ray = Transfer(position_m, FIRST, normalize(position_m - frame.camera_position_m), 0.0);
    // The camera is in glass where the first surface shows its inner side.
    var inside = dot(ray.direction, surface.geometric_normal) > 0.0;
    for (var number = 0u; number < settings.refractions; number++) {
        if number > 0u {
            let end = end_of(ray, inside, vec2<u32>(texel));
            if end.at_m >= NO_HIT {
                break;
            }
            ray.position_m += end.at_m * ray.direction;
            surface = end.surface;
#if ENDS == 0
            surface.shading_normal = smoothed(walk, depths, surfaces, ray.position_m, surface);
#endif
        }
        let index = optics::refractive_index(surface.optics);
        let normal = surface.shading_normal;
        let before = ray.direction;
        ray.direction = optics::refracted(before, normal, select(1.0 / index, index, inside));
        let passed = dot(before, normal) * dot(ray.direction, normal) > 0.0;
        inside = inside != passed;
    }
    return Exit(vec4(ray.position_m, entry_m), vec4(ray.direction, select(0.0, 1.0, inside)));
}
