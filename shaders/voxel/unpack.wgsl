// Bits, or alphas of a word each, to bytes in rows as a copy to a texture wants them. VAO §4.2.
// defs: ALPHA=0
#import fathom::voxels::{Grid}
#import fathom::dispatch::{GROUP, invocation_index}
#import fathom::rows::{pitch_words}

@group(0) @binding(0) var<uniform> grid: Grid;
// A bit for each voxel, or with ALPHA a word of 0 … 255.
@group(0) @binding(1) var<storage, read> voxels: array<u32>;
@group(0) @binding(2) var<storage, read_write> rows: array<u32>;

#if ALPHA == 1
// Four voxels from `start` on, of which `count` are in the row, as bytes.
fn bytes_at(start: u32, count: u32) -> u32 {
    var bytes = 0u;
    for (var k = 0u; k < min(count, 4u); k++) {
        bytes |= voxels[start + k] << (8u * k);
    }
    return bytes;
}
#else
// 32 voxels of the bit volume from `start` on.
fn word_at(start: u32) -> u32 {
    let first = start >> 5u;
    let shift = start & 31u;
    if shift == 0u {
        return voxels[first];
    }
    let second = min(first + 1u, grid.words - 1u);
    return (voxels[first] >> shift) | (voxels[second] << (32u - shift));
}
#endif

// One invocation for 32 voxels of a row.
@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let parts = (grid.cells.x + 31u) / 32u;
    let number = invocation_index(id, groups);
    let row = number / parts;
    if row >= grid.cells.y * grid.cells.z {
        return;
    }
    let part = number % parts;
    let start = row * grid.cells.x + part * 32u;
    let first = row * pitch_words(grid.cells.x) + part * 8u;
#if ALPHA == 1
    let count = grid.cells.x - part * 32u;
    for (var k = 0u; k < 8u; k++) {
        rows[first + k] = bytes_at(start + 4u * k, max(count, 4u * k) - 4u * k);
    }
#else
    let word = word_at(start);
    for (var k = 0u; k < 8u; k++) {
        // Four bits to the lowest bits of four bytes: the product puts a copy at every seventh bit.
        let spread = (((word >> (4u * k)) & 15u) * 0x00204081u) & 0x01010101u;
        rows[first + k] = spread * 255u;
    }
#endif
}
