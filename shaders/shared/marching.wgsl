// Occlusion of a surface point by marching rays through a volume. VAO §3 step 3, §5.1. Host twin: src/stages/shared/marching.rs.
//
// Lengths are in voxels, places are in voxels from the grid's origin. Definitions choose the code:
//   UNIFORM   1: directions uniform over the hemisphere, weighted by the cosine; 2: by twice the cosine; 0: cosine-distributed, not weighted
//   RANDOM    1: independent directions; 0: a lattice, shifted by the seed
//   HARD      1: ρ = 1; 0: ρ = 1 − d / r_max
//   GUARD     1: guard distance over the cosine (Eq. 2); 0: constant
//   SKIPPING  1: empty cells of the pyramid are left in one go
//   OPACITY   1: samples are opacities, gathered along the ray (Eq. 7); 0: the first above the threshold ends it
//   PEAK      1: where V can exceed the threshold between two samples, it is sampled in fifths of the step between them, and a hit lies
//             where V, linear between two of these, crosses the threshold; 0: a hit lies at the sample
//   JITTER    1: each ray's samples are moved along it by a random share of a step; 0: all rays begin at the guard distance
//   COUNT     1: counts samples and look-ups of the pyramid
//   SLICED    1: a pass marches a slice of the rays, as more would exceed the turns that adapters make of an invocation's loops
#define_import_path fathom::marching

#import fathom::host::{GridUniforms, MarchUniforms, Slice}
#import fathom::random::{pcg, unit}
#import fathom::sphere::{cosine_direction, hemisphere_direction, tangent_frame}
#import fathom::voxels::{to_cells}

@group(1) @binding(0) var<uniform> march: MarchUniforms;
@group(1) @binding(1) var<uniform> grid: GridUniforms;
@group(1) @binding(2) var volume: texture_3d<f32>;
@group(1) @binding(3) var trilinear: sampler;
#if SLICED == 1
// Rays of this pass.
@group(1) @binding(4) var<storage, read> slice: Slice;
// Sum over the rays so far, for each point.
@group(1) @binding(5) var<storage, read_write> sums: array<f32>;
#endif

// 2³² / golden ratio: steps of the lattice's second coordinate.
const GOLDEN: u32 = 0x9E3779B9u;
// Level of the pyramid that is asked: cells of 4³ voxels. The fastest of 1 to 4 on scenes bunny_dry and sponza.
const SKIP_LEVEL: i32 = 2;
// Samples this near to a cell's wall are taken, as rounding may have put them on the wrong side, voxels.
const WALL: f32 = 1e-3;
// Parts of a step that V is sampled at where it can exceed the threshold within the step.
// A wall of one voxel along an axis exceeds the default's 0.9 over 2 (1 − 0.9) voxels: a fifth of the default's step.
const PARTS: u32 = 5u;
// Shortest component of a direction, so that none divides by 0.
const LEAST: f32 = 1e-7;

#if COUNT == 1
var<private> taken: u32 = 0u;
var<private> looked_up: u32 = 0u;
#endif

// Seed of a point's directions, by its number. The run's own number moves it; 0 leaves it where it is.
fn seed_of(number: u32) -> u32 {
    return pcg(number + march.seed * GOLDEN);
}

// Point of [0, 1)² for a ray.
fn point(ray: u32, seed: u32) -> vec2<f32> {
#if RANDOM == 1
    let first = pcg(seed + ray);
    return vec2(unit(first), unit(pcg(first)));
#else
    let along = (f32(ray) + unit(seed)) / f32(march.rays);
    return vec2(along, unit(ray * GOLDEN + pcg(seed)));
#endif
}

// Direction around +z for a ray.
fn local_direction(ray: u32, seed: u32) -> vec3<f32> {
#if UNIFORM == 0
    return cosine_direction(point(ray, seed));
#else
    return hemisphere_direction(point(ray, seed));
#endif
}

// V at a place, trilinear between voxel centres; up to half a voxel inside the border the border's.
fn density(place: vec3<f32>) -> f32 {
#if COUNT == 1
    taken++;
#endif
    return textureSampleLevel(volume, trilinear, place / vec3<f32>(grid.cells), 0.0).r;
}

// Distances at which a ray enters and leaves the grid.
fn clip(origin: vec3<f32>, direction: vec3<f32>) -> vec2<f32> {
    let a = -origin / direction;
    let b = (vec3<f32>(grid.cells) - origin) / direction;
    let enter = min(a, b);
    let leave = max(a, b);
    return vec2(max(max(enter.x, enter.y), enter.z), min(min(leave.x, leave.y), leave.z));
}

#if SKIPPING == 1
// Steps from a place to the first one outside its cell of the pyramid; 0 where the cell is not empty.
fn empty_steps(place: vec3<f32>, direction: vec3<f32>) -> f32 {
#if COUNT == 1
    looked_up++;
#endif
    let edge = f32(1u << u32(SKIP_LEVEL));
    let cell = floor(place / edge);
    let last = vec3<i32>(textureDimensions(volume, SKIP_LEVEL)) - 1;
    if textureLoad(volume, clamp(vec3<i32>(cell), vec3(0), last), SKIP_LEVEL).r > 0.0 {
        return 0.0;
    }
    let walls = (cell + step(vec3(0.0), direction)) * edge;
    let t = (walls - place) / direction;
    return floor((min(min(t.x, t.y), t.z) - WALL) / march.step) + 1.0;
}
#endif

// Distance at which V, linear between two samples, crosses the threshold.
fn crossing(low_d: f32, low_v: f32, high_d: f32, high_v: f32) -> f32 {
    return high_d - (high_d - low_d) * (high_v - march.threshold) / (high_v - low_v);
}

// ρ at a distance.
fn attenuated(d: f32) -> f32 {
#if HARD == 1
    return 1.0;
#else
    return 1.0 - d / march.r_max;
#endif
}

// Distance of a ray's first sample. `cosine` is that of the ray and the normal.
fn first_sample(cosine: f32, ray: u32, seed: u32) -> f32 {
#if GUARD == 1
    let guard = march.guard / cosine;
#else
    let guard = march.guard;
#endif
#if JITTER == 1
    return guard + march.step * unit(pcg(pcg(seed) + ray));
#else
    return guard;
#endif
}

// Obscurity ρ of what a ray meets from its sample at `first` on, 0 where it meets nothing. `v0` is V where the ray begins.
fn obscurity(origin: vec3<f32>, direction: vec3<f32>, first: f32, v0: f32) -> f32 {
    let range = clip(origin, direction);
    let end = min(range.y, march.r_max);
    if range.x >= end {
        return 0.0;
    }
    var k = max(ceil((range.x - first) / march.step), 0.0);
    var d = first + k * march.step;
#if OPACITY == 1
    var open = 1.0;
#endif
    // Outside the volume V is 0.
    var previous = select(v0, 0.0, k > 0.0);
    // Samples between two at the ends of a step that are still to be taken.
    var left = 0u;
    // Steps from this sample to the next one to take.
    var jump = 1.0;
#if PEAK == 1
    // One loop for both lengths of step, so that lanes that look between samples share its turns with those that do not. `ahead` is V at
    // the sample behind those between.
    let part = march.step / f32(PARTS);
    var ahead = 0.0;
    // Largest change of V over a step: trilinear V changes by at most 1 a voxel along each axis.
    let most_change = march.step * dot(abs(direction), vec3(1.0));
#endif
    // A peak may lie between the volume's border and the sample before or behind it.
    while d < march.r_max {
        let place = origin + d * direction;
        let inside = d >= range.x && d < end;
        var v = 0.0;
#if SKIPPING == 1
        // In an empty cell V is 0 at this sample, at the others that are left out, and between them. Samples between this one and the one
        // before lie outside the cell and are taken as they would be without skipping.
        var empty = 0.0;
        if left == 0u && inside {
            empty = empty_steps(place, direction);
            jump = max(empty, 1.0);
        }
        if inside && empty == 0.0 {
            v = density(place);
        }
#else
        if inside {
            v = density(place);
        }
#endif
#if OPACITY == 1
        // Eq. 4: falling V is rejected.
        if v >= previous {
            open *= max(1.0 - v, 0.0);
            if v >= march.threshold || open <= 0.0 {
                break;
            }
        }
#else
#if PEAK == 1
        let gap = select(march.step, part, left > 0u);
        if left > 0u {
            left--;
            if left == 0u && v < march.threshold {
                previous = v;
                v = ahead;
                d += part;
            }
        } else if previous < march.threshold && previous + v + most_change >= 2.0 * march.threshold {
            // Between other pairs of samples V stays below the threshold.
            ahead = v;
            left = PARTS - 1u;
            d -= f32(left) * part;
            continue;
        }
#endif
        if v >= march.threshold {
#if PEAK == 1
            if previous < march.threshold {
                d = crossing(d - gap, previous, d, v);
            }
#endif
            return attenuated(d);
        }
#endif
        previous = v;
#if PEAK == 1
        if left > 0u {
            d += part;
            continue;
        }
#endif
        if d >= end {
            break;
        }
        k += jump;
        d = first + k * march.step;
    }
#if OPACITY == 1
    return 1.0 - pow(open, march.step);
#else
    return 0.0;
#endif
}

// Sum over these rays of what they meet, from a point with its unit normal; 0 where none reaches the volume.
fn gathered(position_m: vec3<f32>, normal: vec3<f32>, seed: u32, first_ray: u32, end_ray: u32) -> f32 {
    let surface = to_cells(grid, position_m);
    let beyond = max(-surface, surface - vec3<f32>(grid.cells));
    // Rays begin at the offset, and may do so nearer to the volume.
    if max(max(beyond.x, beyond.y), beyond.z) > march.r_max + march.offset + abs(march.shift) {
        return 0.0;
    }
    let origin = surface + march.offset * normal + march.shift;
    let rotation = tangent_frame(normal);
#if OPACITY == 1
    let v0 = density(origin);
#else
    // Above any threshold: the first sample has no neighbour before it.
    let v0 = 2.0;
#endif
    var sum = 0.0;
    for (var ray = first_ray; ray < end_ray; ray++) {
        let local = local_direction(ray, seed);
        let across = rotation * local;
        let direction = select(across, vec3(LEAST), abs(across) < vec3(LEAST));
        let rho = obscurity(origin, direction, first_sample(local.z, ray, seed), v0);
#if UNIFORM == 0
        sum += rho;
#else
        sum += local.z * rho;
#endif
    }
    return sum;
}

// A(p) of a point and its unit normal. VAO §3 step 3. Of slices the last has the answer, those before it have 0. `index` is the
// point's place among the sums.
fn occlusion(position_m: vec3<f32>, normal: vec3<f32>, seed: u32, index: u32) -> f32 {
#if SLICED == 1
    var sum = gathered(position_m, normal, seed, slice.first, slice.end);
    if slice.first > 0u {
        sum += sums[index];
    }
    sums[index] = sum;
    if slice.end < march.rays {
        return 0.0;
    }
#else
    let sum = gathered(position_m, normal, seed, 0u, march.rays);
#endif
#if UNIFORM == 2
    return 2.0 * sum / f32(march.rays);
#else
    return sum / f32(march.rays);
#endif
}
