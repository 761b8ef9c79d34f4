// Joint bilateral filter and up-scaling of an ambient-occlusion buffer: VAO §6, after Kopf et al., Joint Bilateral
// Upsampling, 2007. Host twin: src/stages/shared/bilateral.rs.
// SQUARE 1: 16 taps on the 4 × 4 nearest texels, of equal weight on one surface. SQUARE 0: taps over a disc.
#define_import_path fathom::bilateral

#import fathom::host::{BilateralUniforms}
#import fathom::disc::{GOLDEN_ANGLE}
#import fathom::uniforms::{frame, view_depth_m}
#import fathom::screen::{texel_behind}
#import fathom::surface_plane::{plane_at, plane_depth_m}

const NO_NORMALS: f32 = 1000.0;
// Below this sum of weights the tap nearest in depth is taken.
const MIN_WEIGHT: f32 = 1e-4;
// Farther than any tap lies from the pixel's plane.
const TOO_FAR_M: f32 = 1e30;
// Where no tap shows a surface, texels so far to each side are searched at most.
const MAX_REACH_PX: f32 = 8.0;

@group(1) @binding(0) var<storage, read> settings: BilateralUniforms;
@group(1) @binding(1) var source: texture_2d<f32>;
@group(1) @binding(2) var depth: texture_depth_2d;
@group(1) @binding(3) var normals: texture_2d<f32>;

// Offset of a tap in a unit disc: Vogel's spiral with its first tap in the middle and its last on the rim.
fn disc_tap(i: u32, taps: u32) -> vec2<f32> {
    let angle = f32(i) * GOLDEN_ANGLE;
    return sqrt(f32(i) / f32(max(taps, 2u) - 1u)) * vec2(cos(angle), sin(angle));
}

// A disc on the surface as the screen shows it: shorter along the surface's gradient, by the cosine of the surface's tilt.
struct TiltedDisc {
    // Unit vector along the gradient.
    uphill: vec2<f32>,
    // By what share it is shorter.
    shrink: f32,
}

fn tilted_disc(pixel_tangent: f32, slope: vec2<f32>, view_m: f32) -> TiltedDisc {
    let range = (frame.z_far_m - frame.z_near_m) / (frame.z_far_m * frame.z_near_m);
    // Metres of depth per metre across, ∂(view depth)/∂(device depth) = view_m² · range.
    let tilt = slope * view_m * range / pixel_tangent;
    let steepness = length(tilt);
    return TiltedDisc(tilt / max(steepness, 1e-6), 1.0 - inverseSqrt(1.0 + steepness * steepness));
}

// Visibility of the texel around a pixel that is nearest to it in depth, 1 where none shows a surface: what is as thin as a twig can lie
// between the taps.
fn nearest_around(kernel: BilateralUniforms, middle: vec2<f32>, view_m: f32) -> f32 {
    let reach = i32(min(ceil(kernel.radius_px), MAX_REACH_PX));
    let low = max(vec2<i32>(middle) - reach, vec2(0));
    let high = min(vec2<i32>(middle) + reach, vec2<i32>(kernel.source_px) - 1);
    var nearest = 1.0;
    var nearest_m = TOO_FAR_M;
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            let seen = texel_behind(vec2(f32(x), f32(y)) + 0.5, kernel.source_px, kernel.size_px);
            let tap_z = textureLoad(depth, seen, 0);
            let off_m = abs(view_depth_m(tap_z) - view_m);
            if tap_z < 1.0 && off_m < nearest_m {
                nearest_m = off_m;
                nearest = textureLoad(source, vec2(x, y), 0).x;
            }
        }
    }
    return nearest;
}

// Visibility at a pixel of the viewport; 1 where nothing was drawn.
fn filtered(pixel: vec2<f32>) -> f32 {
    let here = vec2<i32>(pixel);
    if textureLoad(depth, here, 0) >= 1.0 {
        return 1.0;
    }
    // Read once: llvmpipe would read settings from storage again at every use.
    let kernel = settings;
    let plane = plane_at(depth, here);
    let view_m = view_depth_m(plane.z);
    let disc = tilted_disc(kernel.pixel_tangent, plane.slope, view_m);
    let normal = normalize(textureLoad(normals, here, 0).xyz);
    let last = vec2<i32>(kernel.source_px) - 1;
    let middle = pixel * (kernel.source_px / kernel.size_px);
    var sum = 0.0;
    var weights = 0.0;
    var nearest = 1.0;
    var nearest_m = TOO_FAR_M;
    for (var i = 0u; i < kernel.taps; i++) {
#if SQUARE == 1
        let offset = vec2(f32(i & 3u), f32(i >> 2u)) - 1.5;
#else
        var offset = kernel.radius_px * disc_tap(i, kernel.taps);
        offset -= disc.shrink * dot(offset, disc.uphill) * disc.uphill;
#endif
        let texel = clamp(vec2<i32>(floor(middle + offset)), vec2(0), last);
        let center = vec2<f32>(texel) + 0.5;
        let seen = texel_behind(center, kernel.source_px, kernel.size_px);
        let tap_z = textureLoad(depth, seen, 0);
        if tap_z >= 1.0 {
            continue;
        }
        let off_m = abs(view_depth_m(tap_z) - plane_depth_m(plane, seen));
        let value = textureLoad(source, texel, 0).x;
        if off_m < nearest_m {
            nearest_m = off_m;
            nearest = value;
        }
#if SQUARE == 1
        let across = vec2(0.0);
#else
        let across = (center - middle) / kernel.sigma_px;
#endif
        let along = off_m / (kernel.depth_sigma * view_m);
        var bend = vec3(0.0);
        if kernel.normal_sigma < NO_NORMALS {
            bend = (normalize(textureLoad(normals, seen, 0).xyz) - normal) / kernel.normal_sigma;
        }
        let weight = exp(-0.5 * (dot(across, across) + along * along + dot(bend, bend)));
        sum += weight * value;
        weights += weight;
    }
    if nearest_m == TOO_FAR_M {
        return nearest_around(kernel, middle, view_m);
    }
    return select(sum / weights, nearest, weights < MIN_WEIGHT);
}
