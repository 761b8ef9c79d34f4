// Bits to bytes, in rows as a copy to a texture wants them. VAO §4.2.
#import fathom::voxels::{Grid}
#import fathom::rows::{GROUP, pitch_words, place}

@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var<storage, read> bits: array<u32>;
@group(0) @binding(2) var<storage, read_write> rows: array<u32>;

// 32 voxels of the bit volume from `start` on.
fn word_at(start: u32) -> u32 {
    let first = start >> 5u;
    let shift = start & 31u;
    if shift == 0u {
        return bits[first];
    }
    let second = min(first + 1u, grid.words - 1u);
    return (bits[first] >> shift) | (bits[second] << (32u - shift));
}

// One invocation for 32 voxels of a row.
@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let parts = (grid.cells.x + 31u) / 32u;
    let number = place(id, groups);
    let row = number / parts;
    if row >= grid.cells.y * grid.cells.z {
        return;
    }
    let part = number % parts;
    let word = word_at(row * grid.cells.x + part * 32u);
    let first = row * pitch_words(grid.cells.x) + part * 8u;
    for (var k = 0u; k < 8u; k++) {
        // Four bits to the lowest bits of four bytes: each product puts one of them in its place.
        let spread = (((word >> (4u * k)) & 15u) * 0x00204081u) & 0x01010101u;
        rows[first + k] = spread * 255u;
    }
}
