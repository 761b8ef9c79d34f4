// Where photons under water land: the refracted ray against the light's depth map, UW §3.3.
#define_import_path fathom::estimator

#import fathom::host::{Photon, TraceUniforms}
#import fathom::clip::{cut, cut_to_sides}
#import fathom::math::{perspective_divide}
#import fathom::uniforms::{frame}
#import fathom::photon::{MISSED, OUTSIDE, in_mask, landed_fate, meet_water, photon_ray}
#import fathom::random::{pcg}
#import fathom::screen::{to_pixels}
#import fathom::water

// Host twin: PhotonEstimator in src/stages/shared/photon.rs.
const PAPER: u32 = 1u;
// Crossings of a ray that are refined, however long its path; each before the last was a silhouette that the ray passes behind. The
// iterations of an invocation are bounded, as lavapipe ends it after 65,535: photons that share a cell with many others take longer steps.
const MIN_REFINED: u32 = 4u;
// Device depth from which on the light sees nothing: 1 but for the rounding of a difference.
const NOTHING: f32 = 0.9999998;
// Gap of device depth that counts as none: four steps of 32-bit floats near 1.
const NO_GAP: f32 = 2.4e-7;

fn inside_frustum(ndc: vec2<f32>) -> bool {
    return all(abs(ndc) <= vec2(1.0));
}

// Step of device depth from texel to texel that is an edge: more than on a level floor, whose depth changes in slanted light.
fn edge_step(settings: TraceUniforms, depth: texture_depth_2d) -> f32 {
    let m = frame.light_inverse;
    // A level plane in the light's canonical screen space: the coefficients of x, y and z.
    let plane = vec3(m[0].y, m[1].y, m[2].y) - settings.bottom_m * vec3(m[0].w, m[1].w, m[2].w);
    let texel = 2.0 / vec2<f32>(textureDimensions(depth));
    return frame.light_depth_jump + dot(abs(plane.xy), texel) / max(abs(plane.z), 1e-9);
}

// Device depth of what the light sees at a place of its screen; 1: nothing. Bilinear, which is exact on planes, and beyond the
// outermost texels' middles extrapolated; across a step of more than `edge` the nearest texel counts.
fn seen_depth(depth: texture_depth_2d, texels: sampler, edge: f32, ndc: vec2<f32>) -> f32 {
    let size = vec2<f32>(textureDimensions(depth));
    let texel = to_pixels(ndc, size) - 0.5;
    let base = clamp(floor(texel), vec2(0.0), max(size - 2.0, vec2(0.0)));
    let f = texel - base;
    // The corner where four texels meet: no rounding of the sampler's can choose others.
    let four = textureGather(depth, texels, (base + 1.0) / size);
    let a = four.w;
    let b = four.z;
    let c = four.x;
    let d = four.y;
    let max_z = max(max(a, b), max(c, d));
    if max_z - min(min(a, b), min(c, d)) > edge || max_z >= 1.0 {
        return select(select(a, b, f.x > 0.5), select(c, d, f.x > 0.5), f.y > 0.5);
    }
    return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}

fn unproject(ndc: vec3<f32>) -> vec3<f32> {
    return perspective_divide(frame.light_inverse * vec4(ndc, 1.0));
}

// The photon at a place of the grid, −1 … 1 along each side.
fn trace(
    settings: TraceUniforms, depth: texture_depth_2d, texels: sampler, mask: texture_2d<f32>, ndc: vec2<f32>
) -> Photon {
    let ray = photon_ray(ndc);
    let met = meet_water(ray);
    let entry = met.position_m;
    if !met.entered || (settings.masked != 0u && !in_mask(mask, entry)) {
        return Photon(entry, MISSED, entry, 0.0);
    }
    let refracted = refract(ray.direction, met.normal, 1.0 / frame.refractive_index);
    return follow(settings, depth, texels, entry, refracted);
}

// From the water's surface along the refracted direction.
fn follow(
    settings: TraceUniforms, depth: texture_depth_2d, texels: sampler, entry: vec3<f32>, refracted: vec3<f32>
) -> Photon {
    if settings.estimator == PAPER {
        return fixed_point(settings, depth, texels, entry, refracted);
    }
    return first_crossing(settings, depth, texels, entry, refracted);
}

// The iteration of Shah and Konttinen (UW reference [7]). An estimate beyond the light's frustum looks up what is seen at its border:
// only where the photon lands decides whether it is outside.
fn fixed_point(
    settings: TraceUniforms, depth: texture_depth_2d, texels: sampler, entry: vec3<f32>, refracted: vec3<f32>
) -> Photon {
    let edge = edge_step(settings, depth);
    var d = settings.start_m;
    var residual = 0.0;
    for (var i = 0u; i < settings.iterations; i++) {
        let estimate = entry + d * refracted;
        let ndc = perspective_divide(frame.light_view_projection * vec4(estimate, 1.0));
        let seen_ndc = clamp(ndc.xy, vec2(-1.0), vec2(1.0));
        let z = seen_depth(depth, texels, edge, seen_ndc);
        let last = i + 1u == settings.iterations;
        if z >= 1.0 || (last && !inside_frustum(ndc.xy)) {
            return Photon(entry, OUTSIDE, estimate, d);
        }
        let seen = unproject(vec3(seen_ndc, z));
        residual = distance(estimate, seen);
        d = distance(entry, seen);
    }
    return Photon(entry, landed_fate(residual), entry + d * refracted, d);
}

// A ray under water in the light's canonical screen space, where it is straight too, and planes are planes: from its entry, or
// where it comes into the light's frustum, to where it leaves the frustum or is below the scene.
struct Path {
    entry_m: vec3<f32>,
    direction: vec3<f32>,
    begin: vec3<f32>,
    end: vec3<f32>,
    // Homogeneous w of both.
    w: vec2<f32>,
    // Distances of both from the entry; the second is less than the first where the ray lies outside.
    distance_m: vec2<f32>,
    // Whether its end is below the scene, and within the frustum.
    to_bottom: bool,
    edge: f32,
}

// A point of a path: the share of it, and by how much of device depth it lies behind what the light sees there.
struct PathPoint {
    share: f32,
    gap: f32,
}

// Smallest fall of a ray per metre: a shallower one is followed to where this one would end.
const MIN_FALL: f32 = 1e-3;

fn path_of(settings: TraceUniforms, entry: vec3<f32>, direction: vec3<f32>, edge: f32) -> Path {
    let reach_m = max(entry.y - settings.bottom_m, 0.0) / max(-direction.y, MIN_FALL);
    let a = frame.light_view_projection * vec4(entry, 1.0);
    let b = frame.light_view_projection * vec4(entry + reach_m * direction, 1.0);
    let range = cut(cut_to_sides(a, b), a.w - a.z, b.w - b.z);
    let begin = mix(a, b, range.x);
    let end = mix(a, b, range.y);
    return Path(
        entry, direction, perspective_divide(begin), perspective_divide(end), vec2(begin.w, end.w), reach_m * range, range.y >= 1.0,
        edge);
}

fn point_at(path: Path, depth: texture_depth_2d, texels: sampler, share: f32) -> PathPoint {
    let ndc = mix(path.begin, path.end, share);
    return PathPoint(share, ndc.z - seen_depth(depth, texels, path.edge, ndc.xy));
}

// The photon that lands at a point of its path.
fn landed(path: Path, point: PathPoint) -> Photon {
    // Perspective: equal shares on the screen are not equal lengths.
    let share = point.share * path.w.x / mix(path.w.y, path.w.x, point.share);
    let d = mix(path.distance_m.x, path.distance_m.y, share);
    let hit = path.entry_m + d * path.direction;
    let ndc = mix(path.begin, path.end, point.share);
    let seen_z = ndc.z - point.gap;
    if seen_z >= 1.0 {
        return Photon(path.entry_m, OUTSIDE, hit, d);
    }
    let residual = distance(hit, unproject(vec3(ndc.xy, seen_z)));
    return Photon(path.entry_m, landed_fate(residual), hit, d);
}

// The crossing between a place before and one behind what the light sees: regula falsi, of which the end that stays is halved
// (Illinois; Dowell and Jarratt 1971). Its order is 1.44, and the first step is exact on planes.
fn crossing(
    settings: TraceUniforms, path: Path, depth: texture_depth_2d, texels: sampler, before: PathPoint, behind: PathPoint
) -> PathPoint {
    var low = before;
    var high = behind;
    // Gaps that the next step takes.
    var gaps = vec2(before.gap, behind.gap);
    var last = 0;
    for (var i = 0u; i < settings.iterations; i++) {
        let share = mix(low.share, high.share, gaps.x / (gaps.x - gaps.y));
        let point = point_at(path, depth, texels, share);
        if abs(point.gap) <= NO_GAP {
            return point;
        }
        if point.gap < 0.0 {
            low = point;
            gaps = vec2(point.gap, select(gaps.y, 0.5 * gaps.y, last < 0));
            last = -1;
        } else {
            high = point;
            gaps = vec2(select(gaps.x, 0.5 * gaps.x, last > 0), point.gap);
            last = 1;
        }
    }
    if -low.gap < high.gap {
        return low;
    }
    return high;
}

// Linear search for the first step in which the ray passes through what the light sees, and regula falsi within it. A crossing at an edge
// is one behind a silhouette: the search goes on, as the light may reach the ray again. If it never does, the photon lands out of the light's
// sight, at the extension of the last surface that the ray passed over. A ray that goes behind an edge from where the light sees nothing lands
// nowhere. Surfaces narrower than a step can be missed.
fn first_crossing(
    settings: TraceUniforms, depth: texture_depth_2d, texels: sampler, entry: vec3<f32>, refracted: vec3<f32>
) -> Photon {
    let path = path_of(settings, entry, refracted, edge_step(settings, depth));
    if path.distance_m.y <= path.distance_m.x {
        return Photon(entry, OUTSIDE, entry, 0.0);
    }
    let size = vec2<f32>(textureDimensions(depth));
    let across_px = length(0.5 * size * (path.end.xy - path.begin.xy));
    let max_steps = settings.search_iterations - MIN_REFINED * settings.iterations;
    let steps = clamp(ceil(across_px / settings.step_px), 1.0, f32(max_steps));
    var earlier = point_at(path, depth, texels, 0.0);
    var before = earlier;
    var iterations_left = settings.search_iterations - u32(steps);
    // Share of the path at which a photon out of the light's sight lands.
    var hidden_share = 1.0;
    // Whether it goes behind an edge from where the light sees nothing.
    var is_lost = false;
    for (var i = 1.0; i <= steps; i += 1.0) {
        let behind = point_at(path, depth, texels, i / steps);
        if before.gap < 0.0 && behind.gap >= 0.0 {
            if iterations_left >= settings.iterations {
                let found = crossing(settings, path, depth, texels, before, behind);
                if abs(found.gap) <= path.edge {
                    return landed(path, found);
                }
                iterations_left -= settings.iterations;
            }
            hidden_share = 1.0;
            is_lost = mix(path.begin.z, path.end.z, before.share) - before.gap >= NOTHING;
            let closing = before.gap - earlier.gap;
            if !is_lost && closing > 0.0 {
                hidden_share = min(before.share - before.gap * (before.share - earlier.share) / closing, 1.0);
            }
        }
        earlier = before;
        before = behind;
    }
    if before.gap < 0.0 || is_lost || (hidden_share >= 1.0 && !path.to_bottom) {
        return Photon(entry, OUTSIDE, entry + path.distance_m.y * refracted, path.distance_m.y);
    }
    return landed(path, point_at(path, depth, texels, hidden_share));
}

// Two repeatable numbers in [0, 1) for a photon of the grid, of 16 bits each.
fn random_pair(photon: vec2<u32>) -> vec2<f32> {
    let bits = pcg(pcg(photon.x) + photon.y);
    return vec2(f32(bits >> 16u), f32(bits & 0xffffu)) / 65536.0;
}

// Place in the grid, −1 … 1 along each side, of sub-photon `sub` of cell `cell`.
fn photon_ndc(settings: TraceUniforms, cell: vec2<u32>, sub: vec2<u32>, side: u32) -> vec2<f32> {
    let photon = cell * side + sub;
    var share = settings.offset;
    if settings.jitter > 0.0 {
        // What leaves the share on one side comes in on the other.
        share = fract(share + settings.jitter * (random_pair(photon) - 0.5));
    }
    let index = vec2<f32>(photon) + share;
    return index / f32(settings.grid * side) * 2.0 - 1.0;
}
