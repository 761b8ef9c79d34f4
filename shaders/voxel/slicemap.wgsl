// One pass of the three-way voxelization: each fragment sets the bit of its depth slice. VAO §4.2.
// defs: AXIS=0
#import fathom::voxels::{Grid, to_cells}

@group(0) @binding(0) var<uniform> grid: Grid;
// A word holds 32 slices. A layer of words has the pass's pixels, row by row.
@group(0) @binding(1) var<storage, read_write> slices: array<atomic<u32>>;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    // Voxels along the axis. Perspective and linear interpolation mean the same where w is 1, but some drivers (Mesa 22.3
    // lavapipe) interpolate linear varyings wrongly on triangles that they clip.
    @location(0) @interpolate(perspective) depth: f32,
}

// Column and row of the pass, and depth.
fn turned(v: vec3<f32>) -> vec3<f32> {
#if AXIS == 0
    return v.yzx;
#else if AXIS == 1
    return v.xzy;
#else
    return v.xyz;
#endif
}

@vertex
fn vertex(@location(0) position_m: vec3<f32>) -> Varying {
    let place = turned(to_cells(grid, position_m));
    let share = place / turned(vec3<f32>(grid.cells));
    return Varying(vec4(2.0 * share.x - 1.0, 1.0 - 2.0 * share.y, share.z, 1.0), place.z);
}

@fragment
fn fragment(in: Varying) {
    let cells = vec3<u32>(turned(vec3<f32>(grid.cells)));
    let pixel = vec2<u32>(in.clip.xy);
    // Clipping leaves depths within the grid but for rounding.
    let slice = min(u32(max(in.depth, 0.0)), cells.z - 1u);
    let word = pixel.x + cells.x * (pixel.y + cells.y * (slice >> 5u));
    atomicOr(&slices[word], 1u << (slice & 31u));
}
