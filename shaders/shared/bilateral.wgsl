// Joint bilateral filter and up-scaling of an ambient-occlusion buffer: VAO §6, after Kopf et al., Joint Bilateral
// Upsampling, 2007. Host twin: src/stages/shared/bilateral.rs.
#define_import_path fathom::bilateral

#import fathom::host::{BilateralUniforms}
#import fathom::disc::{GOLDEN_ANGLE}
#import fathom::uniforms::{frame, view_depth_m}
#import fathom::screen::{texel_behind}

const NO_NORMALS: f32 = 1000.0;
// Weight below which the taps say nothing: the one nearest in depth is taken.
const LEAST_WEIGHT: f32 = 1e-4;
// Farther than any tap lies from the pixel's plane, metres.
const NONE: f32 = 1e30;
// Where no tap shows a surface, the nearest in depth is sought among all texels so far to each side at most.
const MOST_SOUGHT: f32 = 8.0;

fn device_depth(depth: texture_depth_2d, texel: vec2<i32>) -> f32 {
    return textureLoad(depth, clamp(texel, vec2(0), vec2<i32>(textureDimensions(depth)) - 1), 0);
}

// Change of device depth from a texel to the next one along an axis: the smaller of the two one-sided differences, which
// is that of the surface the texel lies on where the other crosses an edge.
fn slope_along(depth: texture_depth_2d, texel: vec2<i32>, z: f32, axis: vec2<i32>) -> f32 {
    let ahead = texel + axis;
    let behind = texel - axis;
    let forward = device_depth(depth, ahead) - z;
    let backward = z - device_depth(depth, behind);
    if any(behind < vec2(0)) {
        return forward;
    }
    if any(ahead >= vec2<i32>(textureDimensions(depth))) {
        return backward;
    }
    return select(backward, forward, abs(forward) < abs(backward));
}

// Place of a tap in a unit disc: Vogel's spiral with its first tap in the middle and its last on the rim.
fn disc_tap(i: u32, taps: u32) -> vec2<f32> {
    let angle = f32(i) * GOLDEN_ANGLE;
    return sqrt(f32(i) / f32(max(taps, 2u) - 1u)) * vec2(cos(angle), sin(angle));
}

// Visibility at a pixel of the viewport; 1 where nothing was drawn.
fn filtered(
    source: texture_2d<f32>,
    depth: texture_depth_2d,
    normals: texture_2d<f32>,
    settings: BilateralUniforms,
    pixel: vec2<f32>,
) -> f32 {
    let here = vec2<i32>(pixel);
    let z = textureLoad(depth, here, 0);
    if z >= 1.0 {
        return 1.0;
    }
    // Device depth is linear on planes, so that its slope predicts a plane's depth exactly.
    let slope = vec2(
        slope_along(depth, here, z, vec2(1, 0)), slope_along(depth, here, z, vec2(0, 1)));
    let view_m = view_depth_m(z);
    let range = (frame.z_far_m - frame.z_near_m) / (frame.z_far_m * frame.z_near_m);
    // Metres of depth per metre across, ∂(view depth)/∂(device depth) = view_m² · range. The kernel is a disc that lies
    // on the surface: it shrinks along the gradient by the cosine of the surface's tilt.
    let tilt = slope * view_m * range / settings.pixel_tangent;
    let steepness = length(tilt);
    let uphill = tilt / max(steepness, 1e-6);
    let shrink = 1.0 - inverseSqrt(1.0 + steepness * steepness);

    let normal = normalize(textureLoad(normals, here, 0).xyz);
    let last = vec2<i32>(settings.source_px) - 1;
    let middle = pixel * (settings.source_px / settings.size_px);
    var sum = 0.0;
    var weights = 0.0;
    var nearest = 1.0;
    var nearest_m = NONE;
    for (var i = 0u; i < settings.taps; i++) {
        var offset = settings.radius_px * disc_tap(i, settings.taps);
        offset -= shrink * dot(offset, uphill) * uphill;
        let texel = clamp(vec2<i32>(floor(middle + offset)), vec2(0), last);
        let center = vec2<f32>(texel) + 0.5;
        let seen = texel_behind(center, settings.source_px, settings.size_px);
        let tap_z = textureLoad(depth, seen, 0);
        if tap_z >= 1.0 {
            continue;
        }
        let plane_z = clamp(z + dot(slope, vec2<f32>(seen - here)), 0.0, 1.0);
        let off_m = abs(view_depth_m(tap_z) - view_depth_m(plane_z));
        let value = textureLoad(source, texel, 0).x;
        if off_m < nearest_m {
            nearest_m = off_m;
            nearest = value;
        }
        let across = (center - middle) / settings.sigma_px;
        let along = off_m / (settings.depth_sigma * view_m);
        var turned = vec3(0.0);
        if settings.normal_sigma < NO_NORMALS {
            turned = (normalize(textureLoad(normals, seen, 0).xyz) - normal) / settings.normal_sigma;
        }
        let weight = exp(-0.5 * (dot(across, across) + along * along + dot(turned, turned)));
        sum += weight * value;
        weights += weight;
    }
    if nearest_m == NONE {
        // What is as thin as a twig can lie between the taps.
        let reach = i32(min(ceil(settings.radius_px), MOST_SOUGHT));
        let low = max(vec2<i32>(middle) - reach, vec2(0));
        let high = min(vec2<i32>(middle) + reach, last);
        for (var y = low.y; y <= high.y; y++) {
            for (var x = low.x; x <= high.x; x++) {
                let seen = texel_behind(vec2(f32(x), f32(y)) + 0.5, settings.source_px, settings.size_px);
                let tap_z = textureLoad(depth, seen, 0);
                let off_m = abs(view_depth_m(tap_z) - view_m);
                if tap_z < 1.0 && off_m < nearest_m {
                    nearest_m = off_m;
                    nearest = textureLoad(source, vec2(x, y), 0).x;
                }
            }
        }
    }
    if weights < LEAST_WEIGHT {
        return nearest;
    }
    return sum / weights;
}
