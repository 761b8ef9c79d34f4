// Occlusion of a surface point by marching rays through a volume. VAO §3 step 3, §5.1. Host twin: src/stages/shared/marching.rs.
//
// Lengths are in voxels, places are in voxels from the grid's origin. Definitions choose the code:
//   UNIFORM   1: directions uniform over the hemisphere, weighted by the cosine; 2: by twice the cosine; 0: cosine-distributed, not weighted
//   RANDOM    1: independent directions; 0: a lattice, shifted by the seed
//   HARD      1: ρ = 1; 0: ρ = 1 − d / r_max
//   GUARD     1: guard distance over the cosine (Eq. 2); 0: constant
//   SKIPPING  1: rays leave empty cells of the pyramid in one step
//   OPACITY   1: samples are opacities, gathered along the ray (Eq. 7); 0: the first above the threshold ends it
//   PEAK      1: where V can exceed the threshold between two samples, it is sampled in fifths of the step between them, and a hit lies
//             where V, linear between two of these, crosses the threshold; 0: a hit lies at the sample
//   JITTER    1: each ray's samples are moved along it by a random share of a step; 0: all rays begin at the guard distance
//   COUNT     1: counts samples and look-ups of the pyramid
//   SLICED    1: a pass marches a slice of the rays, as more would exceed the iterations that adapters allow an invocation
#define_import_path fathom::marching

#import fathom::random::{GOLDEN, pcg, unit}
#import fathom::slice::{Slice}
#import fathom::sphere::{cosine_direction, hemisphere_direction, tangent_frame}
#import fathom::voxels::{Grid, to_cells}

struct March {
    r_max: f32,
    step: f32,
    // First sample, or its distance from the surface's plane.
    guard: f32,
    // From the surface along its normal to where rays begin.
    offset: f32,
    // Look-ups of the volume are moved by this along each of its axes.
    shift: f32,
    // Above 1 no sample ends a ray.
    threshold: f32,
    rays: u32,
    seed: u32,
}

@group(1) @binding(0) var<uniform> march: March;
@group(1) @binding(1) var<uniform> grid: Grid;
@group(1) @binding(2) var volume: texture_3d<f32>;
@group(1) @binding(3) var trilinear: sampler;
#if SLICED == 1
// Rays of this pass.
@group(1) @binding(4) var<storage, read> slice: Slice;
// Sum over the rays so far, for each point.
@group(1) @binding(5) var<storage, read_write> sums: array<f32>;
#endif

// Level of the pyramid that is read: cells of 4³ voxels. The fastest of 1 to 4 on scenes bunny_dry and sponza.
const SKIP_LEVEL: i32 = 2;
// Samples this near to a cell's wall are taken, as rounding may have put them on the wrong side, voxels.
const WALL: f32 = 1e-3;
// Parts of a step that V is sampled at where it can exceed the threshold within the step.
// A wall of one voxel along an axis exceeds the default's 0.9 over 2 (1 − 0.9) voxels: a fifth of the default's step.
const PARTS: u32 = 5u;
// Shortest component of a direction, so that none divides by 0.
const MIN_COMPONENT: f32 = 1e-7;

#if COUNT == 1
var<private> taken: u32 = 0u;
var<private> looked_up: u32 = 0u;
#endif

// Seed of a point's directions, by its number and that of the run.
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
fn density(position: vec3<f32>) -> f32 {
#if COUNT == 1
    taken++;
#endif
    return textureSampleLevel(volume, trilinear, position / vec3<f32>(grid.cells), 0.0).r;
}

// Distances at which a ray enters the grid, and at which it leaves it or ends.
fn clip(origin: vec3<f32>, direction: vec3<f32>) -> vec2<f32> {
    let a = -origin / direction;
    let b = (vec3<f32>(grid.cells) - origin) / direction;
    let enter = min(a, b);
    let leave = max(a, b);
    return vec2(max(max(enter.x, enter.y), enter.z), min(min(min(leave.x, leave.y), leave.z), march.r_max));
}

// Steps from a ray's sample at `first` to its first one in the grid.
fn steps_to(enter: f32, first: f32) -> f32 {
    return max(ceil((enter - first) / march.step), 0.0);
}

#if SKIPPING == 1
// Steps from a place to the first one outside its cell of the pyramid; 0 where the cell is not empty.
fn empty_steps(position: vec3<f32>, direction: vec3<f32>) -> f32 {
#if COUNT == 1
    looked_up++;
#endif
    let edge = f32(1u << u32(SKIP_LEVEL));
    let cell = floor(position / edge);
    let last = vec3<i32>(textureDimensions(volume, SKIP_LEVEL)) - 1;
    if textureLoad(volume, clamp(vec3<i32>(cell), vec3(0), last), SKIP_LEVEL).r > 0.0 {
        return 0.0;
    }
    let walls = (cell + step(vec3(0.0), direction)) * edge;
    let t = (walls - position) / direction;
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

// V at a sample of a ray, and steps to the next sample.
struct Sample {
    v: f32,
    steps: f32,
}

// The sample at a position; outside the volume V is 0. With `may_skip` the steps lead out of an empty cell, in which V is 0 at every sample
// and between them.
fn sample_at(position: vec3<f32>, direction: vec3<f32>, is_inside: bool, may_skip: bool) -> Sample {
    var empty = 0.0;
#if SKIPPING == 1
    if is_inside && may_skip {
        empty = empty_steps(position, direction);
    }
#endif
    var v = 0.0;
    if is_inside && empty == 0.0 {
        v = density(position);
    }
    return Sample(v, max(empty, 1.0));
}

// Obscurity along a ray over a range of distances, 0 where it meets nothing. `first` is the distance of its first sample, `v0` V where it
// begins.
#if OPACITY == 1
fn obscurity(origin: vec3<f32>, direction: vec3<f32>, range: vec2<f32>, first: f32, v0: f32) -> f32 {
    var k = steps_to(range.x, first);
    var open = 1.0;
    var previous = select(v0, 0.0, k > 0.0);
    for (var d = first + k * march.step; d < range.y; d = first + k * march.step) {
        let found = sample_at(origin + d * direction, direction, d >= range.x, true);
        // Eq. 4: falling V is rejected.
        if found.v >= previous {
            open *= max(1.0 - found.v, 0.0);
            if found.v >= march.threshold || open <= 0.0 {
                break;
            }
        }
        previous = found.v;
        k += found.steps;
    }
    return 1.0 - pow(open, march.step);
}
#else if PEAK == 1
fn obscurity(origin: vec3<f32>, direction: vec3<f32>, range: vec2<f32>, first: f32, v0: f32) -> f32 {
    var k = steps_to(range.x, first);
    var d = first + k * march.step;
    var steps = 1.0;
    var previous = select(v0, 0.0, k > 0.0);
    // Largest change of V over a step: trilinear V changes by at most 1 a voxel along each axis.
    let max_change = march.step * dot(abs(direction), vec3(1.0));
    // One loop for both lengths of step, so that lanes that sample parts of a step share its iterations with those that do not. `ahead` is V
    // at the end of such a step.
    let part = march.step / f32(PARTS);
    var parts_left = 0u;
    var ahead = 0.0;
    // A peak may lie between the volume's border and the sample before or behind it.
    while d < march.r_max {
        let found = sample_at(origin + d * direction, direction, d >= range.x && d < range.y, parts_left == 0u);
        var v = found.v;
        let gap = select(march.step, part, parts_left > 0u);
        if parts_left > 0u {
            parts_left--;
            if parts_left == 0u && v < march.threshold {
                previous = v;
                v = ahead;
                d += part;
            }
        } else {
            steps = found.steps;
            // Between other pairs of samples V stays below the threshold.
            if previous < march.threshold && previous + v + max_change >= 2.0 * march.threshold {
                ahead = v;
                parts_left = PARTS - 1u;
                d -= f32(parts_left) * part;
                continue;
            }
        }
        if v >= march.threshold {
            if previous < march.threshold {
                d = crossing(d - gap, previous, d, v);
            }
            return attenuated(d);
        }
        previous = v;
        if parts_left > 0u {
            d += part;
            continue;
        }
        if d >= range.y {
            break;
        }
        k += steps;
        d = first + k * march.step;
    }
    return 0.0;
}
#else
fn obscurity(origin: vec3<f32>, direction: vec3<f32>, range: vec2<f32>, first: f32, v0: f32) -> f32 {
    var k = steps_to(range.x, first);
    for (var d = first + k * march.step; d < range.y; d = first + k * march.step) {
        let found = sample_at(origin + d * direction, direction, d >= range.x, true);
        if found.v >= march.threshold {
            return attenuated(d);
        }
        k += found.steps;
    }
    return 0.0;
}
#endif

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
        let direction = select(across, vec3(MIN_COMPONENT), abs(across) < vec3(MIN_COMPONENT));
        let range = clip(origin, direction);
        if range.x >= range.y {
            continue;
        }
        let rho = obscurity(origin, direction, range, first_sample(local.z, ray, seed), v0);
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
