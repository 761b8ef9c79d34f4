// Ambient occlusion in slices of the hemisphere, by their two horizons or by the sectors that samples of depth cover. Horizons: Jimenez, Wu,
// Pesce and Jarabo, Practical Realtime Strategies for Accurate Indirect Occlusion, ATVI-TR-16-01, 2016 (GTAO), Eqs. 5 to 8. Sectors:
// Therrien, Levesque and Gilet, Screen Space Indirect Lighting with Visibility Bitmask, 2023.
// defs: BITMASK=0, UNIFORM=0, TILED=0, HARD=1, COUNT=0, COUNTERS=1
//
// BITMASK: sectors, else horizons. UNIFORM: sectors of equal angle, else of equal cosine-weighted share. TILED: the 16 texels of a tile of
// 4 × 4 share the rotations.
#import fathom::host::{GatherUniforms}
#import fathom::horizon::{GOLDEN_FRACTION, Point, Slice, cosine_of, depth, integral, sample_along, shaded_point, slice_along, tangent_cosine, view_px}
#if COUNT == 1
#import fathom::counters::{count}
#import fathom::horizon::{taken}
#endif
#import fathom::math::{PI}
#import fathom::random::{GOLDEN, pcg, unit}
#import fathom::screen
#import fathom::sphere::{tangent_frame}

@group(1) @binding(0) var<storage, read> settings: GatherUniforms;

// One side of a slice, from the direction to the eye down to the tangent plane.
struct Side {
    slice: Slice,
    // cos θ of the tangent plane.
    tangent: f32,
    // What lies above it.
    open: f32,
}

const SECTORS: f32 = 32.0;

// From the direction to the eye to the one of this cosine: the angle, or the part of the cosine-weighted integral.
fn measure(slice: Slice, cosine: f32) -> f32 {
#if UNIFORM == 1
    return acos(clamp(cosine, -1.0, 1.0));
#else
    return integral(slice, cosine);
#endif
}

fn side_along(point: Point, direction: vec3<f32>) -> Side {
    let slice = slice_along(point, direction, settings.r_max_m);
    let tangent = tangent_cosine(slice);
    return Side(slice, tangent, measure(slice, tangent));
}

// Samples along a side; a line that leaves the pixel nowhere has none.
fn steps_of(side: Side) -> u32 {
    return select(0u, settings.steps, side.slice.length_px > 1.0);
}

// GTAO Eq. 6: cos θ of the highest sample. §4.3: behind an occluder the horizon falls, as what is thin hides little.
fn horizon(point: Point, side: Side, jitter: f32) -> f32 {
    var highest = side.tangent;
    for (var k = 0u; k < steps_of(side); k++) {
        let seen = sample_along(point, side.slice, f32(k) + jitter, settings.steps, settings.r_max_m);
        let found = cosine_of(point, side.slice, seen.v);
        if seen.counts && found > -1.0 {
            highest = max(mix(max(highest, found), found, select(0.0, settings.fall, found < highest)), side.tangent);
        }
    }
    return highest;
}

// Sectors that samples cover, from the surface seen to its back, which lies a thickness farther from the eye. The middle of a sector decides.
// `begin` is the eye's place in the slice, 0 to 1, and `along` what the side's measure adds to it.
fn cover(before: u32, point: Point, side: Side, jitter: f32, begin: f32, along: f32) -> u32 {
    var mask = before;
    for (var k = 0u; k < steps_of(side); k++) {
        let seen = sample_along(point, side.slice, f32(k) + jitter, settings.steps, settings.r_max_m);
        let front = cosine_of(point, side.slice, seen.v);
        if !seen.counts || front <= side.tangent {
            continue;
        }
        let back = cosine_of(point, side.slice, seen.v - settings.thickness_m * point.to_eye);
        let ends = vec2(measure(side.slice, front), measure(side.slice, max(back, side.tangent)));
        let sectors = vec2<u32>(round(SECTORS * saturate(begin + along * ends)));
        let first = min(sectors.x, sectors.y);
        mask = insertBits(mask, 0xffffffffu, first, max(sectors.x, sectors.y) - first);
    }
    return mask;
}

// A of a slice through the direction: with horizons ∫ of what lies below them, GTAO Eqs. 7 and 8; of sectors their share, times the slice's
// weight where they are not uniform.
fn occlusion_in(point: Point, direction: vec3<f32>, jitter: f32) -> f32 {
    let right = side_along(point, direction);
    let left = side_along(point, -direction);
    let whole = right.open + left.open;
#if BITMASK == 1
    let begin = left.open / whole;
    let mask = cover(0u, point, right, jitter, begin, 1.0 / whole);
    let share = f32(countOneBits(cover(mask, point, left, jitter, begin, -1.0 / whole))) / SECTORS;
#if UNIFORM == 1
    return share;
#else
    return share * whole;
#endif
#else
    let seen = integral(right.slice, horizon(point, right, jitter)) + integral(left.slice, horizon(point, left, jitter));
    return whole - seen;
#endif
}

// Visibility 1 − A; 1 where nothing was drawn.
@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = screen::texel_behind(pixel.xy, vec2<f32>(settings.size_px), view_px());
    let z = textureLoad(depth, texel, 0);
    if z >= 1.0 {
        return vec4(1.0);
    }
    let own = vec2<u32>(pixel.xy);
#if TILED == 1
    let first = pcg(settings.seed);
    let place = (f32(((own.x + own.y) & 3u) * 4u + (own.x & 3u)) + 0.5) / 16.0;
    let rotation = fract(unit(first) + place);
    let offset = fract(unit(pcg(first)) + 16.0 * place * GOLDEN_FRACTION);
#else
    let first = pcg(own.x + 65536u * own.y + settings.seed * GOLDEN);
    let rotation = unit(first);
    let offset = unit(pcg(first));
#endif
    let point = shaded_point(texel, z);
    let basis = tangent_frame(point.to_eye);
    var occluded = 0.0;
    for (var i = 0u; i < settings.slices; i++) {
        let angle = PI * (f32(i) + rotation) / f32(settings.slices);
        let direction = basis[0] * cos(angle) + basis[1] * sin(angle);
        occluded += occlusion_in(point, direction, fract(offset + f32(i) * GOLDEN_FRACTION));
    }
#if COUNT == 1
    let slot = own.x & 63u;
    count(0u, slot, taken);
    count(1u, slot, 1u);
#endif
    return vec4(1.0 - saturate(occluded / f32(settings.slices)));
}
