// defs: AXIS=0
// One pass of the three-way voxelization: each fragment sets the bit of its depth slice. VAO §4.2.
//
// The raster units draw the large triangles. An invocation of `main` rasterizes a small one, as Karis, Stubbe and Wihlidal do (Nanite:
// A Deep Dive, SIGGRAPH 2021), by edge functions (Pineda, A Parallel Algorithm for Polygon Rasterization, SIGGRAPH 1988) and the rule
// of raster units: corners are rounded to steps of a pixel, and a centre on an edge counts if the edge is a top or a left one.
#import fathom::dispatch::{GROUP, invocation_index}
#import fathom::pass_axes::{swizzled}
#import fathom::voxels::{Grid, to_cells}

@group(0) @binding(0) var<uniform> grid: Grid;
// A word holds 32 slices. A layer of words has the pass's pixels, row by row.
@group(0) @binding(1) var<storage, read_write> slices: array<atomic<u32>>;
// Seven words a vertex, of which the first three are its position.
@group(0) @binding(2) var<storage, read> vertices: array<f32>;
// Three a small triangle.
@group(0) @binding(3) var<storage, read> corners: array<u32>;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    // Voxels along the axis. Perspective and linear interpolation mean the same where w is 1, but some drivers (Mesa 22.3
    // lavapipe) interpolate linear varyings wrongly on triangles that they clip.
    @location(0) @interpolate(perspective) depth: f32,
}

fn pass_cells() -> vec3<u32> {
    return vec3<u32>(swizzled(vec3<f32>(grid.cells)));
}

// In pixels and slices.
fn pass_position(position_m: vec3<f32>) -> vec3<f32> {
    return swizzled(to_cells(grid, position_m));
}

@vertex
fn vertex(@location(0) position_m: vec3<f32>) -> Varying {
    let position = pass_position(position_m);
    let share = position / vec3<f32>(pass_cells());
    return Varying(vec4(2.0 * share.x - 1.0, 1.0 - 2.0 * share.y, share.z, 1.0), position.z);
}

// Depths at the grid's border may be beyond it by rounding.
fn set_bit(pixel: vec2<u32>, depth: f32) {
    let cells = pass_cells();
    let slice = min(u32(max(depth, 0.0)), cells.z - 1u);
    let word = pixel.x + cells.x * (pixel.y + cells.y * (slice >> 5u));
    atomicOr(&slices[word], 1u << (slice & 31u));
}

// Slices a pixel, beyond which rounding of corners to steps of a pixel moves a fragment's depth out of the triangle: half a step of 1/256.
const STEEPEST: f32 = 512.0;

@fragment
fn fragment(in: Varying) {
    // A triangle seen from its edge. The other passes have its voxels.
    if max(abs(dpdx(in.depth)), abs(dpdy(in.depth))) > STEEPEST {
        return;
    }
    set_bit(vec2<u32>(in.clip.xy), in.depth);
}

// Steps of a pixel to which corners are rounded: 256, as in common raster units. The origin is the centre of the first pixel.
const STEP_BITS: vec2<u32> = vec2(8u);

fn corner(number: u32) -> vec3<f32> {
    let first = 7u * corners[number];
    return pass_position(vec3(vertices[first], vertices[first + 1u], vertices[first + 2u]));
}

fn rounded(corner: vec3<f32>) -> vec2<i32> {
    return vec2<i32>(round(256.0 * (corner.xy - 0.5)));
}

// Twice the area of the triangle that an edge spans with a point. Negative where the point lies on the outer side, or on an edge that
// does not count. Boxes of up to 127 pixels do not overflow.
fn weight(start: vec2<i32>, end: vec2<i32>, winding: i32, point: vec2<i32>) -> i32 {
    let along = winding * (end - start);
    let across = point - start;
    let weight = along.x * across.y - along.y * across.x;
    let top_or_left = along.y < 0 || along.y == 0 && along.x > 0;
    return select(weight, -1, weight == 0 && !top_or_left);
}

@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let first = 3u * invocation_index(id, groups);
    if first >= arrayLength(&corners) {
        return;
    }
    let p = corner(first);
    let q = corner(first + 1u);
    let r = corner(first + 2u);
    let a = rounded(p);
    let b = rounded(q);
    let c = rounded(r);
    let cells = vec3<i32>(pass_cells());
    let low = max((min(a, min(b, c)) + 255) >> STEP_BITS, vec2(0));
    let high = min(max(a, max(b, c)) >> STEP_BITS, cells.xy - 1);
    let winding = sign((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x));
    if any(low > high) || winding == 0 {
        return;
    }
    let depths = vec3(p.z, q.z, r.z);
    var pixel = low;
    while pixel.y <= high.y {
        let center = pixel << STEP_BITS;
        let weights = vec3(weight(b, c, winding, center), weight(c, a, winding, center), weight(a, b, winding, center));
        if all(weights >= vec3(0)) {
            let depth = dot(vec3<f32>(weights), depths) / f32(weights.x + weights.y + weights.z);
            // What clipping leaves of a triangle.
            if depth >= 0.0 && depth <= f32(cells.z) {
                set_bit(vec2<u32>(pixel), depth);
            }
        }
        pixel.x++;
        if pixel.x > high.x {
            pixel = vec2(low.x, pixel.y + 1);
        }
    }
}
