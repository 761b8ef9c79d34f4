// Occupancy pyramid: levels of a volume's texture above the first, through rows in a buffer. VAO §6.3.
// defs: BASE=1
//
// A cell of level 1 is full where any voxel of its 2 × 2 × 2 block or of the one-voxel border around it is: a trilinear
// sample within the cell reads no other voxels, so that it is 0 wherever the cell is empty. Cells of higher levels are
// the OR of 2 × 2 × 2 cells, and the last along an axis takes what is left over: voxel v lies in cell
// min(v >> level, size - 1).
#import fathom::dispatch::{GROUP, invocation_index}
#import fathom::rows::{pitch_words}

struct Level {
    below: vec3<u32>,
    // Where the rows of the level below start, in words.
    below_word: u32,
    size: vec3<u32>,
    size_word: u32,
}

@group(0) @binding(0) var<uniform> level: Level;
@group(0) @binding(1) var<storage, read> bits: array<u32>;
// Rows of all levels above the first, one after the other.
@group(0) @binding(2) var<storage, read_write> rows: array<u32>;

// Row and part of a row that an invocation takes; past the last row where there is none left.
fn row_of(number: u32, parts: u32) -> vec3<u32> {
    let row = number / parts;
    return vec3(number % parts, row % level.size.y, row / level.size.y);
}

fn first_word(row: vec3<u32>) -> u32 {
    return level.size_word + pitch_words(level.size.x) * (row.y + level.size.y * row.z);
}

#if BASE == 1
// Bits from the one before `start` to the one after the 32 from `start` on, of which `count` lie in the row.
struct Span {
    before: u32,
    word: u32,
    after: u32,
}

fn span_at(start: u32, count: u32, has_before: bool) -> Span {
    let first = start >> 5u;
    let shift = start & 31u;
    let previous = bits[max(first, 1u) - 1u];
    let here = bits[first];
    let next = bits[min(first + 1u, arrayLength(&bits) - 1u)];
    var span: Span;
    span.word = here;
    span.before = previous >> 31u;
    if shift > 0u {
        span.word = (here >> shift) | (next << (32u - shift));
        span.before = (here >> (shift - 1u)) & 1u;
    }
    span.before = select(0u, span.before, has_before);
    span.word &= select(0xffffffffu, (1u << (count & 31u)) - 1u, count < 32u);
    span.after = select(0u, (next >> shift) & 1u, count > 32u);
    return span;
}

// One invocation for 16 cells of a row.
@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let row = row_of(invocation_index(id, groups), (level.size.x + 15u) / 16u);
    if row.z >= level.size.z {
        return;
    }
    let n = level.below;
    let x = 32u * row.x;
    var found = Span(0u, 0u, 0u);
    let first = max(2u * row.yz, vec2(1u)) - 1u;
    let last = min(2u * row.yz + 2u, n.yz - 1u);
    for (var z = first.y; z <= last.y; z++) {
        for (var y = first.x; y <= last.x; y++) {
            let span = span_at(x + n.x * (y + n.y * z), n.x - x, x > 0u);
            found.before |= span.before;
            found.word |= span.word;
            found.after |= span.after;
        }
    }
    // Bit 2 i: any of the voxels 2 i - 1 to 2 i + 2.
    let cells = found.word | (found.word << 1u) | found.before | (found.word >> 1u) | (found.word >> 2u)
        | (found.after << 31u) | (found.after << 30u);
    let to = first_word(row) + 4u * row.x;
    for (var k = 0u; k < 4u; k++) {
        let four = cells >> (8u * k);
        rows[to + k] = 255u * ((four & 1u) | (four & 4u) << 6u | (four & 16u) << 12u | (four & 64u) << 18u);
    }
}
#else
fn below_at(cell: vec3<u32>) -> u32 {
    let row = level.below_word + pitch_words(level.below.x) * (cell.y + level.below.y * cell.z);
    return rows[row + (cell.x >> 2u)] >> (8u * (cell.x & 3u)) & 255u;
}

fn cell_at(cell: vec3<u32>) -> u32 {
    let last = select(2u * cell + 1u, level.below - 1u, cell == level.size - 1u);
    var found = 0u;
    for (var z = 2u * cell.z; z <= last.z; z++) {
        for (var y = 2u * cell.y; y <= last.y; y++) {
            for (var x = 2u * cell.x; x <= last.x; x++) {
                found |= below_at(vec3(x, y, z));
            }
        }
    }
    return found;
}

// One invocation for four cells of a row.
@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let row = row_of(invocation_index(id, groups), (level.size.x + 3u) / 4u);
    if row.z >= level.size.z {
        return;
    }
    var word = 0u;
    for (var k = 0u; k < min(level.size.x - 4u * row.x, 4u); k++) {
        word |= cell_at(vec3(4u * row.x + k, row.yz)) << (8u * k);
    }
    rows[first_word(row) + row.x] = word;
}
#endif
