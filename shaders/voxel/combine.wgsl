// OR of the three slicemaps in one frame of reference. VAO §4.2.
//
// The slicemaps of y and z hold bits along their own axes. Blocks of 32 × 32 bits are transposed into bits along x
// in five steps (Warren, Hacker's Delight, §7-3), so that each word is read once. A workgroup takes a cube of
// 32 × 32 × 32 voxels: each invocation transposes one block of z's slicemap and then one of y's.
#import fathom::voxels::{Grid, index_of}

@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var<storage, read> along_x: array<u32>;
@group(0) @binding(2) var<storage, read> along_y: array<u32>;
@group(0) @binding(3) var<storage, read> along_z: array<u32>;
@group(0) @binding(4) var<storage, read_write> bits: array<atomic<u32>>;

// Words along x of z's slicemap, [y][z]. A word more a row, so that a column lies in different banks.
var<workgroup> transposed_z: array<array<u32, 33>, 32>;

alias Block = array<vec4<u32>, 8>;

fn word_of(axis: u32, index: u32) -> u32 {
    switch axis {
        case 0u: { return along_x[index]; }
        case 1u: { return along_y[index]; }
        default: { return along_z[index]; }
    }
}

// 32 words of an axis' slicemap from `first` on, those from `count` on left empty.
fn load(axis: u32, first: u32, count: u32) -> Block {
    var block: Block;
    for (var i = 0u; i < 8u; i++) {
        for (var j = 0u; j < 4u; j++) {
            let k = 4u * i + j;
            block[i][j] = select(0u, word_of(axis, first + min(k, count - 1u)), k < count);
        }
    }
    return block;
}

fn is_empty(block: Block) -> bool {
    let all = block[0] | block[1] | block[2] | block[3] | block[4] | block[5] | block[6] | block[7];
    return !any(all != vec4(0u));
}

// What the upper bits of `low` and the lower bits of `high` differ in, at the place of the lower ones.
fn difference(low: vec4<u32>, high: vec4<u32>, shift: u32, mask: u32) -> vec4<u32> {
    return ((low >> vec4(shift)) ^ high) & vec4(mask);
}

// Bit i of word j becomes bit j of word i: halves, quarters and so on of the words are exchanged.
fn transposed(block: Block) -> Block {
    var words = block;
    for (var i = 0u; i < 4u; i++) {
        let moved = difference(words[i], words[i + 4u], 16u, 0x0000ffffu);
        words[i] ^= moved << vec4(16u);
        words[i + 4u] ^= moved;
    }
    for (var k = 0u; k < 4u; k++) {
        let i = k + (k & 2u);
        let moved = difference(words[i], words[i + 2u], 8u, 0x00ff00ffu);
        words[i] ^= moved << vec4(8u);
        words[i + 2u] ^= moved;
    }
    for (var i = 0u; i < 8u; i += 2u) {
        let moved = difference(words[i], words[i + 1u], 4u, 0x0f0f0f0fu);
        words[i] ^= moved << vec4(4u);
        words[i + 1u] ^= moved;
    }
    for (var i = 0u; i < 8u; i++) {
        var four = words[i];
        let pairs = difference(four.xyxy, four.zwzw, 2u, 0x33333333u).xy;
        four ^= vec4(pairs << vec2(2u), pairs);
        let odd = difference(four.xzxz, four.ywyw, 1u, 0x55555555u).xy;
        words[i] = four ^ vec4(odd.x << 1u, odd.x, odd.y << 1u, odd.y);
    }
    return words;
}

// ORs 32 voxels from `cell` on along x into the bit volume, which was cleared.
fn put(cell: vec3<u32>, word: u32) {
    if word == 0u {
        return;
    }
    let start = index_of(grid, cell);
    let shift = start & 31u;
    atomicOr(&bits[start >> 5u], word << shift);
    if shift > 0u && (word >> (32u - shift)) > 0u {
        atomicOr(&bits[(start >> 5u) + 1u], word >> (32u - shift));
    }
}

@compute @workgroup_size(32)
fn main(@builtin(workgroup_id) cube: vec3<u32>, @builtin(local_invocation_index) own: u32) {
    let n = grid.cells;
    let corner = cube * 32u;
    let row_length = min(n.x - corner.x, 32u);
    let y = corner.y + own;
    if y < n.y {
        var block = load(2u, corner.x + n.x * (y + n.y * cube.z), row_length);
        if !is_empty(block) {
            block = transposed(block);
        }
        for (var k = 0u; k < 32u; k++) {
            transposed_z[own][k] = block[k >> 2u][k & 3u];
        }
    }
    workgroupBarrier();
    let z = corner.z + own;
    if z >= n.z {
        return;
    }
    var block = load(1u, corner.x + n.x * (z + n.z * cube.y), row_length);
    if !is_empty(block) {
        block = transposed(block);
    }
    let x_words = n.y * (z + n.z * cube.x);
    for (var k = 0u; k < min(n.y - corner.y, 32u); k++) {
        let word = word_of(0u, x_words + corner.y + k) | block[k >> 2u][k & 3u] | transposed_z[k][own];
        put(vec3(corner.x, corner.y + k, z), word);
    }
}
