// The scene drawn into frusta one slice thin, and the OR of the three axes. VAO §4.1.
// defs: AXIS=0
#import fathom::voxels::{Grid, to_cells}
#import fathom::dispatch::{GROUP, invocation_index}
#import fathom::pass_axes::{swizzled}

@group(0) @binding(0) var<uniform> grid: Grid;
// A volume for each axis: columns and rows of its passes, and slices.
@group(1) @binding(0) var along_x: texture_3d<f32>;
@group(1) @binding(1) var along_y: texture_3d<f32>;
@group(1) @binding(2) var along_z: texture_3d<f32>;
@group(1) @binding(3) var<storage, read_write> bits: array<u32>;

// The instance is the slice: near and far plane are its two sides.
@vertex
fn vertex(@location(0) position_m: vec3<f32>, @builtin(instance_index) slice: u32) -> @builtin(position) vec4<f32> {
    let voxels = swizzled(to_cells(grid, position_m));
    let share = voxels.xy / swizzled(vec3<f32>(grid.cells)).xy;
    return vec4(2.0 * share.x - 1.0, 1.0 - 2.0 * share.y, voxels.z - f32(slice), 1.0);
}

@fragment
fn fragment() -> @location(0) vec4<f32> {
    return vec4(1.0);
}

fn occupied(cell: vec3<u32>) -> bool {
    let found = vec3(
        textureLoad(along_x, cell.yzx, 0).x,
        textureLoad(along_y, cell.xzy, 0).x,
        textureLoad(along_z, cell, 0).x,
    );
    return any(found > vec3(0.5));
}

// One invocation for a word of the bit volume.
@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let number = invocation_index(id, groups);
    if number >= grid.words {
        return;
    }
    let n = grid.cells;
    var word = 0u;
    for (var bit = 0u; bit < 32u; bit++) {
        let index = 32u * number + bit;
        let row = index / n.x;
        let cell = vec3(index % n.x, row % n.y, row / n.y);
        if cell.z < n.z && occupied(cell) {
            word |= 1u << bit;
        }
    }
    bits[number] = word;
}
